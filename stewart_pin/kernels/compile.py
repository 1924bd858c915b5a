"""From a chain to its verbs for arrays of states."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError, MissingExtraError
from stewart_pin.kernels.kernels import Kernels
from stewart_pin.programs.array_kernel import Engine
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain


def compile_kernels(
    chain: ClosedChain,
    *,
    coordinates: Literal["platform", "motor", "tree"] = "platform",
    dtype: DTypeLike = np.float64,
    engine: Engine | None = None,
) -> Kernels:
    """Prepare the verbs of a chain for arrays of states.

    Parameters
    ----------
    chain
        Closed chain.
    coordinates
        ``"platform"``: states are poses, twists and accelerations of the platform; ``"motor"``: positions, rates and
        accelerations of the motors; ``"tree"``: q, v and a of the whole spanning tree, for any chain.
    dtype
        numpy.float64 or numpy.float32, the type of every operation.
    engine
        ``"llvm"`` for machine code, ``"numpy"`` to interpret the same program; None takes llvm when it is installed.

    Returns
    -------
    Kernels
        The verbs; each is written and compiled when it is first called.

    Raises
    ------
    MissingExtraError
        If CasADi is not installed.
    UnsupportedError
        If the chain cannot be compiled, with the reason.
    InputError
        If an option is unknown.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> kernels = stp.compile_kernels(stp.load("stewart"))
    >>> pose, rest = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 6))
    >>> kernels.inverse_dynamics(pose, rest, rest).round(2)
    array([[49.99, 49.99, 49.99, 49.99, 49.99, 49.99]])
    """
    as_chain(chain)
    if coordinates not in ("platform", "motor", "tree"):
        raise InputError(f"coordinates must be 'platform', 'motor' or 'tree', got {coordinates!r}")
    try:
        from stewart_pin.kernels.graph.function_set import FunctionSet  # noqa: PLC0415 - needs CasADi
    except ImportError as error:
        if error.name != "casadi":
            raise
        raise MissingExtraError("casadi", "kernels") from None
    return Kernels(FunctionSet(chain, coordinates), dtype, engine)
