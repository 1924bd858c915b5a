"""Which derivatives by the geometry are asked for, by which way they are had, and which of them do not exist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.state.geometry_parameters import GeometryParameter, geometry_parameters
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet

Along: TypeAlias = ArrayLike | Sequence[GeometryParameter]
"""Displacements: some parameters, or (parameters, k) columns of all of them [m or rad per unit]."""


@dataclass(frozen=True, eq=False)
class GeometryColumns:
    """How to turn derivatives by all displacements that a function knows into those that are asked for.

    Attributes
    ----------
    function
        Ending of the function's name: ``by_legs`` where the legs know all that is asked for, or ``by_tree``.
    along
        (known, k) what is asked for [m or rad per unit], or None: all, as they come.
    blocked
        (known,) of bool, dimensionless: displacements without a derivative, if all are asked for.
    """

    function: str
    along: FloatArray | None
    blocked: np.ndarray


def geometry_columns(functions: FunctionSet, along: Along | None) -> GeometryColumns:
    """Check which derivatives are asked for.

    Parameters
    ----------
    functions
        Functions of the chain.
    along
        Parameters, or (parameters, k) displacements [m or rad per unit]; None: each parameter by itself.

    Returns
    -------
    GeometryColumns
        The way to them.

    Raises
    ------
    UnsupportedError
        If along one of them there is no derivative.
    InputError
        If the shape is wrong, an entry is not finite, or a parameter is not one of the chain's.
    """
    parameters = geometry_parameters(functions.chain)
    if along is None:
        return GeometryColumns("by_tree", None, ~functions.displacements.alone)
    matrix = _as_displacements(parameters, along)
    legs = list(functions.leg_displacements)
    none = np.zeros(len(parameters), dtype=bool)
    if legs and not np.delete(matrix, legs, axis=0).any():
        return GeometryColumns("by_legs", matrix[legs], none)
    blocked = np.flatnonzero(functions.displacements.blocked(matrix))
    if blocked.size:
        column = int(blocked[0])
        names = [str(p) for p, x in zip(parameters, matrix[:, column], strict=True) if x]
        raise UnsupportedError(
            f"there is no derivative along column {column} of along ({'; '.join(names[:3])}"
            f"{', ...' if len(names) > 3 else ''}): {functions.chain.name} would lose its mobility, or depend on where "
            "idle freedoms stand; Kernels.geometry_displacements is a basis of what may be displaced"
        )
    return GeometryColumns("by_tree", matrix, none)


def _as_displacements(parameters: Sequence[GeometryParameter], along: Any) -> FloatArray:
    if not isinstance(along, Sequence) or not any(isinstance(x, GeometryParameter) for x in along):
        return as_array("along", along, (len(parameters), None))
    places = {parameter: k for k, parameter in enumerate(parameters)}
    unknown = [x for x in along if x not in places]
    if unknown:
        raise InputError(f"along holds {unknown[0]}, which is none of Kernels.geometry_parameters")
    return np.eye(len(places))[:, [places[x] for x in along]]
