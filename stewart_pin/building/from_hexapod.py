"""From twelve points, of a text table too, and three bodies to a closed chain with six UPS, SPS or screw legs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np
import pinocchio as pin

from stewart_pin.building.loading import build_chain
from stewart_pin.checks import as_positive
from stewart_pin.errors import FileFormatError, FileMissingError, InputError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY, Hexapod
from stewart_pin.geometry.hexapod_dynamics import LowerJoint
from stewart_pin.model.description import (
    Bounds,
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
)
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.typing import ArrayLike, FloatArray

_SWING = 1.5
"""Range of each axis of the lower joint, to either side [rad]: just short of the universal joint's gimbal lock."""
_ROUND_OFF = 1e-9
"""Share of the shortest leg by which a body may be longer."""
_ALONG = 1e-3
"""Sine of the angle to the platform's x below which a leg on an upper universal joint is refused."""
OVERLAP = 0.6
"""Share of a leg over which each of its bodies reaches."""
_X, _Y, _Z = np.eye(3)


def hexapod_chain(
    hexapod: Hexapod,
    *,
    platform: pin.Inertia,
    lower: pin.Inertia,
    upper: pin.Inertia,
    lower_joint: LowerJoint = "universal",
    stroke: tuple[float, float] = (0.0, inf),
    base: pin.Inertia | None = None,
    effort: float = inf,
    velocity: float = inf,
    swing: float = _SWING,
    ball_swing: float = inf,
    lead: float | None = None,
    home: pin.SE3 | None = None,
    name: str = "hexapod",
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> ClosedChain:
    """Build a six-legged platform.

    Each leg stands on a universal joint (first axis = base x, second = leg y) or on a spherical one (a third axis
    along the leg), is driven by a prismatic motor whose coordinate is the leg length, and carries the platform by a
    ball, which closes the loop. The platform is a free body of the tree.

    With a `lead`, each leg is a screw whose nut turns with it, as in machine tools: the platform is carried by a
    universal joint (first axis = platform x, second across the leg at home), so that the rod turns in the nut as the
    platform tilts and twists, and length = reading + lead / 2π × spin.

    Parameters
    ----------
    hexapod
        Leg ends [m].
    platform
        Inertia in the platform frame [kg, m, kg m²].
    lower
        Inertia of each cylinder in the leg frame at the base point, z along the leg [kg, m, kg m²].
    upper
        Inertia of each rod in the leg frame at the platform point, z along the leg [kg, m, kg m²].
    lower_joint
        ``"universal"`` or ``"spherical"``; the latter leaves each leg free to spin.
    stroke
        Least and greatest leg length [m].
    base
        Inertia of the ground link, which makes it a body of the maximal-coordinate system [kg, m, kg m²].
    effort
        Largest motor force [N].
    velocity
        Largest leg rate [m/s].
    swing
        How far each axis of the lower joint turns to either side from where the leg stands up straight, or hangs
        [rad].
    ball_swing
        How far the leg swings in the ball at the platform from where it stands at home [rad].
    lead
        Travel of the screw per whole turn of the rod in its nut, positive if a right-handed turn about the direction
        from base to platform lengthens the leg; default: no screws [m].
    home
        Platform frame in the world at home; default: level, its points centred above the base points, so high that
        the mean leg length is in the middle of the stroke.
    name
        Name of the robot.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].

    Returns
    -------
    ClosedChain
        Legs in the order of the base points; motors ``leg1`` to ``leg6``. Its report names bodies that are longer than
        the shortest leg, as those are that were made for another stroke. With screws the motors read what the leg
        would be long if its rod had not turned; lengths are ``leg1_length`` and so on, turns ``leg1_spin``; a rotor
        is the armature of its motor, moment of inertia × (2π / lead)², see `with_joint_physics`.

    Raises
    ------
    InputError
        If the joint type is unknown, the stroke is empty, a swing is not above zero, or a leg has no length at home. If
        screws are asked for with spherical lower joints, which leave the spin to nobody, with a lead of zero, or with
        a leg along the platform's x at home.
    MechanismError
        If an inertia is unphysical, or home stands beyond the stroke or the swing of a leg.
    """
    if lower_joint not in ("universal", "spherical"):
        raise InputError(f"lower_joint must be 'universal' or 'spherical', got {lower_joint!r}")
    _require_inertias(platform=platform, lower=lower, upper=upper, **({} if base is None else {"base": base}))
    low, high = read_stroke(stroke)
    _require_angles(swing=swing, ball_swing=ball_swing)
    if lead is not None:
        _require_screw(lead, lower_joint, ball_swing)
    pose = pin.SE3(np.eye(3), default_home(hexapod, low, high)) if home is None else as_pose("home", home)
    ends = zip(hexapod.base_points, hexapod.platform_points, strict=True)
    legs = [
        _Leg(f"leg{number}", foot, head, pose, 2 if lower_joint == "universal" else 3, lead)
        for number, (foot, head) in enumerate(ends, start=1)
    ]
    cylinders = [leg.cylinders(low, high, effort, velocity) for leg in legs]
    mechanism = Mechanism(
        name,
        (
            Link("base", base),
            Link("platform", platform),
            *(x for leg in legs for x in leg.links(lower, upper)),
        ),
        (
            Joint("platform_pose", JointKind.FLOATING, "base", "platform", pin.SE3.Identity()),
            *(x for leg, last in zip(legs, cylinders, strict=True) for x in (*leg.feet(swing), *last)),
        ),
        tuple(leg.top(ball_swing) for leg in legs),
        tuple(screw for leg in legs for screw in leg.screws()),
        platform="platform",
        home={"platform_pose": pin.SE3ToXYZQUAT(pose)}
        | {k: x for leg in legs for k, x in leg.home().items()},
        source="",
        notes=(*_too_long("lower", lower, 1.0, low, high), *_too_long("upper", upper, -1.0, low, high)),
    )
    return build_chain(mechanism, gravity=gravity)


def _require_inertias(**given: pin.Inertia) -> None:
    for argument, inertia in given.items():
        if not isinstance(inertia, pin.Inertia):
            raise InputError(f"{argument} must be a pinocchio.Inertia, got {type(inertia).__name__}")


def _require_angles(**given: float) -> None:
    for argument, value in given.items():
        if not value > 0:
            raise InputError(f"{argument} must be an angle above zero, got {value!r}")


def _require_screw(lead: float, lower_joint: LowerJoint, ball_swing: float) -> None:
    if not isinstance(lead, int | float | np.number) or not np.isfinite(lead) or lead == 0.0:
        raise InputError(f"lead must be the travel per turn, a number other than zero [m], got {lead!r}")
    if lower_joint != "universal":
        raise InputError("a screw needs lower_joint='universal': on a spherical one nothing holds its nut")
    if not np.isinf(ball_swing):
        raise InputError(
            f"ball_swing={ball_swing:g}: with a lead the platform is on universal joints, not on balls"
        )


@dataclass(frozen=True, eq=False)
class _Leg:
    """A leg from its point on the base to that on the platform [m], the platform's pose, hinges of its lower joint."""

    name: str
    foot: FloatArray
    head: FloatArray
    pose: pin.SE3
    hinges: int
    lead: float | None = None

    @property
    def vector(self) -> FloatArray:
        """(3,) from the one end to the other at home [m]."""
        return self.pose.act(self.head) - self.foot

    def hinge_names(self) -> list[str]:
        return [f"{self.name}_{axis}" for axis in "xyz"[: self.hinges]]

    def crosses(self) -> list[str]:
        """Links without mass between the hinges."""
        return [f"{self.name}_cross{k if self.hinges > 2 else ''}" for k in range(1, self.hinges)]

    def links(self, lower: pin.Inertia, upper: pin.Inertia) -> list[Link]:
        bodies = [Link(f"{self.name}_lower", lower), Link(f"{self.name}_upper", upper)]
        if self.lead is not None:
            bodies += [Link(f"{self.name}_sleeve"), Link(f"{self.name}_nut")]
        return [*(Link(cross) for cross in self.crosses()), *bodies]

    def feet(self, swing: float) -> list[Joint]:
        """Hinges of the lower joint."""
        between = self.crosses()
        carriers, carried = ["base", *between], [*between, f"{self.name}_lower"]
        joints = []
        for k, name in enumerate(self.hinge_names()):
            placement = pin.SE3(np.eye(3), self.foot) if k == 0 else pin.SE3.Identity()
            limit = 2 * np.pi if k == 2 else swing
            # A leg that hangs stands half a turn from one that stands up.
            middle = np.pi if k == 0 and self.vector[2] < 0 else 0.0
            joints.append(
                Joint(
                    name, JointKind.REVOLUTE, carriers[k], carried[k], placement, (_X, _Y, _Z)[k],
                    middle - limit, middle + limit,
                )
            )  # fmt: skip
        return joints

    def cylinders(self, low: float, high: float, effort: float, velocity: float) -> list[Joint]:
        """Motor of the leg; with a screw the slide and the spin of its rod as well."""
        lower, upper, here = f"{self.name}_lower", f"{self.name}_upper", pin.SE3.Identity()
        if self.lead is None:
            return [
                Joint(
                    self.name, JointKind.PRISMATIC, lower, upper, here, _Z,
                    low, high, effort, velocity, independent=True,
                )
            ]  # fmt: skip
        sleeve, nut = f"{self.name}_sleeve", f"{self.name}_nut"
        return [
            Joint(f"{self.name}_length", JointKind.PRISMATIC, lower, sleeve, here, _Z, low, high),
            Joint(f"{self.name}_spin", JointKind.REVOLUTE, sleeve, upper, here, _Z),
            Joint(
                self.name, JointKind.PRISMATIC, lower, nut, here, _Z,
                effort=effort, velocity=velocity, independent=True,
            ),
        ]  # fmt: skip

    def screws(self) -> list[Coupling]:
        """Couple the three by the thread: length = reading + lead / 2π × spin."""
        if self.lead is None:
            return []
        turning = ((f"{self.name}_spin", self.lead / (2 * np.pi)),)
        return [Coupling(f"{self.name}_screw", f"{self.name}_length", self.name, (0.0, 1.0), turning)]

    def top(self, swing: float) -> Loop:
        """Joint at the platform, which closes the loop; z of a ball is along the leg where the swing has a limit."""
        if self.lead is not None:
            return Loop(
                f"{self.name}_universal", JointKind.UNIVERSAL, "platform", f"{self.name}_upper",
                pin.SE3(np.eye(3), self.head), pin.SE3.Identity(), axis=_X, axis2=self._across(),
            )  # fmt: skip
        stated = not np.isinf(swing)
        along = _along(self.pose.rotation.T @ self.vector) if stated else np.eye(3)
        return Loop(
            f"{self.name}_ball", JointKind.SPHERICAL, "platform", f"{self.name}_upper",
            pin.SE3(along, self.head), pin.SE3.Identity(),
            bounds=(Bounds(position=(-inf, swing)), Bounds()) if stated else (),
        )  # fmt: skip

    def _across(self) -> FloatArray:
        """(3,) second axis of the upper universal joint in the rod, which has not turned at home."""
        across = np.cross(self.vector, self.pose.rotation[:, 0])
        size = float(np.linalg.norm(across))
        if size < _ALONG * float(np.linalg.norm(self.vector)):
            raise InputError(
                f"{self.name} stands along the platform's x at home, where its upper universal joint is locked; turn "
                "the platform's axes, or choose another home"
            )
        alpha, beta = (float(self.home()[name][0]) for name in self.hinge_names())
        leg = pin.utils.rotate("x", alpha) @ pin.utils.rotate("y", beta)
        return leg.T @ (across / size)

    def home(self) -> dict[str, FloatArray]:
        values = _leg_values(self.hinge_names(), self.name, self.vector)
        if self.lead is not None:
            values |= {f"{self.name}_length": values[self.name], f"{self.name}_spin": np.zeros(1)}
        return values


def read_stroke(stroke: tuple[float, float]) -> tuple[float, float]:
    """Check a stroke.

    Parameters
    ----------
    stroke
        Least and greatest leg length [m].

    Returns
    -------
    tuple of float
        The same [m].

    Raises
    ------
    InputError
        If it is not two numbers, or empty.
    """
    try:
        low, high = map(float, stroke)
    except (TypeError, ValueError):
        low = high = -inf
    if not 0 <= low < high:
        raise InputError(
            f"stroke must be (least, greatest) leg length with 0 <= least < greatest, got {stroke!r}"
        )
    return low, high


def _along(direction: FloatArray) -> FloatArray:
    """Axes of a ball whose z lies along a direction, turned the shortest way (3, 3)."""
    size = float(np.linalg.norm(direction))
    return pin.Quaternion.FromTwoVectors(_Z, direction / size).toRotationMatrix() if size else np.eye(3)


def _too_long(
    argument: str, body: pin.Inertia, outward: float, shortest: float, longest: float
) -> tuple[Note, ...]:
    """Note a body of a leg that, were it a uniform rod, would reach past the other end of the shortest leg.

    Of telescopes, which grow to more than twice their length, each part may have 60 % of the longest leg.
    """
    if shortest == 0.0 or body.mass <= 0.0:
        return ()
    moments = np.diag(body.inertia)
    # Mean square distance from the centre along the leg; a uniform rod reaches to √3 times its root.
    spread = max(0.0, float(moments[0] + moments[1] - moments[2]) / (2 * body.mass))
    reach = outward * float(body.lever[2]) + np.sqrt(3 * spread)
    if reach <= max(shortest, OVERLAP * longest) * (1 + _ROUND_OFF):
        return ()
    text = (
        f"reaches {reach:.4g} m along the leg, as if it were a uniform rod, and the shortest leg has {shortest:.4g} m; "
        "was it made for another stroke (hexapod_inertias takes stroke=)?"
    )
    return (Note(f"inertia '{argument}'", text, Outcome.KEPT),)


def _leg_values(names: list[str], motor: str, leg: FloatArray) -> dict[str, FloatArray]:
    """Joint values of one leg: u = Rx(α) Ry(β) z = (sin β, -sin α cos β, cos α cos β)."""
    length = float(np.linalg.norm(leg))
    if length == 0.0:
        raise InputError(f"{motor} has no length at home; pass home=, with the platform away from the base")
    x, y, z = leg / length
    # α in [-π/2, 3π/2), the range of legs that stand up or hang.
    alpha = (np.arctan2(-y, z) + np.pi / 2) % (2 * np.pi) - np.pi / 2
    angles = [alpha, np.arcsin(np.clip(x, -1.0, 1.0)), 0.0]
    return {name: np.array([angle]) for name, angle in zip(names, angles, strict=False)} | {
        motor: np.array([length])
    }


def default_home(hexapod: Hexapod, low: float, high: float) -> FloatArray:
    """Place a level platform above the base's centre.

    Parameters
    ----------
    hexapod
        Leg ends [m].
    low, high
        Stroke of the legs; without an end, the platform stands as high as the base is wide [m].

    Returns
    -------
    numpy.ndarray
        (3,) position at which the mean leg length is about the middle of the stroke, in the base frame [m].
    """
    spread = hexapod.platform_points - hexapod.base_points
    centre = -spread.mean(axis=0)
    across = np.linalg.norm((spread + centre)[:, :2], axis=1).mean()
    wanted = (low + high) / 2 if np.isfinite(high) else max(2 * across, np.ptp(hexapod.base_points), low)
    return centre + [0.0, 0.0, np.sqrt(max(wanted**2 - across**2, (0.25 * wanted) ** 2))]


# ----------------------------------------------------------------------------------------------------
# The twelve leg ends of a six-legged platform from a text table
# ----------------------------------------------------------------------------------------------------

_ENDS = {
    "platform": ("platform", "plat", "top", "upper", "moving", "mobile", "effector"),
    "base": ("base", "bottom", "lower", "fixed", "ground"),
}
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "inch": 0.0254, "ft": 0.3048}
"""Units of length that a header may name [m]."""

