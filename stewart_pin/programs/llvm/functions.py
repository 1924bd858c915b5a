"""Sine, cosine and arctangent, with their relatives, of all lanes at once, written as LLVM IR.

For sine and cosine the argument is reduced by n π/2, π/2 being cut into parts whose products with n are exact; a
polynomial gives sine and cosine of the rest, which the last bits of n then exchange and sign. Beyond the limit of the
type the C library is called, lane by lane. Every lane takes the way of its own argument, so neighbours do not matter.

References
----------
.. [1] Cody and Waite, "Software manual for the elementary functions", 1980, chapter 8.
.. [2] fdlibm 5.3, k_sin.c and k_cos.c (coefficients for doubles); Cephes, sinf.c (for floats).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from stewart_pin.programs.llvm.writer import Writer


@dataclass(frozen=True)
class _Numbers:
    """Constants for one type.

    `magic` is 1.5 times the value of which one unit in the last place is 1: adding it rounds to a whole number, whose
    last bits then stand in the last bits of the sum.
    """

    integer: str
    limit: float
    magic: float
    parts: tuple[float, ...]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]


_NUMBERS = {
    "double": _Numbers(
        integer="i64",
        limit=1e6,  # n below 2**20; the parts but the last have 33 bits
        magic=1.5 * 2.0**52,
        parts=(1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
        sine=(
            -1.66666666666666324348e-01,
            8.33333333332248946124e-03,
            -1.98412698298579493134e-04,
            2.75573137070700676789e-06,
            -2.50507602534068634195e-08,
            1.58969099521155010221e-10,
        ),
        cosine=(
            4.16666666666666019037e-02,
            -1.38888888888741095749e-03,
            2.48015872894767294178e-05,
            -2.75573143513906633035e-07,
            2.08757232129817482790e-09,
            -1.13596475577881948265e-11,
        ),
    ),
    "float": _Numbers(
        integer="i32",
        limit=8e3,  # n below 2**13; the parts but the last have 11 bits
        magic=1.5 * 2.0**23,
        parts=(1.5703125, 4.837512969970703125e-4, 7.549533620476722717e-8, 2.5633440682570896e-12),
        sine=(-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4),
        cosine=(4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
    ),
}
_TWO_BY_PI = 0.636619772367581343076


@dataclass(frozen=True)
class Turned:
    """Sine and cosine of the rest of an angle, and how often a quarter turn was taken off.

    Attributes
    ----------
    sine, cosine
        Names of the values.
    quarters
        Name of an integer whose last two bits count quarter turns.
    far
        Name of the mask of angles that are too large to be reduced here.
    """

    sine: str
    cosine: str
    quarters: str
    far: str


def write_sine(w: Writer, x: str) -> str:
    """Write a sine.

    Parameters
    ----------
    w
        Function under construction.
    x
        Name of the angle.

    Returns
    -------
    str
        Name of its sine.
    """
    turned = _turned(w, x)
    return _mended(w, "sin", x, turned.far, _quadrant(w, turned.quarters, turned.sine, turned.cosine))


def write_cosine(w: Writer, x: str) -> str:
    """Write a cosine.

    Parameters
    ----------
    w
        Function under construction.
    x
        Name of the angle.

    Returns
    -------
    str
        Name of its cosine.
    """
    turned = _turned(w, x)
    integer = w.integers(_NUMBERS[w.scalar].integer)
    quarters = w.put(f"add {integer} {turned.quarters}, {w.integer(_NUMBERS[w.scalar].integer, 1)}")
    return _mended(w, "cos", x, turned.far, _quadrant(w, quarters, turned.sine, turned.cosine))


def _turned(w: Writer, x: str) -> Turned:
    if x not in w.shared:  # sine and cosine of one angle have all this in common
        w.shared[x] = _turn(w, x, _NUMBERS[w.scalar])
    return w.shared[x]


def _turn(w: Writer, x: str, numbers: _Numbers) -> Turned:
    magic = w.constant(numbers.magic)
    shifted = w.multiply_add(x, w.constant(_TWO_BY_PI), magic)
    quarters = w.put(f"bitcast {w.type} {shifted} to {w.integers(numbers.integer)}")
    n = w.put(f"fsub {w.type} {shifted}, {magic}")
    rest = x
    for part in numbers.parts:
        rest = w.multiply_add(n, w.constant(-part), rest)
    z = w.put(f"fmul {w.type} {rest}, {rest}")
    cube = w.put(f"fmul {w.type} {z}, {rest}")
    sine = w.multiply_add(cube, write_polynomial(w, z, numbers.sine), rest)
    sine = w.call("copysign", sine, rest)  # of zero as well
    # 1 - z/2 is rounded; what it lost comes back before the small terms are added.
    half = w.put(f"fmul {w.type} {z}, {w.constant(0.5)}")
    near = w.put(f"fsub {w.type} {w.constant(1.0)}, {half}")
    lost = w.put(f"fsub {w.type} {w.put(f'fsub {w.type} {w.constant(1.0)}, {near}')}, {half}")
    square = w.put(f"fmul {w.type} {z}, {z}")
    small = w.multiply_add(square, write_polynomial(w, z, numbers.cosine), lost)
    far = w.compare("ogt", w.call("fabs", x), w.constant(numbers.limit))
    return Turned(sine, w.put(f"fadd {w.type} {near}, {small}"), quarters, far)


def write_polynomial(w: Writer, z: str, coefficients: Sequence[float]) -> str:
    """Write a polynomial by Horner's rule.

    Parameters
    ----------
    w
        Function under construction.
    z
        Name of the variable.
    coefficients
        From the constant term up.

    Returns
    -------
    str
        Name of its value.
    """
    value = w.constant(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = w.multiply_add(z, value, w.constant(c))
    return value


def _quadrant(w: Writer, quarters: str, even: str, odd: str) -> str:
    """Take the one or the other by the last bit, negated by the bit before it."""
    integer = _NUMBERS[w.scalar].integer
    kind = w.integers(integer)
    bits = [w.put(f"and {kind} {quarters}, {w.integer(integer, bit)}") for bit in (1, 2)]
    swap, turn = (w.put(f"icmp ne {kind} {bit}, {w.integer(integer, 0)}") for bit in bits)
    value = w.select(swap, odd, even)
    return w.select(turn, w.put(f"fneg {w.type} {value}"), value)


def _mended(w: Writer, name: str, x: str, far: str, within: str) -> str:
    return w.seldom(far, lambda: w.select(far, w.lane_by_lane(name, x), within), within)


# ----------------------------------------------------------------------------------------------------
# Arctangent of two arguments of all lanes at once, written as LLVM IR, and its relatives
#
# The smaller of |x| and |y| is divided by the larger. Above tan(π/8) the quotient q becomes (q - 1) / (q + 1), whose
# arctangent is less by π/4; a rational function does the rest, and quadrant and signs follow.
#
# References
# ----------
# .. [1] Cephes 2.8, atan.c (coefficients for doubles) and atanf.c (for floats).
# ----------------------------------------------------------------------------------------------------

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
