"""From a CasADi function to a fast function on arrays, in one step."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.programs.array_kernel import ArrayKernel, Engine
from stewart_pin.programs.instructions import program_from_casadi
from stewart_pin.programs.passes import prepare
from stewart_pin.programs.repeating import Repeat
from stewart_pin.programs.status import StateBound


def compile_function(
    function: Any,
    *,
    bounds: Sequence[StateBound] = (),
    dtype: DTypeLike = np.float64,
    repeat: Repeat | None = None,
    engine: Engine | None = None,
    matrices: Collection[str] = (),
) -> ArrayKernel:
    """Compile a CasADi function to a function on arrays of states.

    Parameters
    ----------
    function
        `casadi.Function` that can be written as scalar operations without branches.
    bounds
        Bounds of outputs that judge a state; these outputs are not given back.
    dtype
        numpy.float64 or numpy.float32.
    repeat
        How the function is repeated on its own result; None runs it once.
    engine
        ``"llvm"`` (extra ``kernels``) or ``"numpy"``; None takes llvm when it is installed.
    matrices
        Outputs that stay matrices where they have one column; others become vectors.

    Returns
    -------
    ArrayKernel
        Function of arrays (N, size) or (N, rows, columns), one for each input, in C order.

    Raises
    ------
    InputError
        If an argument does not fit.
    MissingExtraError
        If CasADi, or llvm when asked for, is not installed.
    UnsupportedError
        If the function cannot be written as scalar operations.

    Examples
    --------
    >>> import casadi as ca
    >>> x = ca.SX.sym("x", 2)
    >>> norm = compile_function(ca.Function("norm", [x], [ca.norm_2(x)]))
    >>> norm(np.array([[3.0, 4.0], [5.0, 12.0]]))
    array([[ 5.],
           [13.]])
    """
    return ArrayKernel(
        prepare(program_from_casadi(function, matrices=matrices)),
        bounds=bounds,
        dtype=dtype,
        repeat=repeat,
        engine=engine,
    )
