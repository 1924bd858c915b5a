"""Arctangent of two arguments of all lanes at once, written as LLVM IR, and its relatives.

The smaller of |x| and |y| is divided by the larger. Above tan(π/8) the quotient q becomes (q - 1) / (q + 1), whose
arctangent is less by π/4; a rational function does the rest, and quadrant and signs follow.

References
----------
.. [1] Cephes 2.8, atan.c (coefficients for doubles) and atanf.c (for floats).
"""

from __future__ import annotations

import math

from stewart_pin.kernels.llvm.trigonometry import write_polynomial
from stewart_pin.kernels.llvm.writer import Writer

_TAN_EIGHTH = 0.414213562373095048802
_HALF_TURN = {
    "double": (math.pi, 1.2246467991473532e-16),
    "float": (3.1415927410125732, -8.7422780126189537e-08),
}
"""π as the type has it, and what that lacks."""
_FAR = {"double": 1e307, "float": 1e37}
"""Arguments above this are left to the C library: their sum may overflow."""
_ABOVE = {
    "double": (
        -6.485021904942025371773e1,
        -1.228866684490136173410e2,
        -7.500855792314704667340e1,
        -1.615753718733365076637e1,
        -8.750608600031904122785e-1,
    ),
    "float": (-3.33329491539e-1, 1.99777106478e-1, -1.38776856032e-1, 8.05374449538e-2),
}
_BELOW = {
    "double": (
        1.945506571482613964425e2,
        4.853903996359136964868e2,
        4.328810604912902668951e2,
        1.650270098316988542046e2,
        2.485846490142306297962e1,
        1.0,
    ),
    "float": (),
}


def write_arctangent(w: Writer, y: str, x: str) -> str:
    """Write the angle of the point (x, y).

    Parameters
    ----------
    w
        Function under construction.
    y, x
        Names of the coordinates.

    Returns
    -------
    str
        Name of the angle, in [-π, π], with the sign of y.
    """
    zero, one = w.constant(0.0), w.constant(1.0)
    across, along = w.call("fabs", y), w.call("fabs", x)
    steep = w.compare("ogt", across, along)
    large, small = w.select(steep, across, along), w.select(steep, along, across)
    middle = w.compare("ogt", small, w.put(f"fmul {w.type} {large}, {w.constant(_TAN_EIGHTH)}"))
    above = w.select(middle, w.put(f"fsub {w.type} {small}, {large}"), small)
    below = w.select(middle, w.put(f"fadd {w.type} {small}, {large}"), large)
    below = w.select(w.compare("oeq", below, zero), one, below)
    q = w.put(f"fdiv {w.type} {above}, {below}")
    half_turn, lacking = _HALF_TURN[w.scalar]
    # q + rest is the angle; what π/4 lacks is added to the small part.
    rest = w.put(f"fadd {w.type} {_rest(w, q)}, {w.select(middle, w.constant(lacking / 4), zero)}")
    angle = w.put(f"fadd {w.type} {q}, {rest}")
    angle = w.put(f"fadd {w.type} {angle}, {w.select(middle, w.constant(half_turn / 4), zero)}")
    angle = w.select(steep, _less(w, half_turn / 2, lacking / 2, angle), angle)
    backward = w.compare("olt", w.call("copysign", one, x), zero)
    angle = w.call("copysign", w.select(backward, _less(w, half_turn, lacking, angle), angle), y)
    far = w.compare("ogt", large, w.constant(_FAR[w.scalar]))
    return w.seldom(far, lambda: w.select(far, w.lane_by_lane("atan2", y, x), angle), angle)


def _rest(w: Writer, q: str) -> str:
    """Arctangent of q, at most tan(π/8) in size, less q."""
    z = w.put(f"fmul {w.type} {q}, {q}")
    ratio = write_polynomial(w, z, _ABOVE[w.scalar])
    if below := _BELOW[w.scalar]:
        ratio = w.put(f"fdiv {w.type} {ratio}, {write_polynomial(w, z, below)}")
    return w.put(f"fmul {w.type} {w.put(f'fmul {w.type} {q}, {z}')}, {ratio}")


def _less(w: Writer, whole: float, lacking: float, angle: str) -> str:
    """Subtract an angle from a constant, given in two parts."""
    return w.put(
        f"fsub {w.type} {w.constant(whole)}, {w.put(f'fsub {w.type} {angle}, {w.constant(lacking)}')}"
    )


def write_arcsine(w: Writer, x: str) -> str:
    """Write an arcsine.

    Parameters
    ----------
    w
        Function under construction.
    x
        Name of the sine.

    Returns
    -------
    str
        Name of the angle; nan outside [-1, 1].
    """
    return write_arctangent(w, x, _other_side(w, x))


def write_arccosine(w: Writer, x: str) -> str:
    """Write an arccosine.

    Parameters
    ----------
    w
        Function under construction.
    x
        Name of the cosine.

    Returns
    -------
    str
        Name of the angle; nan outside [-1, 1].
    """
    return write_arctangent(w, _other_side(w, x), x)


def _other_side(w: Writer, x: str) -> str:
    """√((1 - x) (1 + x)), which loses nothing near 1."""
    one = w.constant(1.0)
    factors = (w.put(f"{f} {w.type} {one}, {x}") for f in ("fsub", "fadd"))
    return w.call("sqrt", w.put(f"fmul {w.type} {next(factors)}, {next(factors)}"))