_LARGEST = 2**20
"""Bytes beyond which a file is no table of twelve points."""


def read_hexapod(path: str | Path, *, unit: float = 1.0) -> Hexapod:
    """Read twelve leg ends from a text table.

    Six rows hold one leg each (base x y z, platform x y z), twelve rows hold one point each (six of the base, then
    six of the platform). Numbers are separated by commas, semicolons or blanks; what follows ``#`` is a comment, and a
    first row of names is a header, which is checked against this order.

    Parameters
    ----------
    path
        File to read.
    unit
        Size of the file's unit of length, 1e-3 for millimetres [m].

    Returns
    -------
    Hexapod
        Legs in the order of the rows.

    Raises
    ------
    FileFormatError
        If the file is missing, a row cannot be read, or a header names another order or unit; names the line.
    InputError
        If the unit is not above zero.
    """
    unit, path = as_positive("unit", unit), Path(path)
    rows: list[list[float]] = []
    lines: list[int] = []
    header = False
    for line, words in _words(path):
        numbers = [_number(word) for word in words]
        if None not in numbers:
            rows.append([unit * number for number in numbers if number is not None])
            lines.append(line)
        elif rows or header or any(number is not None for number in numbers):
            stranger = words[numbers.index(None)]
            raise FileFormatError(
                f"line {line} holds {stranger!r}, which is no finite number",
                path=str(path),
                culprit=f"line {line}",
            )
        else:
            header = True
            _check_header(path, line, words)
            _check_unit(path, line, words, unit)
    width = {6: 6, 12: 3}.get(len(rows))
    if width is None:
        raise FileFormatError(
            f"{len(rows)} rows of numbers; a table has 6 (base x y z, platform x y z) or 12 (x y z)",
            path=str(path),
        )
    for row, line in zip(rows, lines, strict=True):
        if len(row) != width:
            raise FileFormatError(
                f"line {line} has {len(row)} numbers, one of {len(rows)} rows has {width}",
                path=str(path),
                culprit=f"line {line}",
            )
    return Hexapod.from_points(rows)


