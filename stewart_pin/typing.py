"""Array aliases that say what an array means; the shapes stand in the docstrings of the verbs."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.floating[Any]]
ComplexArray: TypeAlias = NDArray[np.complexfloating[Any, Any]]
IntArray: TypeAlias = NDArray[np.integer[Any]]
BoolArray: TypeAlias = NDArray[np.bool_]
Configuration: TypeAlias = FloatArray
"""(nq,) configuration of the spanning tree, Pinocchio's convention [m, rad, unit quaternions]."""
Tangent: TypeAlias = FloatArray
"""(nv,) velocity, acceleration or displacement of the spanning tree [m, rad and per s, s²]."""

__all__ = ["ArrayLike", "BoolArray", "ComplexArray", "Configuration", "FloatArray", "IntArray", "Tangent"]
