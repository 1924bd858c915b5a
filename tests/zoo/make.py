"""Write the mechanisms of the zoo, and the robots among them: ``python -m tests.zoo.make``.

Points are metres in the world, at home.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from stewart_pin.building.loading import urdf_root
from tests.zoo.make_robots import ROBOT_MAKERS
from tests.zoo.robot_telling import RobotTelling
from tests.zoo.telling import Telling, X, Y, Z, about, meet, unit, xz

MAKERS: dict[str, Callable[[Telling], None]] = {}
SQRT3 = np.sqrt(3.0)


def mechanism(tell: Callable[[Telling], None]) -> Callable[[Telling], None]:
    MAKERS[tell.__name__] = tell
    return tell


def _bars(name: str, o, a, b, d, tip=None) -> None:
    """Enter a planar four-bar O A B D with O and D on the ground, driven at O."""

    def tell(m: Telling) -> None:
        m.r("base", "crank", xz(*o), motor=True)
        m.r("crank", "coupler", xz(*a))
        m.r("base", "rocker", xz(*d))
        m.tip("coupler", xz(*(tip or b)))
        m.close("coupler", "rocker", xz(*b))

    MAKERS[name] = tell


_bars("crank_rocker", (0, 0), (0.12, 0.16), (0.7, 0.75), (0.9, 0))
_bars("drag_link", (0, 0), (-0.3, 0.4), (0.5, 0.9), (0.2, 0))
_bars("triple_rocker", (0, 0), (0.3, 0.4), (0.9, 0.6), (1, 0))
_bars("kite", (0, 0), (0.3, 0.4), (1, 0.5), (0.5, 0))
_bars("parallelogram", (0, 0), (0.2, 0.3), (0.8, 0.3), (0.6, 0))
_bars("antiparallelogram", (-0.5, 0), (-0.3, 0.4), (0.5, 0), (0.3, 0.4))
_bars("chebyshev", (-0.4, 0), (0.2, 0.8), (-0.2, 0.8), (0.4, 0), (0, 0.8))
_bars("watt_line", (-1, 0.25), (0, 0.25), (0, -0.25), (1, -0.25), (0, 0))
_bars("roberts", (-0.5, 0), (-0.25, 0.6), (0.25, 0.6), (0.5, 0), (0, 0))
_PIN = meet(xz(-0.12, 0.16), 0.5, xz(0.4, 0), 0.5)
_bars(
    "hoeken",
    (0, 0),
    (-0.12, 0.16),
    (_PIN[0], _PIN[2]),
    (0.4, 0),
    (2 * _PIN[0] + 0.12, 2 * _PIN[2] - 0.16),
)


@mechanism
def peaucellier(m: Telling) -> None:
    o, a, p, b, c, d = (
        xz(*x) for x in ((0, 0), (0.4, 0.3), (0.88, 0.66), (0.4, 0.8), (0.88, 0.16), (0.3125, 0))
    )
    m.r("base", "crank", d, motor=True)
    m.r("crank", "ab", a)
    m.r("crank", "ac", a)
    m.r("base", "ob", o)
    m.r("base", "oc", o)
    m.r("ob", "pb", b)
    m.r("oc", "pc", c)
    m.tip("pb", p)
    m.close("ab", "ob", b)
    m.close("ac", "oc", c)
    m.close("pb", "pc", p)


@mechanism
def slider_crank_offset(m: Telling) -> None:
    pin = xz(0.8, -0.1)
    m.r("base", "crank", xz(0, 0), motor=True)
    m.r("crank", "rod", xz(0.12, 0.16))
    m.p("base", "slider", pin, X)
    m.tip("slider", pin)
    m.close("rod", "slider", pin)


@mechanism
def whitworth(m: Telling) -> None:
    pin, pivot = xz(0.12, 0.16), xz(0, -0.4)
    m.r("base", "crank", xz(0, 0), motor=True)
    m.r("base", "lever", pivot)
    m.p("lever", "block", pin, pin - pivot)
    m.tip("lever", xz(0.2, 0.4))
    m.close("crank", "block", pin)


@mechanism
def scotch_yoke(m: Telling) -> None:
    pin = xz(0.12, 0.16)
    m.r("base", "crank", xz(0, 0), motor=True)
    m.p("base", "yoke", xz(0.12, 0), X)
    m.p("yoke", "block", pin, Z)
    m.tip("yoke", xz(0.5, 0))
    m.close("crank", "block", pin)


@mechanism
def lever_on_a_cylinder(m: Telling) -> None:
    foot, head = xz(0.4, -0.3), xz(0.6, 0.2)
    m.r("base", "lever", xz(0, 0))
    m.r("base", "cylinder", foot)
    m.p("cylinder", "piston", head, head - foot, motor=True)
    m.tip("lever", xz(0.9, 0.3))
    m.close("piston", "lever", head)


@mechanism
def elliptic_trammel(m: Telling) -> None:
    m.p("base", "slider_x", xz(0.6, 0), X, motor=True)
    m.p("base", "slider_z", xz(0, 0.4), Z)
    m.r("slider_x", "rod", xz(0.6, 0))
    m.tip("rod", xz(-0.3, 0.6))
    m.close("rod", "slider_z", xz(0, 0.4))


@mechanism
def oldham(m: Telling) -> None:
    a, b = xz(0, 0), xz(0.1, 0.03)
    m.r("base", "disc1", a, motor=True)
    m.r("base", "disc2", b)
    m.p("disc1", "middle", a, X)
    m.tip("disc2", b)
    m.close("middle", "disc2", b, Z, "prismatic")


@mechanism
def wedge(m: Telling) -> None:
    m.p("base", "wedge1", xz(0, 0), X, motor=True)
    m.p("base", "wedge2", xz(0.3, 0.2), Z)
    m.tip("wedge2", xz(0.3, 0.4))
    m.close("wedge1", "wedge2", xz(0.2, 0.1), X + 0.5 * Z, "prismatic")


@mechanism
def watt_six_bar(m: Telling) -> None:
    b, e, g = xz(0.7, 0.75), xz(1.1, 0.7), xz(1.4, 1.1)
    m.r("base", "crank", xz(0, 0), motor=True)
    m.r("crank", "coupler", xz(0.12, 0.16))
    m.r("base", "rocker", xz(0.9, 0))
    m.close("coupler", "rocker", b)
    # The second four-bar stands on coupler and rocker.
    m.r("coupler", "arm", g)
    m.r("rocker", "arm2", e)
    m.tip("arm", g)
    m.close("arm", "arm2", xz(1.5, 0.6))


@mechanism
def stephenson_six_bar(m: Telling) -> None:
    b, e, f = xz(0.7, 0.75), xz(0.4, 1.1), xz(1.2, 1.3)
    m.r("base", "crank", xz(0, 0), motor=True)
    m.r("crank", "coupler", xz(0.12, 0.16))
    m.r("base", "rocker", xz(0.9, 0))
    m.close("coupler", "rocker", b)
    m.r("coupler", "rod", e)
    m.r("base", "output", xz(1.6, 0.2))
    m.tip("output", f)
    m.close("rod", "output", f)


@mechanism
def jansen_leg(m: Telling) -> None:
    # Jansen's "holy numbers" in centimetres; the crank stands where no two bars are in line.
    size = 0.01
    pivot, pin = size * xz(-38, -7.8), size * 15 * xz(0.8, 0.6)
    top = meet(pivot, 0.415, pin, 0.5)
    back = meet(pivot, 0.401, top, 0.558)
    below = meet(pivot, 0.393, pin, 0.619, -1)
    knee = meet(below, 0.367, back, 0.394)
    foot = meet(below, 0.49, knee, 0.657, -1)
    m.r("base", "crank", xz(0, 0), motor=True)
    m.r("crank", "j", pin)
    m.r("crank", "k", pin)
    m.r("base", "upper", pivot)
    m.r("base", "c", pivot)
    m.r("upper", "f", back)
    m.r("c", "foot", below)
    m.tip("foot", foot)
    m.close("j", "upper", top)
    m.close("k", "c", below)
    m.close("f", "foot", knee)


@mechanism
def parallel_cranks(m: Telling) -> None:
    for k, x in enumerate((0.0, 0.4, 1.0)):
        m.r("base", f"crank{k}", xz(x, 0), motor=not k)
    m.r("crank0", "coupler", xz(0.2, 0.3))
    m.tip("coupler", xz(0.5, 0.4))
    m.close("coupler", "crank1", xz(0.6, 0.3))
    m.close("coupler", "crank2", xz(1.2, 0.3))


@mechanism
def double_parallelogram(m: Telling) -> None:
    a, b, c = xz(0.1, 0.5), xz(0.3, 0.6), xz(0.8, 0.4)
    m.r("base", "lower", xz(0, 0), motor=True)
    m.r("base", "lower2", xz(0.2, 0.1))
    m.r("lower", "elbow", a)
    m.r("elbow", "upper", b, motor=True)
    m.r("elbow", "upper2", xz(0.3, 0.5))
    m.r("upper", "lamp", c)
    m.tip("lamp", xz(0.9, 0.35))
    m.close("elbow", "lower2", xz(0.3, 0.6))
    m.close("lamp", "upper2", xz(0.8, 0.3))


@mechanism
def pantograph(m: Telling) -> None:
    m.r("base", "long1", xz(0, 0), motor=True)
    m.r("long1", "short1", xz(0.2, 0.3), motor=True)
    m.r("long1", "long2", xz(0.4, 0.6))
    m.r("short1", "short2", xz(0.4, 0.1))
    m.tip("long2", xz(0.8, 0.2))
    m.close("short2", "long2", xz(0.6, 0.4))


@mechanism
def five_bar_5r(m: Telling) -> None:
    m.r("base", "left", xz(0, 0), motor=True)
    m.r("left", "tip", xz(-0.2, 0.3))
    m.r("base", "right", xz(0.4, 0), motor=True)
    m.r("right", "far", xz(0.7, 0.3))
    m.tip("tip", xz(0.2, 0.7))
    m.close("tip", "far", xz(0.2, 0.7))


@mechanism
def five_bar_prrrp(m: Telling) -> None:
    m.p("base", "left", xz(-0.3, 0), Z, motor=True)
    m.r("left", "tip", xz(-0.3, 0))
    m.p("base", "right", xz(0.4, 0.1), Z, motor=True)
    m.r("right", "far", xz(0.4, 0.1))
    m.tip("tip", xz(0.1, 0.6))
    m.close("tip", "far", xz(0.1, 0.6))


def _planar_platform(name: str, leg: Callable[[Telling, int, np.ndarray, np.ndarray, str], None]) -> None:
    feet = [xz(0, 0), xz(1, 0), xz(0.5, 0.8)]
    heads = [xz(0.4, 0.2), xz(0.6, 0.25), xz(0.45, 0.4)]

    def tell(m: Telling) -> None:
        for k, (foot, head) in enumerate(zip(feet, heads, strict=True)):
            leg(m, k, foot, head, "table")
        m.tip("table", xz(0.5, 0.3))

    MAKERS[name] = tell


def _ended(m: Telling, k: int, last: str, head: np.ndarray) -> None:
    """End a leg: the first carries the table, the others close a loop there."""
    if k:
        m.close(last, "table", head)
    else:
        m.r(last, "table", head)


def _rrr(m: Telling, k: int, foot: np.ndarray, head: np.ndarray, table: str) -> None:
    elbow = meet(foot, 0.35, head, 0.3)
    m.r("base", f"upper{k}", foot, motor=True)
    m.r(f"upper{k}", f"lower{k}", elbow)
    _ended(m, k, f"lower{k}", head)


def _rpr(m: Telling, k: int, foot: np.ndarray, head: np.ndarray, table: str) -> None:
    m.r("base", f"cylinder{k}", foot)
    m.p(f"cylinder{k}", f"piston{k}", head, head - foot, motor=True)
    _ended(m, k, f"piston{k}", head)


def _prr(m: Telling, k: int, foot: np.ndarray, head: np.ndarray, table: str) -> None:
    m.p("base", f"slider{k}", foot, about(Y, 2.1 * k) @ (X + 0.2 * Z), motor=True)
    m.r(f"slider{k}", f"rod{k}", foot)
    _ended(m, k, f"rod{k}", head)


_planar_platform("planar_3rrr", _rrr)
_planar_platform("planar_3rpr", _rpr)
_planar_platform("planar_3prr", _prr)


# Single spatial loops of hinges: a list of lines, each a point and a direction.
Line = tuple[np.ndarray, np.ndarray]


def _ring(name: str, lines: list[Line], motors: int = 1) -> None:
    def tell(m: Telling) -> None:
        last = "base"
        for k, (point, axis) in enumerate(lines[:-1]):
            m.r(last, f"l{k + 1}", point, axis, motor=k < motors)
            last = f"l{k + 1}"
        half = f"l{len(lines) // 2}"
        m.tip(half, np.round(m.origin[half] + [0.1, 0.05, 0.1], 3))
        m.close(last, "base", np.asarray(lines[-1][0], dtype=float), lines[-1][1])

    MAKERS[name] = tell


def _corner(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> Line:
    """Line at a corner of a skew polygon, at right angles to both sides."""
    return here, unit(np.cross(before - here, after - here))


# Any skew quadrilateral with equal opposite sides, hinged at right angles to its sides, is a Bennett linkage: its faces
# are congruent in pairs, and the law of sines of the tetrahedron is Bennett's sin(alpha) / a = sin(beta) / b.
_A, _B = np.array([0.5, 0, 0]), np.array([0.1, 0.6, 0.3])
_C, _D = _A * [-1, -1, 1], _B * [-1, -1, 1]
_ring("bennett", [_corner(_D, _A, _B), _corner(_A, _B, _C), _corner(_B, _C, _D), _corner(_C, _D, _A)])


def _goldberg() -> list[Line]:
    """Two Bennett loops on one side CD; the bars next to C made one, the side left out."""
    (c, n_c), (d, n_d) = _corner(_B, _C, _D), _corner(_C, _D, _A)
    a, b, side = np.linalg.norm(d - c), 0.45, unit(d - c)
    e = c + b * about(n_c, -1.9) @ side
    # F stands on the circle of radius b about the hinge at D, at the distance a from E.
    u, w = side, np.cross(n_d, side)
    x, y, rest = b * u @ (d - e), b * w @ (d - e), (a**2 - b**2 - (d - e) @ (d - e)) / 2
    turn = np.arctan2(y, x) + np.arccos(rest / np.hypot(x, y))
    f = d + b * (np.cos(turn) * u + np.sin(turn) * w)
    return [_corner(_D, _A, _B), _corner(_A, _B, _C), _corner(c, e, f), _corner(e, f, d), (d, n_d)]


_ring("goldberg_5r", _goldberg())

_LINES: list[Line] = [
    (np.array([0.5, 0.1, 0.0]), np.array([0.2, 0.9, 0.4])),
    (np.array([0.3, 0.5, 0.2]), np.array([0.7, -0.3, 0.6])),
    (np.array([-0.1, 0.6, 0.5]), np.array([-0.3, 0.5, 0.8])),
]
_HALF_TURN = np.array([-1.0, -1.0, 1.0])
_MIRROR = np.array([1.0, -1.0, 1.0])
_ring("bricard_line_symmetric", _LINES + [(p * _HALF_TURN, n * _HALF_TURN) for p, n in _LINES])
_ring(
    "bricard_plane_symmetric",
    [
        (np.array([0.6, 0, 0.1]), np.array([0.3, 0, 0.9])),
        (_LINES[1][0], _LINES[1][1]),
        (_LINES[2][0], _LINES[2][1]),
        (np.array([-0.6, 0, 0.2]), np.array([0.8, 0, 0.5])),
        (_LINES[2][0] * _MIRROR, _LINES[2][1] * _MIRROR),
        (_LINES[1][0] * _MIRROR, _LINES[1][1] * _MIRROR),
    ],
)


def _trihedral() -> list[Line]:
    """Odd hinges in three planes through z at 120°, even ones in the planes between: neighbours at right angles."""
    lines: list[Line] = []
    for k in range(6):
        turn = about(Z, np.pi / 3 * k)
        # Directions (1, 0, 1) and (-2, 0, 1) before turning: cos 60° · 1 · (-2) + 1 · 1 = 0.
        lines.append(
            (turn @ ([0.5, 0, 0.1] if k % 2 else [0.4, 0, 0]), turn @ ([-2, 0, 1] if k % 2 else [1, 0, 1]))
        )
    return lines


_ring("bricard_trihedral", _trihedral())
_ring(
    "sarrus",
    [
        (np.array([0.5, 0, 0]), Y),
        (np.array([0.7, 0, 0.3]), Y),
        (np.array([0.5, 0, 0.6]), Y),
        (np.array([0, 0.5, 0.6]), X),
        (np.array([0, 0.75, 0.3]), X),
        (np.array([0, 0.5, 0]), X),
    ],
)
_O, _Q = np.zeros(3), np.array([0.8, 0.1, 0.2])
_ring(
    "spherical_4r",
    [
        (_O, X),
        (_O, np.array([0.8, 0.6, 0.0])),
        (_O, np.array([0.3, 0.6, 0.8])),
        (_O, np.array([0.2, -0.3, 1.0])),
    ],
)
_ring(
    "spherical_5r",
    [
        (_O, X),
        (_O, np.array([0.8, 0.6, 0.0])),
        (_O, np.array([0.3, 0.6, 0.8])),
        (_O, np.array([-0.5, 0.4, 0.7])),
        (_O, np.array([0.2, -0.3, 1.0])),
    ],
    motors=2,
)
_ring("cardan_shaft", [(_O, X), (_O, Y), (_O, Z), (_O, np.array([0.8, 0.6, 0.0]))])
_ring(
    "double_spherical_6r",
    [
        (_O, X),
        (_O, np.array([0.8, 0.6, 0.3])),
        (_O, Z),
        (_Q, np.array([0.1, 1.0, 0.2])),
        (_Q, X + Z),
        (_Q, X - 0.4 * Y),
    ],
)
_ring(
    "plano_spherical_6r",
    [
        (np.array([0.0, 0.1, 0.0]), Y),
        (np.array([0.2, 0.0, 0.4]), Y),
        (np.array([0.7, 0.2, 0.5]), Y),
        (_Q, np.array([0.9, 0.3, 0.1])),
        (_Q, np.array([0.2, 0.3, 1.0])),
        (_Q, np.array([-0.5, 0.9, 0.3])),
    ],
)


@mechanism
def double_cardan(m: Telling) -> None:
    a, b = np.zeros(3), np.array([0.6, 0.2, 0.1])
    along = unit(b - a)
    across = unit(np.cross(along, Y))
    m.r("base", "input", a, X, motor=True)
    m.r("input", "cross1", a, Y)
    m.r("cross1", "shaft", a, np.cross(Y, along))
    m.p("shaft", "sleeve", 0.5 * (a + b), along)
    m.r("base", "output", b, X + 0.3 * Y)
    m.tip("output", b + 0.1 * X)
    m.close("sleeve", "output", b, across, "universal", np.cross(across, X + 0.3 * Y))


def _spatial_four_bar(name: str, tell: Callable[[Telling, np.ndarray, np.ndarray], None]) -> None:
    MAKERS[name] = lambda m: tell(m, np.array([0, 0.2, 0.3]), np.array([0.9, 0.5, 0.4]))


def _rssr(m: Telling, a: np.ndarray, b: np.ndarray) -> None:
    m.r("base", "crank", np.zeros(3), X, motor=True)
    m.r("base", "rocker", np.array([0.8, 0, 0]), np.array([0.2, 0.4, 1]))
    m.s("crank", "rod", a)
    m.tip("rocker", b)
    m.close("rod", "rocker", b, kind="spherical")


def _rssp(m: Telling, a: np.ndarray, b: np.ndarray) -> None:
    m.r("base", "crank", np.zeros(3), X, motor=True)
    m.p("base", "slider", b, np.array([1, 0.2, 0.1]))
    m.s("crank", "rod", a)
    m.tip("slider", b)
    m.close("rod", "slider", b, kind="spherical")


def _rscr(m: Telling, a: np.ndarray, b: np.ndarray) -> None:
    m.r("base", "crank", np.zeros(3), X, motor=True)
    m.r("base", "rocker", np.array([0.8, 0, 0]), np.array([0.2, 0.4, 1]))
    m.s("crank", "rod", a)
    m.tip("rocker", b)
    m.close("rod", "rocker", b, np.array([0.7, 0.1, 0.6]), "cylindrical")


def _rccc(m: Telling, a: np.ndarray, b: np.ndarray) -> None:
    m.r("base", "crank", np.zeros(3), X, motor=True)
    axis = np.array([0.3, 1, 0.2])
    m.r("crank", "sleeve", a, axis, massless=True)
    m.p("sleeve", "rod", a, axis)
    axis = np.array([0.2, 0.4, 1])
    m.r("base", "sleeve2", np.array([0.8, 0, 0]), axis, massless=True)
    m.p("sleeve2", "rocker", np.array([0.8, 0, 0]), axis)
    m.tip("rocker", b)
    m.close("rod", "rocker", b, np.array([0.7, 0.1, 0.6]), "cylindrical")


for _name, _tell in {"rssr": _rssr, "rssp": _rssp, "rscr": _rscr, "rccc": _rccc}.items():
    _spatial_four_bar(_name, _tell)


@mechanism
def planetary_gear(m: Telling) -> None:
    # Sun 20, planet 16, ring 52 teeth; planet and sun are told from the carrier.
    m.r("base", "carrier", xz(0, 0))
    m.r("carrier", "planet", xz(0.36, 0))
    m.r("carrier", "sun", xz(0, 0), motor=True)
    m.tip("carrier", xz(0.36, 0.1))
    m.gear("planet", "carrier", -52 / 16)
    m.gear("sun", "planet", -16 / 20)


@mechanism
def bevel_differential(m: Telling) -> None:
    m.r("base", "case", xz(0, 0), motor=True)
    m.r("case", "spider", xz(0.1, 0), X, motor=True)
    m.r("case", "left", xz(0, 0))
    m.r("case", "right", xz(0, 0))
    m.tip("left", np.array([0, 0.2, 0.1]))
    m.gear("left", "spider", 0.8)
    m.gear("right", "spider", -0.8)


@mechanism
def rack_and_pinion(m: Telling) -> None:
    m.r("base", "pinion", xz(0, 0), motor=True)
    m.p("base", "rack", xz(0, -0.2), X)
    m.r("rack", "rod", xz(0.2, -0.2))
    m.r("base", "flap", xz(0.9, 0))
    m.tip("flap", xz(0.8, 0.5))
    m.gear("rack", "pinion", -0.2)
    m.close("rod", "flap", xz(0.8, 0.3))


@mechanism
def screw_jack(m: Telling) -> None:
    # A car jack: a screw between the side corners of a rhombus.
    left, right, top = xz(-0.3, 0.2), xz(0.3, 0.2), xz(0, 0.4)
    m.r("base", "arm1", xz(0, 0))
    m.r("base", "arm2", xz(0, 0))
    m.r("arm1", "nut", left)
    m.r("nut", "screw", left, X, motor=True)
    m.p("nut", "tube", right, X)
    m.r("arm1", "arm3", left)
    m.r("arm2", "arm4", right)
    m.tip("arm3", top)
    m.gear("arm2", "arm1", -1.0)  # toothed feet keep it upright
    m.gear("tube", "screw", 0.05)
    m.close("tube", "arm2", right)
    m.close("arm3", "arm4", top)


@mechanism
def door_on_two_hinges(m: Telling) -> None:
    m.r("base", "door", np.array([0, 0, 0.2]), Z + 0.1 * X, motor=True)
    m.tip("door", np.array([0.8, 0, 1]))
    m.close("door", "base", np.array([0.15, 0, 1.7]), Z + 0.1 * X)


# Spatial platforms: the first leg carries the table where it may, the others close loops there.


def _around(radius: float, height: float, angle: float, k: int, count: int = 3) -> np.ndarray:
    turn = angle + 2 * np.pi * k / count
    return np.array([radius * np.cos(turn), radius * np.sin(turn), height])


def _tangent(point: np.ndarray) -> np.ndarray:
    return unit(np.cross(Z, point))


@mechanism
def tripod_3prs(m: Telling) -> None:
    for k in range(3):
        foot, head = _around(0.5, 0, 0, k), _around(0.3, 0.6, 0, k)
        m.p("base", f"slider{k}", foot, Z, motor=True)
        m.r(f"slider{k}", f"rod{k}", foot, _tangent(foot))
        if k:
            m.close(f"rod{k}", "table", head, kind="spherical")
        else:
            m.s("rod0", "table", head)
    m.tip("table", np.array([0, 0, 0.65]))


@mechanism
def translating_3puu(m: Telling) -> None:
    for k in range(3):
        # Between hinges that are tangents at foot and head, parallel in every leg.
        foot, head = _around(0.5, 0, 0.1, k), _around(0.25, 0.6, 0.1, k)
        outer = _tangent(foot)
        inner = np.cross(outer, head - foot)
        m.p("base", f"slider{k}", foot, Z, motor=True)
        m.u(f"slider{k}", f"leg{k}", foot, outer, inner)
        if k:
            m.close(f"leg{k}", "table", head, inner, "universal", outer)
        else:
            m.u("leg0", "table", head, inner, outer)
    m.tip("table", np.array([0, 0, 0.65]))


@mechanism
def schoenflies_4puu(m: Telling) -> None:
    for k in range(4):
        # Rods that all lean the same way would not hold the table against screws about z.
        foot, head = _around(0.6, 0, 0.3, k, 4), _around(0.25, 0.5, 0.3 + 0.5 * (-1) ** k, k, 4)
        slide = _tangent(foot)
        inner = unit(np.cross(Z, head - foot))
        m.p("base", f"slider{k}", foot, slide + 0.5 * Z, motor=True)
        m.u(f"slider{k}", f"rod{k}", foot, Z, inner)
        if k:
            m.close(f"rod{k}", "table", head, inner, "universal", Z)
        else:
            m.u("rod0", "table", head, inner, Z)
    m.tip("table", np.array([0, 0, 0.55]))


@mechanism
def tricept(m: Telling) -> None:
    m.u("base", "tube", np.zeros(3), X, Y)
    m.p("tube", "table", np.array([0, 0, 0.6]), Z)
    m.tip("table", np.array([0, 0, 0.8]))
    for k in range(3):
        foot, head = _around(0.5, 0, 0.4, k), _around(0.2, 0.6, 0.4, k)
        m.u("base", f"cylinder{k}", foot, _tangent(foot), np.cross(_tangent(foot), head - foot))
        m.p(f"cylinder{k}", f"piston{k}", head, head - foot, motor=True)
        m.close(f"piston{k}", "table", head, kind="spherical")


@mechanism
def exechon(m: Telling) -> None:
    feet = [np.array(x) for x in ([-0.5, 0, 0], [0.5, 0, 0], [0, 0.5, 0])]
    heads = [np.array(x) for x in ([-0.2, 0, 0.6], [0.2, 0, 0.6], [0, 0.25, 0.6])]
    for k in range(2):
        # Both base hinges on one line, the others at right angles to the plane of the two legs.
        m.u("base", f"cylinder{k}", feet[k], X, Y)
        m.p(f"cylinder{k}", f"piston{k}", heads[k], heads[k] - feet[k], motor=True)
    m.r("piston0", "table", heads[0], Y)
    m.close("piston1", "table", heads[1], Y)
    m.r("table", "piston2", heads[2], X)
    m.p("piston2", "cylinder2", feet[2], heads[2] - feet[2], motor=True)
    m.close("cylinder2", "base", feet[2], kind="spherical")
    m.tip("table", np.array([0, 0, 0.7]))


def _hexapod(name: str, leg: Callable[[Telling, int, np.ndarray, np.ndarray], str]) -> None:
    def tell(m: Telling) -> None:
        m.joint("floating", "base", "table", np.array([0, 0, 0.6]))
        m.moving.pop()
        m.tip("table", np.array([0, 0, 0.7]))
        for k in range(6):
            side = -1 if k % 2 else 1
            foot = _around(0.5, 0, 0.2 * side, k // 2)
            head = _around(0.3, 0.6, (np.pi / 3 - 0.2) * side, k // 2)
            m.close(leg(m, k, foot, head), "table", head, kind="spherical")

    MAKERS[name] = tell


def _ups(m: Telling, k: int, foot: np.ndarray, head: np.ndarray) -> str:
    m.u("base", f"cylinder{k}", foot, _tangent(foot), np.cross(_tangent(foot), head - foot))
    m.p(f"cylinder{k}", f"piston{k}", head, head - foot, motor=True)
    return f"piston{k}"


def _sps(m: Telling, k: int, foot: np.ndarray, head: np.ndarray) -> str:
    m.s("base", f"cylinder{k}", foot)
    m.p(f"cylinder{k}", f"piston{k}", head, head - foot, motor=True)
    return f"piston{k}"


for _name, _leg in {"gough_6ups": _ups, "gough_6sps": _sps}.items():
    _hexapod(_name, _leg)


def _parallelogram(m: Telling, name: str, last: str, foot, head, tangent, width: float) -> str:
    """Hang two bars side by side between two yokes that swing about the tangent; answer the lower yoke."""
    normal = np.cross(tangent, head - foot)
    m.r(last, f"{name}_yoke", foot, tangent)
    for bar, side in (("a", 1), ("b", -1)):
        m.r(f"{name}_yoke", f"{name}_{bar}", foot + side * width * tangent, normal)
    m.r(f"{name}_a", f"{name}_end", head + width * tangent, normal)
    m.close(f"{name}_b", f"{name}_end", head - width * tangent, normal)
    return f"{name}_end"


def _parallelogram_robot(
    name: str, driver: Callable[[Telling, int], tuple[str, np.ndarray, np.ndarray, np.ndarray]]
):
    def tell(m: Telling) -> None:
        for k in range(3):
            last, foot, head, tangent = driver(m, k)
            end = _parallelogram(m, f"arm{k}", last, foot, head, tangent, 0.05)
            if k:
                m.close(end, "table", head, tangent)
            else:
                m.r(end, "table", head, tangent)
        m.tip("table", np.round(m.origin["table"], 3))

    MAKERS[name] = tell


def _delta_leg(m: Telling, k: int) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    shoulder, elbow, head = _around(0.2, 0, 0, k), _around(0.4, -0.1, 0, k), _around(0.1, -0.6, 0, k)
    m.r("base", f"crank{k}", shoulder, _tangent(shoulder), motor=True)
    return f"crank{k}", elbow, head, _tangent(shoulder)


def _orthoglide_leg(m: Telling, k: int) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    axes = (X, Y, Z)
    along, tangent = axes[k], axes[(k + 1) % 3]
    m.p("base", f"slider{k}", -0.7 * along, along, motor=True)
    return f"slider{k}", -0.7 * along, -0.1 * along, tangent


_parallelogram_robot("delta_hinges", _delta_leg)
_parallelogram_robot("orthoglide", _orthoglide_leg)


@mechanism
def ankle_2spu(m: Telling) -> None:
    m.u("base", "foot", np.zeros(3), Y, X)
    m.tip("foot", np.array([0.1, 0, -0.1]))
    for k, side in enumerate((1, -1)):
        hip, heel = np.array([-0.1, 0.08 * side, 0.4]), np.array([-0.12, 0.06 * side, 0.02])
        m.u("base", f"cylinder{k}", hip, Y, np.cross(Y, heel - hip))
        m.p(f"cylinder{k}", f"piston{k}", heel, heel - hip, motor=True)
        m.close(f"piston{k}", "foot", heel, kind="spherical")


@mechanism
def double_wishbone(m: Telling) -> None:
    lower, upper, rack, arm = (
        np.array(x) for x in ([0, 0.5, 0], [0, 0.45, 0.3], [0.15, 0.1, 0.1], [0.15, 0.48, 0.1])
    )
    m.r("base", "lower", np.array([0, 0.1, 0]), X, motor=True)
    m.r("base", "upper", np.array([0, 0.15, 0.25]), np.array([1, 0, 0.05]))
    m.s("lower", "upright", lower)
    m.close("upper", "upright", upper, kind="spherical")
    m.u("base", "tie_rod", rack, X, Z)
    m.close("tie_rod", "upright", arm, kind="spherical")
    m.tip("upright", np.array([0, 0.6, 0.15]))


def main() -> None:
    folder = Path(__file__).parent / "urdf"
    folder.mkdir(exist_ok=True)
    for name, tell in MAKERS.items():
        m = Telling(name)
        tell(m)
        m.write(folder)
    for name, tell_robot in ROBOT_MAKERS.items():
        told = RobotTelling(name)
        tell_robot(told)
        told.write(urdf_root())


if __name__ == "__main__":
    main()