def _words(path: Path) -> list[tuple[int, list[str]]]:
    """Split the file into rows of words, with their line numbers; leave out comments and empty lines."""
    if not path.is_file():
        raise FileMissingError("no such file", path=str(path))
    if path.stat().st_size > _LARGEST:
        raise FileFormatError(f"more than {_LARGEST} bytes; is it a table of twelve points?", path=str(path))
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileFormatError("not a text file", path=str(path)) from None
    found = []
    for number, line in enumerate(lines, start=1):
        text = line.partition("#")[0].strip()
        separator = next((mark for mark in ";," if mark in text), None)
        if text:
            found.append((number, [word.strip(' "') for word in text.split(separator)]))
    return found


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _check_header(path: Path, line: int, words: list[str]) -> None:
    """Refuse a header that says another order than the one read: x y z, base before platform."""
    wrong_axis = any(_axis(word) not in ("", "xyz"[k % 3]) for k, word in enumerate(words))
    wrong_end = any(_end(word) not in ("", "base" if k < 3 else "platform") for k, word in enumerate(words))
    if wrong_axis or (len(words) == 6 and wrong_end):
        raise FileFormatError(
            f"line {line} names the columns {', '.join(words)}; the order must be base x y z, platform x y z",
            path=str(path),
            culprit=f"line {line}",
        )


