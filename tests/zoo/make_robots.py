"""Write the bundled robots that have a row in the table: ``python -m tests.zoo.make``. Metres and kilograms."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from tests.zoo.robot_telling import BLUE, GREEN, ORANGE, STEEL, RobotTelling, leg_axes
from tests.zoo.telling import X, Y, Z, about, unit, xz

ROBOT_MAKERS: dict[str, Callable[[RobotTelling], None]] = {}
CENTRE = np.zeros(3)
THIRDS = 2 * np.pi / 3 * np.arange(3)


def robot(tell: Callable[[RobotTelling], None]) -> Callable[[RobotTelling], None]:
    ROBOT_MAKERS[tell.__name__] = tell
    return tell


def around(radius: float, height: float, angle: float) -> np.ndarray:
    return np.array([radius * np.cos(angle), radius * np.sin(angle), height])


@robot
def slider_crank(m: RobotTelling) -> None:
    crank, rod, angle = 0.05, 0.2, np.pi / 3
    pin = crank * xz(np.cos(angle), np.sin(angle))
    wrist = xz(pin[0] + np.sqrt(rod**2 - pin[2] ** 2), 0)
    m.box("base", (0.19, 0, -0.05), (0.5, 0.08, 0.02), 0, STEEL)
    m.disc("base", (0, 0.02, 0), Y, 0.02, 0.02, 0, STEEL)
    m.r("crank_motor", "base", "crank", CENTRE, -Y, home=angle, motor=(5.0, 100.0))
    m.disc("crank", CENTRE, Y, 0.065, 0.01, 1.0, BLUE)
    m.bar("crank", pin, pin - 0.02 * Y, 0.008, 0.05, BLUE)
    m.r("crank_pin", "crank", "rod", pin, Y)
    m.bar("rod", pin - 0.015 * Y, wrist - 0.015 * Y, 0.007, 0.15)
    m.p("piston", "base", "platform", wrist, X, home=wrist[0], range=(0.14, 0.26))
    m.disc("platform", wrist, X, 0.03, 0.05, 0.4, GREEN)
    m.close("wrist_pin", "rod", "platform", wrist, "revolute", Y)


@robot
def scissor_lift(m: RobotTelling) -> None:
    # Bars of 1 m that rise by three in four; the drive pulls the sliding feet inwards.
    bar, foot, rise = 1.0, 0.8, 0.6
    m.box("base", (0.5, 0, -0.04), (1.1, 0.6, 0.04), 0, STEEL)
    m.p("drive", "base", "slider", (foot, 0, 0), -X, home=bar - foot, motor=(2e4, 0.05), range=(0.02, 0.6))
    m.box("slider", (foot, 0, 0), (0.08, 0.5, 0.04), 8.0, BLUE)
    ends = {"a1": (0, foot, 0), "b1": (foot, 0, 0), "a2": (0, foot, 1), "b2": (foot, 0, 1)}
    parents = {"a1": "base", "b1": "slider", "a2": "b1", "b2": "a1"}
    for name, (begin, end, level) in ends.items():
        low, high = xz(begin, level * rise), xz(end, (level + 1) * rise)
        m.r(f"hinge_{name}", parents[name], name, low, -Y)
        aside = (0.22 if name in ("a1", "b2") else 0.18) * Y
        for side in (-aside, aside):
            m.bar(name, low + side, high + side, 0.02, 4.0)
    for level in (0, 1):
        m.close(
            f"pin{level + 1}",
            f"a{level + 1}",
            f"b{level + 1}",
            xz(foot / 2, (level + 0.5) * rise),
            "revolute",
            Y,
        )
    m.r("table_hinge", "b2", "platform", xz(0, 2 * rise), -Y)
    m.box("platform", (0.5, 0, 2 * rise + 0.04), (1.1, 0.6, 0.04), 30.0, GREEN)
    m.p("table_slide", "platform", "shoe", xz(foot, 2 * rise), X, home=foot, range=(0.3, 1.0))
    m.box("shoe", (foot, 0, 2 * rise), (0.08, 0.5, 0.03), 4.0)
    m.close("shoe_pin", "a2", "shoe", xz(foot, 2 * rise), "revolute", Y)


def _arc(
    m: RobotTelling, link: str, a: np.ndarray, b: np.ndarray, radius: float, mass: float, colour: str
) -> None:
    """Bend a bar along the great circle between two directions, as four chords."""
    normal, angle = np.cross(a, b), np.arccos(np.clip(a @ b, -1, 1))
    points = [radius * about(normal, angle * k / 4) @ a for k in range(5)]
    for p, q in pairwise(points):
        m.bar(link, p, q, 0.006, mass / 4, colour)
    for p, direction in ((points[0], a), (points[-1], b)):
        m.bar(link, p - 0.012 * direction, p + 0.012 * direction, 0.01, 0.02, colour)


@robot
def agile_eye(m: RobotTelling) -> None:
    outer, inner = 0.12, 0.095
    axes = (X, Y, Z)
    for k in range(3):
        base, middle, end = (axes[(k + n) % 3] for n in range(3))
        m.bar("base", -0.17 * base, -0.125 * base, 0.025, 0, STEEL)
        m.r(f"motor{k + 1}", "base", f"proximal{k + 1}", CENTRE, base, motor=(2.0, 20.0), range=(-2.0, 2.0))
        _arc(m, f"proximal{k + 1}", -base, middle, outer, 0.12, BLUE)
        m.r(f"elbow{k + 1}", f"proximal{k + 1}", f"distal{k + 1}", CENTRE, middle)
        _arc(m, f"distal{k + 1}", middle, end, inner, 0.1, ORANGE)
        if k:
            m.close(f"wrist{k + 1}", f"distal{k + 1}", "platform", CENTRE, "revolute", end)
        else:
            m.r("wrist1", "distal1", "platform", CENTRE, end)
    looking = unit(X + Y + Z)
    m.bar("platform", -0.03 * looking, 0.05 * looking, 0.028, 0.25, GREEN)
    for end in axes:
        m.bar("platform", 0.02 * end, 0.085 * end, 0.006, 0.02, GREEN)


def _telescope(m: RobotTelling, k: int, parent: str, foot, head, stroke, masses) -> None:
    """Enter the slide of a leg whose coordinate is its length."""
    length, along = float(np.linalg.norm(head - foot)), unit(head - foot)
    m.p(f"leg{k}", parent, f"leg{k}_upper", head, along, home=length, motor=(2e3, 0.5), range=stroke)
    m.bar(parent, foot, foot + 0.8 * stroke[0] * along, 0.03, masses[0], BLUE)
    m.bar(f"leg{k}_upper", head, head - 0.8 * stroke[0] * along, 0.015, masses[1])


@robot
def three_rps(m: RobotTelling) -> None:
    base, top, height = 0.5, 0.3, 0.6
    m.disc("base", (0, 0, -0.04), Z, 0.55, 0.03, 0, STEEL)
    m.free("platform", height * Z)
    m.disc("platform", height * Z, Z, 0.33, 0.03, 10.0, GREEN)
    for k, angle in enumerate(THIRDS, start=1):
        foot, head = around(base, 0, angle), around(top, height, angle)
        m.r(f"leg{k}_hinge", "base", f"leg{k}_lower", foot, leg_axes(foot, head)[0])
        _telescope(m, k, f"leg{k}_lower", foot, head, (0.45, 0.85), (3.0, 1.5))
        m.close(f"leg{k}_ball", "platform", f"leg{k}_upper", head)


@robot
def tripod_3upu(m: RobotTelling) -> None:
    base, top, height = 0.5, 0.25, 0.6
    m.disc("base", (0, 0, -0.04), Z, 0.55, 0.03, 0, STEEL)
    m.free("platform", height * Z)
    m.disc("platform", height * Z, Z, 0.28, 0.03, 8.0, GREEN)
    for k, angle in enumerate(THIRDS, start=1):
        foot, head = around(base, 0, angle), around(top, height, angle)
        outer, inner = leg_axes(foot, head)
        m.u(f"leg{k}", "base", f"leg{k}_lower", foot, outer, inner)
        _telescope(m, k, f"leg{k}_lower", foot, head, (0.45, 0.85), (3.0, 1.5))
        m.close(f"leg{k}_head", f"leg{k}_upper", "platform", head, "universal", inner, outer)


@robot
def three_rrs(m: RobotTelling) -> None:
    base, top, crank, rod = (0.0254 * inches for inches in (2.0, 3.125, 1.75, 3.669291339))
    angle = np.pi / 6
    m.disc("base", (0, 0, -0.02), Z, 0.06, 0.01, 0, STEEL)
    out = base + crank * np.cos(angle)
    height = crank * np.sin(angle) + np.sqrt(rod**2 - (out - top) ** 2)
    m.free("platform", height * Z)
    m.disc("platform", (0, 0, height + 0.006), Z, 0.11, 0.006, 0.25, GREEN)
    for k, turn in enumerate(THIRDS, start=1):
        hip, head = around(base, 0, turn), around(top, height, turn)
        knee = around(out, crank * np.sin(angle), turn)
        tangent = np.cross(unit(hip), Z)  # positive angles lift the knee
        m.disc("base", hip - 0.02 * tangent, tangent, 0.018, 0.025, 0, STEEL)
        m.r(f"motor{k}", "base", f"crank{k}", hip, tangent, home=angle, motor=(0.5, 10.0), range=(-0.6, 1.5))
        m.bar(f"crank{k}", hip, knee, 0.006, 0.03, BLUE)
        m.r(f"knee{k}", f"crank{k}", f"rod{k}", knee, tangent)
        m.bar(f"rod{k}", knee, head, 0.004, 0.03)
        m.close(f"ball{k}", "platform", f"rod{k}", head)


@robot
def ankle_2rss(m: RobotTelling) -> None:
    lever, half = 0.12, 0.06
    m.bar("base", (0, 0, 0.04), (0, 0, 0.55), 0.03, 0, STEEL)
    m.r("pitch", "base", "cross", CENTRE, Y, range=(-0.9, 0.9))
    m.bar("cross", (0, -0.03, 0), (0, 0.03, 0), 0.01, 0.1)
    m.r("roll", "cross", "platform", CENTRE, X, range=(-0.5, 0.5))
    m.box("platform", (0.04, 0, -0.06), (0.26, 0.1, 0.03), 0.9, GREEN)
    m.bar("platform", CENTRE, (0, 0, -0.05), 0.02, 0.2, GREEN)
    m.bar("platform", (-lever, -half, 0), (-lever, half, 0), 0.008, 0.1, GREEN)
    m.bar("platform", (-lever, 0, 0), (0, 0, -0.04), 0.01, 0.1, GREEN)
    for k, (side, height) in enumerate(((1, 0.49), (-1, 0.37)), start=1):
        hip, knee, heel = (
            np.array([x, side * half, z]) for x, z in ((0, height), (-lever, height), (-lever, 0))
        )
        m.disc("base", hip - 0.02 * side * Y, Y, 0.045, 0.04, 0, STEEL)
        # At zero the crank points back, level; positive angles lift its end, the heel with it.
        m.r(f"motor{k}", "base", f"crank{k}", hip, Y, motor=(60.0, 12.0), range=(-1.3, 1.3))
        m.bar(f"crank{k}", hip, knee, 0.012, 0.25, BLUE)
        m.ball(f"rod{k}", f"crank{k}", f"rod{k}", knee, heel - knee, Y)
        m.bar(f"rod{k}", knee, heel, 0.006, 0.15)
        m.close(f"heel{k}", "platform", f"rod{k}", heel)


def _pair_of_rods(m: RobotTelling, k: int, last: str, top, bottom, tangent, half, size, body: str) -> None:
    """Hang two rods side by side, with a ball at either end; they make a parallelogram."""
    for name, side in (("a", half), ("b", -half)):
        rod, high, low = f"rod{k}{name}", top + side * tangent, bottom + side * tangent
        m.ball(rod, last, rod, high, low - high, tangent)
        m.bar(rod, high, low, *size)
        m.close(f"{rod}_ball", body, rod, low)


@robot
def linear_delta(m: RobotTelling) -> None:
    # Rods and their reach at the middle are those of the printer, the split of the reach and all else are not.
    rod, reach, top, height, half = 0.268, 0.1344, 0.03, 0.1, 0.0225
    rise = np.sqrt(rod**2 - reach**2)
    m.disc("base", (0, 0, -0.01), Z, 0.12, 0.01, 0, STEEL)
    m.free("platform", height * Z)
    m.disc("platform", height * Z, Z, 0.034, 0.008, 0.12, GREEN)
    m.bar("platform", height * Z, (height - 0.03) * Z, 0.008, 0.03, GREEN)
    for k, angle in enumerate(np.radians([210, 330, 90]), start=1):
        out, tangent = around(1, 0, angle), around(1, 0, angle + np.pi / 2)
        high, low = (reach + top) * out + (height + rise) * Z, top * out + height * Z
        m.bar("base", 0.19 * out - 0.01 * Z, 0.19 * out + 0.62 * Z, 0.008, 0, STEEL)
        m.p(
            f"motor{k}", "base", f"carriage{k}", high, Z,
            home=height + rise, motor=(80.0, 0.5), range=(0.2, 0.55),
        )  # fmt: skip
        m.box(f"carriage{k}", high + 0.02 * out, (0.03, 0.04, 0.04), 0.1, BLUE, about(Z, angle))
        m.bar(f"carriage{k}", high - half * tangent, high + half * tangent, 0.004, 0.01, BLUE)
        _pair_of_rods(m, k, f"carriage{k}", high, low, tangent, half, (0.003, 0.015), "platform")


@robot
def par4(m: RobotTelling) -> None:
    # Two parts of the plate keep their directions, each held by two chains; the links between them turn.
    base, crank, rod, half = 0.275, 0.375, 0.825, 0.05
    along, across, corner, angle = 0.08, 0.1, 0.12, np.pi / 6
    reach = base + crank * np.cos(angle) - np.sqrt(2) * corner
    height = -crank * np.sin(angle) - np.sqrt(rod**2 - reach**2)
    m.disc("base", (0, 0, 0.05), Z, 0.3, 0.02, 0, STEEL)
    m.free("platform", along * X + height * Z)
    ends = {(x, y): np.array([along * x, across * y, height]) for x in (1, -1) for y in (1, -1)}
    m.bar("platform", ends[1, 1], ends[1, -1], 0.012, 0.1, GREEN)
    m.bar("platform", along * X + height * Z, along * X + (height - 0.08) * Z, 0.012, 0.1, GREEN)
    for part, y in (("front", 1), ("back", -1)):
        m.r(f"{part}_hinge", "platform", part, ends[1, y], Z)
        m.bar(part, ends[1, y] + 0.03 * X, ends[-1, y] - 0.03 * X, 0.012, 0.15)
    m.r("link_hinge", "front", "link", ends[-1, 1], Z)
    m.bar("link", ends[-1, 1], ends[-1, -1], 0.012, 0.1)
    m.close("plate_hinge", "link", "back", ends[-1, -1], "revolute", Z)
    for k, turn in enumerate(np.radians([45, 135, 225, 315]), start=1):
        out, tangent = around(1, 0, turn), around(1, 0, turn + np.pi / 2)
        hip, low = base * out, np.sqrt(2) * corner * out + height * Z
        knee = hip + crank * (np.cos(angle) * out - np.sin(angle) * Z)
        part = "front" if k < 3 else "back"
        m.disc("base", hip, tangent, 0.04, 0.08, 0, STEEL)
        # Positive angles turn down, which pushes the plate away.
        m.r(f"motor{k}", "base", f"crank{k}", hip, tangent, home=angle, motor=(60.0, 20.0), range=(-0.8, 1.5))
        m.bar(f"crank{k}", hip, knee, 0.02, 0.5, BLUE)
        m.bar(f"crank{k}", knee - half * tangent, knee + half * tangent, 0.008, 0.05, BLUE)
        m.bar(part, low - half * tangent, low + half * tangent, 0.008, 0.05)
        m.bar(part, low, np.array([along * np.sign(low[0]), across * np.sign(low[1]), height]), 0.008, 0.02)
        _pair_of_rods(m, k, f"crank{k}", knee, low, tangent, half, (0.006, 0.06), part)


@robot
def hexaglide(m: RobotTelling) -> None:
    # Six sledges on parallel rails, mirrored left and right: of each side two before the platform, one behind it.
    rod, height, top = 0.6, 0.4, 0.16
    rails, before, heads = (0.35, 0.25, 0.05), (1, 1, -1), np.radians([10, 130, 90])
    m.free("platform", CENTRE)
    m.disc("platform", CENTRE, Z, 0.18, 0.02, 6.0, GREEN)
    legs = [
        (side * y, x, side * turn)
        for side in (1, -1)
        for y, x, turn in zip(rails, before, heads, strict=True)
    ]
    for k, (y, side, turn) in enumerate(legs, start=1):
        head = around(top, 0, turn)
        foot = np.array([head[0] + side * np.sqrt(rod**2 - height**2 - (y - head[1]) ** 2), y, height])
        m.bar("base", (-0.9, y, height + 0.05), (0.9, y, height + 0.05), 0.01, 0, STEEL)
        m.p(f"motor{k}", "base", f"sledge{k}", foot, X, home=foot[0], motor=(500.0, 2.0), range=(-0.9, 0.9))
        m.box(f"sledge{k}", foot + 0.02 * Z, (0.08, 0.05, 0.03), 1.5, BLUE)
        m.u(f"rod{k}", f"sledge{k}", f"rod{k}", foot, Y, np.cross(Y, head - foot))
        m.bar(f"rod{k}", foot, head, 0.008, 0.5)
        m.close(f"ball{k}", "platform", f"rod{k}", head)


@robot
def spherical_wrist_parallel(m: RobotTelling) -> None:
    # Three motors on one axis below; proximal links of 45°, distal ones of 90°, axes of the platform at right angles.
    proximal, outer, inner = np.pi / 4, 0.14, 0.11
    m.bar("base", (0, 0, -0.22), (0, 0, -0.155), 0.04, 0, STEEL)
    for k, angle in enumerate(THIRDS, start=1):
        end = around(1, 0, angle)
        turn = angle + np.pi / 2
        middle = around(np.sin(proximal), -np.cos(proximal), turn)
        m.r(f"motor{k}", "base", f"proximal{k}", CENTRE, Z, motor=(3.0, 20.0))
        _arc(m, f"proximal{k}", -Z, middle, outer + 0.008 * (k - 2), 0.15, BLUE)
        m.r(f"elbow{k}", f"proximal{k}", f"distal{k}", CENTRE, middle)
        _arc(m, f"distal{k}", middle, end, inner, 0.12, ORANGE)
        if k == 1:
            m.r("wrist1", "distal1", "platform", CENTRE, end)
        else:
            m.close(f"wrist{k}", f"distal{k}", "platform", CENTRE, "revolute", end)
    m.disc("platform", (0, 0, 0.02), Z, 0.1, 0.008, 0.3, GREEN)
    for angle in THIRDS:
        m.bar("platform", around(0.02, 0, angle), around(0.1, 0, angle), 0.006, 0.02, GREEN)
