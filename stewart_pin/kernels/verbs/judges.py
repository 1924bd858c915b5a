"""Outputs that judge a state: feasible demands, closed loops, unit quaternions, and how near a singularity is."""

from __future__ import annotations

from typing import Any

import numpy as np

from stewart_pin.kernels.verbs.configurations import UNIT
from stewart_pin.programs.status import StateBound, StateStatus
from stewart_pin.tolerances import SINGULAR
from stewart_pin.typing import FloatArray

_FEASIBLE = {"f8": 1e-6, "f4": 1e-5}
"""Part of a demand that may be impossible: round-off of printed numbers, as in the one-state verbs; a hundred units of
round-off in single precision."""
_REGULAR = {"f8": SINGULAR, "f4": 1e-4}
"""Conditioning below which a state is singular: where the one-state verbs say so; in single precision with three digits
left."""
_FOUND = {"f8": 1e-4, "f4": 1e-2}
"""The same where the configuration was looked for with the motors held. Loops closed to 1e-12 leave it 1e-12 / c off,
and c itself a part 1e-12 / c² of its own: four digits are left. In single precision they close to 1e-6, and two are
left."""
POOR = 1e-2
"""Conditioning below which other pivots are tried."""


def judged(
    function: Any,
    measure: Any | None,
    dtype: np.dtype[Any],
    *,
    graded: bool = False,
    wary: bool = False,
    found: bool = False,
) -> tuple[Any, list[StateBound]]:
    """Add the outputs that judge a state.

    Parameters
    ----------
    function
        `casadi.Function` of states.
    measure
        `casadi.Function` of its first input, with the conditioning of the state; None where nothing is divided by.
    dtype
        Type of the kernel.
    graded
        Whether the conditioning is given back, as the last output, of singular states too; nan without a measure.
    wary
        Whether states that are `POOR` count as singular already, to be looked at again.
    found
        Whether the configuration was looked for with the motors held, and is known the less the nearer it is to a
        singularity.

    Returns
    -------
    function : casadi.Function
        With these outputs.
    bounds : list of StateBound
        What they must keep.
    """
    import casadi as ca  # noqa: PLC0415 - optional; there is a function already

    kind = dtype.str[1:]
    inputs = function.sx_in()
    outputs = dict(zip(function.name_out(), function.call(inputs), strict=True))
    bounds = [StateBound(name, upper=_FEASIBLE[kind]) for name in ("infeasible", "open") if name in outputs]
    if "pose" in function.name_in():
        quaternion = inputs[function.name_in().index("pose")][3:]
        outputs["quaternion_square"] = ca.dot(quaternion, quaternion)
        bounds.append(StateBound("quaternion_square", 1 - UNIT, 1 + UNIT))
    if measure is not None:
        outputs["conditioning"] = measure.call(inputs[:1])[0]
        least = POOR if wary else (_FOUND if found else _REGULAR)[kind]
        bounds.append(StateBound("conditioning", lower=least, code=StateStatus.SINGULAR, written=graded))
    results: Any = ca.cse(list(outputs.values()))
    return ca.Function(function.name(), inputs, results, function.name_in(), list(outputs)), bounds


def lost_twice(conditioning: FloatArray) -> None:
    """Count, in place, what a configuration that was looked for has lost already, and the dynamics lose again.

    Parameters
    ----------
    conditioning
        (N,) of the configurations c, dimensionless; becomes c² where that is less: the error of a configuration, ε / c,
        is enlarged by 1 / c.
    """
    np.minimum(conditioning, conditioning**2, out=conditioning)