def _end(word: str) -> str:
    """Find the end in a column's name, as in base_x, Bx [mm], top_x, upper joint x; none where no word says it."""
    name = re.sub(r"[\[(/].*|[_ ](mm|cm|m|in|inch|ft)$", "", word.lower()).strip()
    for end, words in _ENDS.items():
        if any(each in name for each in words) or re.match(rf"{end[0]}\d*[^a-z]*[xyz]\d*$", name):
            return end
    return ""


def _check_unit(path: Path, line: int, words: list[str], unit: float) -> None:
    """Refuse a header whose unit is not the one that the numbers are multiplied by."""
    said = {found[1].strip() for word in words if (found := re.search(r"[\[(]([^\])]*)[\])]", word.lower()))}
    said |= {found[1] for word in words if (found := re.search(r"[_ /](mm|cm|m|in|inch|ft)$", word.lower()))}
    for name in sorted(said & _UNITS.keys()):
        if abs(_UNITS[name] - unit) > 1e-9 * unit:
            raise FileFormatError(
                f"line {line} says that the numbers are in {name}; pass unit={_UNITS[name]:g}, got {unit:g}",
                path=str(path),
                culprit=f"line {line}",
            )


def _axis(word: str) -> str:
    """Find the axis in a column's name, as in base_x, X1, Bx [mm], x base; none where there is no such letter."""
    name = re.sub(r"[\[(/].*|[_ ](mm|cm|m|in|inch|ft)$", "", word.lower()).strip().rstrip("0123456789")
    if name[-1:] in tuple("xyz"):
        return name[-1]
    return name[0] if re.match(r"[xyz][^a-z]", name) else ""
