"""Does a description describe a mechanism? Every refusal names the culprit and the remedy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from decimal import Decimal
from math import inf, isfinite

import numpy as np
import pinocchio as pin

from stewart_pin.errors import MechanismError
from stewart_pin.model.description import (
    LOOP_KINDS,
    TREE_KINDS,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
    loop_coordinates,
    physics_coordinates,
)
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.tolerances import NO_DIRECTION, UNIT_QUATERNION
from stewart_pin.typing import FloatArray

_ROUND_OFF = 1e-9
"""Slack of the triangle inequality, relative to the trace (thin rods printed with few digits touch it), of unit
vectors and of rotations."""

_TURNED = 4 * np.finfo(float).eps
"""Moment that turning and shifting leave of none, in masses times squares of the lengths of the mechanism: a programme
that moves a point of 0.5 kg by 0.1 m and back leaves some 1e-18 kg m². Of a body of 1e-18 kg that is one micrometre
large, with 1e-30 kg m², no more than 1e-45."""
_LIGHTEST = 1e-100
"""Least mass that is one: far below that of an electron, and far above where doubles lose digits in products [kg]."""


def validate(mechanism: Mechanism) -> None:
    """Refuse what is no mechanism.

    Parameters
    ----------
    mechanism
        Description to check: unique names, one tree, existing frames, physical inertias, sensible numbers.

    Raises
    ------
    MechanismError
        Naming the link, joint or loop at fault.
    """
    _Validator(mechanism).run()


class _Validator:
    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.links = {link.name for link in mechanism.links}
        self.round_off = _round_off(mechanism)

    def run(self) -> None:
        m = self.mechanism
        self._unique("link", (link.name for link in m.links))
        self._unique("joint", (joint.name for joint in m.joints))
        self._unique("loop", (loop.name for loop in m.loops))
        self._unique("loop or coupling", (part.name for part in (*m.loops, *m.couplings)))
        for link in m.links:
            self._inertia(link)
        self._joints()
        self._tree()
        self._loops()
        self._couplings()
        if m.platform is not None and m.platform not in self.links:
            raise self._error(
                m.platform, f"platform names the missing link '{m.platform}'; {self._have_links()}"
            )
        missing = set(m.home) - {joint.name for joint in m.joints}
        if missing:
            raise self._error(
                min(missing), f"the home configuration names the missing joint '{min(missing)}'"
            )

    def _error(self, culprit: str, text: str) -> MechanismError:
        return MechanismError(text, path=self.mechanism.source, culprit=culprit)

    def _have_links(self) -> str:
        return "the links are: " + ", ".join(sorted(self.links))

    def _unique(self, what: str, names: Iterable[str]) -> None:
        for name, count in Counter(names).items():
            if count > 1:
                raise self._error(name, f"{count} {what}s are called '{name}'; rename all but one")

    def _inertia(self, link: Link) -> None:
        if link.inertia is None:
            return
        mass, com, inertia = link.inertia.mass, link.inertia.lever, link.inertia.inertia
        if not (np.isfinite(mass) and np.isfinite(com).all() and np.isfinite(inertia).all()):
            raise self._error(link.name, f"link '{link.name}' has a mass or inertia that is not finite")
        if mass < 0:
            raise self._error(
                link.name, f"link '{link.name}' has the negative mass {mass:g} kg; masses are >= 0"
            )
        if 0 < mass < _LIGHTEST:
            raise self._error(
                link.name,
                f"link '{link.name}' has a mass of {mass:g} kg, which keeps no digits in products; give it "
                f"{_LIGHTEST:g} kg or more, or none",
            )
        problem = negative_moment(inertia, mass * self.round_off)
        if problem is None and link.name not in self.mechanism.odd_inertias:
            problem = broken_triangle(inertia, mass * self.round_off)
            if problem:
                problem += "; correct its digits, or let load keep it: leave out odd_inertias=False"
        if problem:
            raise self._error(link.name, f"link '{link.name}': {problem}")
        if link.name not in self.mechanism.odd_inertias and lacks_mass(self.mechanism, link):
            raise self._error(
                link.name,
                f"link '{link.name}' has inertia but no mass; give it a mass, remove its <inertial> element, or leave "
                "out odd_inertias=False",
            )

    def _placement(self, owner: str, culprit: str, placement: pin.SE3) -> None:
        homogeneous = placement.homogeneous
        turned = homogeneous[:3, :3]
        if not np.isfinite(homogeneous).all() or np.abs(turned.T @ turned - np.eye(3)).max() > _ROUND_OFF:
            raise self._error(
                culprit, f"{owner} has a placement that is not finite, or whose rotation is none"
            )

    def _axis(self, owner: str, culprit: str, axis: FloatArray) -> None:
        if np.shape(axis) != (3,) or not abs(np.linalg.norm(axis) - 1) <= _ROUND_OFF:
            raise self._error(culprit, f"{owner} has the axis {axis}; give a unit vector of three numbers")

    def _joints(self) -> None:
        for joint in self.mechanism.joints:
            if joint.name == "universe":
                raise self._error(
                    joint.name, "no joint may be called 'universe', Pinocchio's name for the world"
                )
            self._placement(f"joint '{joint.name}'", joint.name, joint.placement)
            self._axis(f"joint '{joint.name}'", joint.name, joint.axis)
            if joint.kind not in TREE_KINDS:
                raise self._error(
                    joint.name, f"joint '{joint.name}' cannot be of type '{joint.kind}' in the tree"
                )
            for role, name in (("parent", joint.parent), ("child", joint.child)):
                if name not in self.links:
                    raise self._error(
                        joint.name,
                        f"joint '{joint.name}' has the missing {role} link '{name}'; {self._have_links()}",
                    )
            if not joint.lower <= joint.upper:
                raise self._error(
                    joint.name,
                    f"joint '{joint.name}' has lower limit {joint.lower:g} above upper limit {joint.upper:g}",
                )
            for what in ("effort", "velocity", "acceleration", "jerk", "swing", "turn"):
                value = getattr(joint, what)
                if isinstance(value, tuple):
                    self._span(f"joint '{joint.name}'", joint.name, what, value)
                elif not isinstance(value, int | float | np.number) or not value >= 0:
                    shown = f"{value:g}" if isinstance(value, int | float | np.number) else repr(value)
                    raise self._error(
                        joint.name, f"joint '{joint.name}' has the {what} limit {shown}; it is a number >= 0"
                    )
            if joint.physics is not NO_PHYSICS:
                self._joint_physics(joint)
            if joint.independent and not joint.has_axis:
                raise self._error(
                    joint.name,
                    f"joint '{joint.name}' is marked independent, but a motor drives a revolute or prismatic joint, "
                    f"not one of type '{joint.kind}'",
                )

    def _physics(self, owner: str, culprit: str, physics: JointPhysics) -> None:
        if fault := physics.fault():
            raise self._error(culprit, f"{owner}: {fault}")

    def _joint_physics(self, joint: Joint) -> None:
        self._physics(f"joint '{joint.name}'", joint.name, joint.physics)
        if joint.physics and joint.kind is JointKind.FIXED:
            raise self._error(
                joint.name,
                f"joint '{joint.name}' is fixed and has {joint.physics}; a joint that does not move has none",
            )
        ball = joint.kind is JointKind.SPHERICAL
        if not joint.has_axis and (
            joint.physics.force
            or (joint.physics.pushes and not ball)
            or joint.physics.rest
            or len(joint.physics.stiffness) > 1
        ):
            raise self._error(joint.name, _without_coordinate("joint", joint.name, joint.kind, joint.physics))

    def _loop_physics(self, loop: Loop) -> None:
        own = physics_coordinates(loop.kind)
        if len(loop.physics) not in (0, len(own)):
            raise self._error(
                loop.name,
                f"loop '{loop.name}' has physics of {len(loop.physics)} coordinates; the coordinates of its kind "
                f"'{loop.kind}' are: {', '.join(own) or 'none'}",
            )
        for physics in loop.physics:
            self._physics(f"loop '{loop.name}'", loop.name, physics)
            if physics.armature:
                raise self._error(
                    loop.name,
                    f"joint '{loop.name}' closes a loop and has a rotor (armature {physics.armature:g}), which only "
                    "joints of the tree may have; let another joint of the loop close it",
                )
            if loop.kind is JointKind.SPHERICAL and (
                physics.force or physics.rest or physics.friction or len(physics.stiffness) > 1
            ):
                raise self._error(loop.name, _without_coordinate("loop", loop.name, loop.kind, physics))

    def _span(self, owner: str, culprit: str, what: str, span: tuple[float, float]) -> None:
        if not span[0] <= span[1]:
            raise self._error(
                culprit, f"{owner} has the least {what} {span[0]:g} above the greatest, {span[1]:g}"
            )

    def _tree(self) -> None:
        parents: dict[str, str] = {}
        for joint in self.mechanism.joints:
            if joint.child in parents:
                raise self._error(
                    joint.child,
                    f"link '{joint.child}' has two parents, through the joints '{parents[joint.child]}' and "
                    f"'{joint.name}'; a file may hold one tree: write the second joint as a <loop>",
                )
            parents[joint.child] = joint.name
        roots = sorted(self.links - set(parents))
        if not self.mechanism.links:
            raise self._error(self.mechanism.name, f"robot '{self.mechanism.name}' has no <link>")
        if len(roots) > 1:
            raise self._error(
                roots[1], f"links without a parent: {', '.join(roots)}; one, the ground, may have none"
            )
        reached, frontier = set(roots), list(roots)
        while frontier:
            link = frontier.pop()
            below = [joint.child for joint in self.mechanism.joints if joint.parent == link]
            reached.update(below)
            frontier.extend(below)
        if reached != self.links:
            lost = min(self.links - reached)
            raise self._error(lost, f"link '{lost}' hangs on a cycle of joints, not on the ground")

    def _loops(self) -> None:
        for loop in self.mechanism.loops:
            for placement in (loop.placement1, loop.placement2):
                self._placement(f"loop '{loop.name}'", loop.name, placement)
            for axis in (loop.axis, loop.axis2):
                self._axis(f"loop '{loop.name}'", loop.name, axis)
            if loop.kind not in LOOP_KINDS:
                raise self._error(loop.name, f"loop '{loop.name}' cannot be of type '{loop.kind}'")
            for role, name in (("predecessor", loop.link1), ("successor", loop.link2)):
                if name not in self.links:
                    raise self._error(
                        loop.name,
                        f"loop '{loop.name}' has the missing {role} link '{name}'; {self._have_links()}",
                    )
            if len(loop.bounds) not in (0, len(loop_coordinates(loop.kind))):
                own = ", ".join(loop_coordinates(loop.kind)) or "none"
                raise self._error(
                    loop.name,
                    f"loop '{loop.name}' has {len(loop.bounds)} bounds; the coordinates of its kind '{loop.kind}' are: "
                    f"{own}",
                )
            for bounds in loop.bounds:
                for what, span in vars(bounds).items():
                    self._span(f"loop '{loop.name}'", loop.name, what, span)
            self._loop_physics(loop)
            if loop.link1 == loop.link2:
                raise self._error(loop.name, f"loop '{loop.name}' joins link '{loop.link1}' to itself")
            # A rod as short as round-off has no direction, and two points on one place are a ball.
            if loop.kind == "cable":
                self._cable(loop)
            if loop.kind in ("distance", "cable") and not loop.length > _ROUND_OFF * np.sqrt(
                self.round_off / _TURNED
            ):
                raise self._error(
                    loop.name,
                    f"loop '{loop.name}' keeps the distance {loop.length:g} m; give a <length value> above zero, or a "
                    "ball where the two points are one",
                )

    def _cable(self, loop: Loop) -> None:
        cable, owner = loop.cable, f"cable '{loop.name}'"
        if not 0 <= cable.radius < inf:
            raise self._error(
                loop.name,
                f"{owner} has a pulley of radius {cable.radius:g} m; it must be finite, and not below zero",
            )
        if cable.reel is None:
            return
        if not isfinite(cable.ratio) or cable.ratio == 0:
            raise self._error(
                loop.name,
                f"{owner} has the ratio {cable.ratio:g} to its reel; give the cable that is wound in per unit of it",
            )
        reel = next((joint for joint in self.mechanism.joints if joint.name == cable.reel), None)
        if reel is None or not reel.has_axis:
            what = "is not there" if reel is None else f"is {reel.kind}"
            able = ", ".join(joint.name for joint in self.mechanism.joints if joint.has_axis) or "none"
            raise self._error(
                loop.name,
                f"{owner} is wound in by joint '{cable.reel}', which {what}; name a revolute or prismatic joint: "
                f"{able}",
            )

    def _couplings(self) -> None:
        joints = {joint.name: joint for joint in self.mechanism.joints}
        loops = {loop.name for loop in self.mechanism.loops}
        for coupling in self.mechanism.couplings:
            owner = f"coupling '{coupling.name}'"
            for name in coupling.joints:
                if name in loops:
                    raise self._error(
                        coupling.name,
                        f"{owner} names joint '{name}', which closes a loop and has no coordinate; couple a joint of "
                        "the tree, or cut the loop at another joint",
                    )
                if name not in joints:
                    raise self._error(
                        coupling.name, f"{owner} names the missing joint '{name}'; correct the name"
                    )
                if not joints[name].has_axis:
                    raise self._error(
                        coupling.name,
                        f"{owner} names joint '{name}' of type '{joints[name].kind}'; only joints of one freedom can "
                        "be coupled",
                    )
            for name, count in Counter(coupling.joints).items():
                if count > 1:
                    raise self._error(coupling.name, f"{owner} couples joint '{name}' to itself")
            for name, ratio in coupling.others:
                if not (np.isfinite(ratio) and ratio):
                    raise self._error(
                        coupling.name,
                        f"{owner} follows joint '{name}' by the ratio {ratio:g} (<also ratio> in a URDF); give a "
                        "finite one other than zero, or leave the joint out",
                    )
            if coupling.others and coupling.joint2 is None:
                raise self._error(
                    coupling.name,
                    f"{owner} follows joint '{coupling.others[0][0]}' beside others, and has no second joint (<leader> "
                    "in a URDF); make one of them the second",
                )
            numbers = np.asarray(coupling.polynomial, dtype=float)
            if numbers.ndim != 1 or not numbers.size or not np.isfinite(numbers).all():
                raise self._error(
                    coupling.name,
                    f"{owner} has the polynomial {coupling.polynomial}; give finite coefficients, constant first",
                )
            if coupling.joint2 is None and numbers[1:].any():
                raise self._error(
                    coupling.name,
                    f"{owner} has no second joint, but a polynomial of one; give a constant alone",
                )


def _without_coordinate(what: str, name: str, kind: JointKind, physics: JointPhysics) -> str:
    """Say that a joint has no coordinate with a sign, along which something could push."""
    may = (
        "armature, damping and friction"
        if kind is JointKind.FLOATING
        else "a linear spring that rests at zero, and damping"
    )
    return f"{what} '{name}' is of type '{kind}' and has {physics}; it may have {may}"


def _round_off(mechanism: Mechanism) -> float:
    """Moment per mass that is zero but for round-off [m²], from distances on the bodies that move."""
    root = {link.name for link in mechanism.links} - {joint.child for joint in mechanism.joints}
    levers = [link.inertia.lever for link in mechanism.links if link.inertia is not None]
    placed = [joint.placement.translation for joint in mechanism.joints if joint.parent not in root]
    # Where the robot stands does not count, unless nothing else has a length.
    on_ground = [joint.placement.translation for joint in mechanism.joints if joint.parent in root]
    for places in ([*levers, *placed], on_ground):
        largest = max((float(np.linalg.norm(place)) for place in places), default=0.0)
        if 0 < largest < np.inf:
            return _TURNED * largest**2
    return _TURNED


def negative_moment(inertia: np.ndarray, round_off: float = 0.0) -> str | None:
    """Say that a rotational inertia has a negative moment: motion would give energy for nothing.

    Parameters
    ----------
    inertia
        (3, 3) about the centre of mass [kg m²].
    round_off
        Moment that is zero but for round-off [kg m²].

    Returns
    -------
    str or None
        The reason, or None.
    """
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] < -max(_ROUND_OFF * np.abs(moments).sum(), round_off):
        return f"the inertia has the negative principal moment {moments[0]:g} kg m²"
    return None


def broken_triangle(inertia: np.ndarray, round_off: float = 0.0) -> str | None:
    """Say that no real body has a rotational inertia, although equations of motion can be solved with it.

    Parameters
    ----------
    inertia
        (3, 3) about the centre of mass [kg m²].
    round_off
        Moment that is zero but for round-off [kg m²].

    Returns
    -------
    str or None
        The reason, or None for the inertia of a real body.
    """
    moments = np.linalg.eigvalsh(inertia)
    if moments[2] > moments[0] + moments[1] + max(_ROUND_OFF * np.abs(moments).sum(), round_off):
        return (
            f"the principal moments {moments[0]:g}, {moments[1]:g}, {moments[2]:g} kg m² break the triangle "
            "inequality: no body has one moment larger than the sum of the other two"
        )
    return None


def lacks_mass(mechanism: Mechanism, link: Link) -> bool:
    """Tell whether a link has a rotational inertia without mass.

    Parameters
    ----------
    mechanism
        Description with the link.
    link
        The link.

    Returns
    -------
    bool
        Whether it has; not where it is fixed, perhaps through others, to one with mass: together they are one body.
    """
    if link.inertia is None or link.inertia.mass != 0 or not np.any(link.inertia.inertia):
        return False
    reached, frontier = {link.name}, [link.name]
    fixed = [(j.parent, j.child) for j in mechanism.joints if j.kind is JointKind.FIXED]
    while frontier:
        at = frontier.pop()
        beside = {b if a == at else a for a, b in fixed if at in (a, b)} - reached
        reached |= beside
        frontier.extend(beside)
    masses = [
        part.inertia.mass for part in mechanism.links if part.name in reached and part.inertia is not None
    ]
    return not any(mass > 0 for mass in masses)


def keep_odd_inertias(mechanism: Mechanism) -> Mechanism:
    """Let a description pass although no real body has some of its inertias; simulators take those as well.

    Parameters
    ----------
    mechanism
        Description as it was read.

    Returns
    -------
    Mechanism
        The same, with a note for each such link.
    """
    odd: dict[str, Note] = {}
    round_off = _round_off(mechanism)
    for link in mechanism.links:
        body = link.inertia
        # Numbers that are none are refused by name later.
        if link.name in mechanism.odd_inertias or body is None or not np.isfinite(body.inertia).all():
            continue
        problem = broken_triangle(body.inertia, body.mass * round_off)
        if lacks_mass(mechanism, link):
            problem = "it has inertia but no mass"
        if problem:
            odd[link.name] = Note(f"link '{link.name}'", f"{problem}; check its digits", Outcome.KEPT)
    notes = (*mechanism.notes, *odd.values())
    return replace(mechanism, notes=notes, odd_inertias=mechanism.odd_inertias | odd.keys())


def is_massless(inertia: pin.Inertia | None) -> bool:
    """Tell whether a link carries no inertia at all.

    Parameters
    ----------
    inertia
        Inertia of a link, or None.

    Returns
    -------
    bool
        Whether mass and rotational inertia are zero or absent.
    """
    return inertia is None or (inertia.mass == 0 and not np.any(inertia.inertia))


# ----------------------------------------------------------------------------------------------------
# Quaternions that joints read, of unit length but for their digits
#
# Those that place something are scaled, whatever their length, as every format has it. A joint's value is another
# matter: one that is far from unit length was meant otherwise.
# ----------------------------------------------------------------------------------------------------

SCALED = "its quaternion was scaled to length one, as its digits leave open"
"""Note on a quaternion whose length its digits explain."""


def unit_quaternion(quaternion: FloatArray) -> FloatArray | None:
    """Scale a quaternion to unit length, if the digits that its numbers are printed with explain what is missing.

    Zeros at the end of a number are often left out, so that the finest of the four numbers tells; whole ones are exact.

    Parameters
    ----------
    quaternion
        (4,) as it was read (dimensionless).

    Returns
    -------
    numpy.ndarray or None
        (4,) of unit length (dimensionless); the one given where it has that but for round-off; None: its digits do not
        explain its length.
    """
    size = float(np.linalg.norm(quaternion))
    if abs(size - 1.0) <= UNIT_QUATERNION:
        return quaternion
    open_by, entries = _left_open(quaternion), np.abs(quaternion)
    shortest = float(np.linalg.norm(np.maximum(entries - open_by, 0.0)))
    longest = float(np.linalg.norm(entries + open_by))
    return quaternion / size if shortest <= 1.0 <= longest else None


def _left_open(quaternion: FloatArray) -> FloatArray:
    """List what the last digit of each number leaves open, printed with so many decimals or digits as any other.

    A whole unit of it: digits that were cut off, or a turn of rounded numbers, leave more than half of one. Half a unit
    of numbers with one or two digits, a whole one of which would explain next to anything.
    """
    found = [Decimal(repr(float(value))).normalize() for value in quaternion]
    decimals = max(-int(number.as_tuple().exponent) for number in found)
    digits = max(len(number.as_tuple().digits) for number in found)
    unit = 1.0 if digits > 2 else 0.5
    by_decimals = unit * 10.0**-decimals if decimals > 0 else 0.0
    # One digit alone says nothing of how the others were printed.
    by_digits = [
        unit * 10.0 ** (number.adjusted() + 1 - digits) if number and digits > 1 else 0.0 for number in found
    ]
    return np.maximum(by_decimals, by_digits)


def not_of_unit_length(quaternion: FloatArray) -> str:
    """Say that a quaternion is not of unit length, for an error.

    Parameters
    ----------
    quaternion
        (4,) as it was read (dimensionless).

    Returns
    -------
    str
        Its numbers and its length, and what to write.
    """
    size = float(np.linalg.norm(quaternion))
    shown = " ".join(f"{value:.6g}" for value in quaternion)
    remedy = "0 0 0 1 is no turn"
    if size > NO_DIRECTION:
        remedy = f"as a turn: {' '.join(f'{value:.6g}' for value in quaternion / size)}"
    return f"the quaternion '{shown}' is of length {size:.6g}; write x y z w of length one, {remedy}"


_QUATERNIONS = {JointKind.SPHERICAL: 4, JointKind.FLOATING: 7}
"""How many values a joint reads of which the last four are a quaternion."""


def with_unit_quaternions(mechanism: Mechanism) -> Mechanism:
    """Scale the quaternions of the home configuration to unit length, where their digits explain that they lack it.

    Parameters
    ----------
    mechanism
        Description, validated.

    Returns
    -------
    Mechanism
        The same where all have it; else the notes tell which were scaled.

    Raises
    ------
    MechanismError
        If a length is not explained by digits.
    """
    home, notes = dict(mechanism.home), list(mechanism.notes)
    for name, values in mechanism.home.items():
        if len(values) != _QUATERNIONS.get(mechanism.joint(name).kind):
            continue  # the number of values is judged with the model
        unit = unit_quaternion(values[-4:])
        if unit is None:
            raise MechanismError(
                f"joint '{name}' of the home configuration: {not_of_unit_length(values[-4:])}",
                path=mechanism.source,
                culprit=name,
            )
        if not np.array_equal(unit, values[-4:]):
            home[name] = np.concatenate([values[:-4], unit])
            notes.append(Note(f"joint '{name}' of the home configuration", SCALED, Outcome.CHANGED))
    return (
        replace(mechanism, home=home, notes=tuple(notes)) if len(notes) > len(mechanism.notes) else mechanism
    )
