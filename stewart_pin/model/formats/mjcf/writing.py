"""MJCF, the native format of MuJoCo, written with the loops as equality constraints.

MuJoCo closes loops softly: its equality constraints act like very stiff springs and dampers, of which ``solimp``
sets the impedance. With MuJoCo's default (0.9) the accelerations of a Stewart platform are off by about their own
size; the file asks for the stiffest that MuJoCo allows (0.9999), which leaves a few thousandths, and a gap of the
loops near a micrometre instead of half a millimetre. No setting makes the loops rigid. Mass matrix and bias are those
of the rigid mechanism. ``mj_inverse`` answers with one effort per coordinate of the tree, not with motor efforts:
switch constraints off (``mjDSBL_CONSTRAINT``) and project its answer on the motions that keep the loops closed
(the null space of ``efc_J``); that is exact.

Limits of joint speed, the name of the platform, constant forces and springs of high powers, for which MuJoCo has no
word, stand in ``<custom>``, where `load` finds them. What has no counterpart is left out, and noted. What MuJoCo cannot
express is an `UnsupportedError`.

References
----------
.. [1] MuJoCo documentation, "XML reference" and "Computation: constraint model".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import (
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
    unknown_kind,
)
from stewart_pin.model.formats.dialect import note_lost_limits, write_files
from stewart_pin.model.formats.mjcf.bodies import Body, place, plan_bodies, quaternion_text
from stewart_pin.model.formats.mjcf.compiling import ASSEMBLED, HOME, PLATFORM, SPEED
from stewart_pin.model.formats.mjcf.physics import lost_loop_physics, write_physics
from stewart_pin.model.formats.mjcf.shapes import MjcfShapes
from stewart_pin.model.formats.mjcf.tree import MUJOCO_FAR
from stewart_pin.model.formats.xml import UNLIMITED, number_text
from stewart_pin.model.validation import broken_triangle, is_massless
from stewart_pin.typing import ArrayLike, FloatArray

# ----------------------------------------------------------------------------------------------------
# Loops and couplings as equality constraints of MJCF, where those hold exactly the same motions
# ----------------------------------------------------------------------------------------------------


_COEFFICIENTS = 5
"""MuJoCo's polynomials between two joints are of degree four."""

PlaceSite = Callable[[str, str, pin.SE3], str]
"""Makes a site on a link: (link, name, placement) to name."""


def write_equalities(
    root: etree._Element, mechanism: Mechanism, at_zero: Mapping[str, pin.SE3], place_site: PlaceSite
) -> None:
    """Write loops and couplings.

    Parameters
    ----------
    root
        The ``<mujoco>`` element, its bodies written; gets ``<tendon>`` and ``<equality>``.
    mechanism
        What to write.
    at_zero
        Placement of every body in the world at zero joint values.
    place_site
        Makes a site on a body.

    Raises
    ------
    UnsupportedError
        If MuJoCo cannot express a loop or a coupling; names it and the remedy.
    """
    writer = _EqualityWriter(at_zero, place_site)
    for loop in mechanism.loops:
        writer.loop(loop)
    for coupling in mechanism.couplings:
        writer.coupling(coupling)
    if len(writer.tendons):
        root.append(writer.tendons)
    root.append(writer.equality)


class _EqualityWriter:
    def __init__(self, at_zero: Mapping[str, pin.SE3], place_site: PlaceSite) -> None:
        self.at_zero = at_zero
        self.place_site = place_site
        self.equality = etree.Element("equality")
        self.tendons = etree.Element("tendon")
        self.names: set[str] = set()

    def loop(self, loop: Loop) -> None:
        # Arms as long as the links are large: the constraints then weigh alike.
        reach = (
            max(float(np.linalg.norm(end.translation)) for end in (loop.placement1, loop.placement2)) or 1.0
        )
        axis, arm1, arm2 = f"{loop.name}_axis", loop.axis * reach, loop.axis2 * reach
        match loop.kind:
            case JointKind.SPHERICAL:
                self._tie("connect", loop, loop.name)
            case JointKind.FIXED:
                self._tie("weld", loop, loop.name)
            case JointKind.REVOLUTE:
                # Two points of the axis: the sixth row is redundant.
                self._tie("connect", loop, loop.name)
                self._tie("connect", loop, axis, arm1, arm1)
            case JointKind.UNIVERSAL:
                # Two arms of one length from a common centre are perpendicular where their ends are √2 of it apart.
                self._tie("connect", loop, loop.name)
                self._rod(loop, axis, np.sqrt(2) * reach, arm1, arm2)
            case JointKind.DISTANCE:
                self._rod(loop, loop.name, loop.length)
            case _:
                raise UnsupportedError(
                    f"loop '{loop.name}' is {loop.kind}; MuJoCo closes spherical, fixed, revolute, universal and "
                    "distance loops: cut the loop at another joint"
                )

    def coupling(self, coupling: Coupling) -> None:
        if coupling.others:
            self._sum(coupling)
            return
        polynomial = np.trim_zeros(np.array(coupling.polynomial), "b")
        if len(polynomial) > _COEFFICIENTS:
            raise UnsupportedError(
                f"coupling '{coupling.name}' is of degree {len(polynomial) - 1}; MuJoCo couples joints by polynomials "
                f"of degree {_COEFFICIENTS - 1} at most"
            )
        element = etree.SubElement(
            self.equality, "joint", name=self._fresh(coupling.name), joint1=coupling.joint1
        )
        if coupling.joint2 is not None:
            element.set("joint2", coupling.joint2)
        padded = np.pad(polynomial, (0, _COEFFICIENTS - len(polynomial)))
        element.set("polycoef", number_text(padded))

    def _sum(self, coupling: Coupling) -> None:
        """Write a sum of joints: a tendon whose length keeps its value at zero joint values, but for a constant."""
        constant, slope, *higher = (*coupling.polynomial, 0.0)
        if any(higher):
            raise UnsupportedError(
                f"coupling '{coupling.name}' follows a sum of joints, one of them by a polynomial; MuJoCo knows only "
                "ratios there"
            )
        name = self._fresh(coupling.name)
        tendon = etree.SubElement(self.tendons, "fixed", name=f"{name}_sum")
        ratios = ((str(coupling.joint2), slope), *coupling.others)
        for joint, factor in ((coupling.joint1, 1.0), *((joint, -ratio) for joint, ratio in ratios)):
            etree.SubElement(tendon, "joint", joint=joint, coef=number_text([factor]))
        element = etree.SubElement(self.equality, "tendon", name=name, tendon1=f"{name}_sum")
        element.set("polycoef", number_text([constant, 0, 0, 0, 0]))

    def _fresh(self, name: str) -> str:
        if name in self.names:
            raise UnsupportedError(
                f"two constraints would be called '{name}'; rename the loop or the coupling"
            )
        self.names.add(name)
        return name

    def _ends(
        self, loop: Loop, name: str, shift1: FloatArray, shift2: FloatArray
    ) -> list[tuple[str, str, pin.SE3]]:
        return [
            (loop.link1, f"{name}_1", loop.placement1 * pin.SE3(np.eye(3), shift1)),
            (loop.link2, f"{name}_2", loop.placement2 * pin.SE3(np.eye(3), shift2)),
        ]

    def _tie(
        self,
        tag: str,
        loop: Loop,
        name: str,
        shift1: FloatArray | None = None,
        shift2: FloatArray | None = None,
    ) -> None:
        ends = self._ends(loop, name, _or_zero(shift1), _or_zero(shift2))
        site1, site2 = (self.place_site(*end) for end in ends)
        etree.SubElement(self.equality, tag, name=self._fresh(name), site1=site1, site2=site2)

    def _rod(
        self,
        loop: Loop,
        name: str,
        length: float,
        shift1: FloatArray | None = None,
        shift2: FloatArray | None = None,
    ) -> None:
        ends = self._ends(loop, name, _or_zero(shift1), _or_zero(shift2))
        spatial = etree.SubElement(self.tendons, "spatial", name=name)
        for end in ends:
            etree.SubElement(spatial, "site", site=self.place_site(*end))
        # The constraint is length - (length at zero joint values) = first coefficient.
        origins = [self.at_zero[link].act(placement.translation) for link, _, placement in ends]
        excess = length - float(np.linalg.norm(origins[1] - origins[0]))
        coefficients = number_text([excess, 0, 0, 0, 0])
        etree.SubElement(self.equality, "tendon", name=self._fresh(name), tendon1=name, polycoef=coefficients)


def _or_zero(shift: FloatArray | None) -> FloatArray:
    return np.zeros(3) if shift is None else shift


# ----------------------------------------------------------------------------------------------------

_WORLD = "world"
"""Name that MuJoCo reserves for the body that does not move."""
_TYPES = {JointKind.REVOLUTE: "hinge", JointKind.PRISMATIC: "slide", JointKind.SPHERICAL: "ball"}
_STIFFEST = "0.9999 0.9999 0.001 0.5 2"
"""``solimp`` at MuJoCo's mjMAXIMP, whatever the gap."""
_ABOUT_LOOPS = (
    " Loops are soft constraints in MuJoCo: its forward dynamics is that of slightly elastic ones. "
)


def write_mjcf_file(
    mechanism: Mechanism, path: Path, *, motors: Sequence[str], gravity: ArrayLike
) -> tuple[Note, ...]:
    """Write a mechanism as MJCF.

    Links become nested bodies of the same name, in the order of the Pinocchio model; links without mass vanish where
    they only join two joints. The ground is a body at rest (or the world, when it is called so); floating links are
    free bodies of the world, whose coordinates are their pose in it. Spherical, fixed, revolute and distance loops
    become a ``connect``, a ``weld``, two ``connect`` on the axis, and a tendon of constant length; a universal loop
    is a ``connect`` and a tendon that keeps its axes perpendicular. Couplings are ``joint`` constraints. Rotors,
    damping, dry friction and springs of joints are MuJoCo's, where friction is as soft as loops are. The home
    configuration is the keyframe ``home``; the platform frame is a site.

    Parameters
    ----------
    mechanism
        What to write, its home complete.
    path
        File to create or overwrite.
    motors
        Motor joints, in the order of the actuators.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].

    Returns
    -------
    tuple of Note
        What MuJoCo has no word for.

    Raises
    ------
    UnsupportedError
        If MuJoCo cannot express a link, joint, loop, coupling or motor; names it and the remedy.
    """
    for joint in mechanism.joints:
        if joint.kind not in (*_TYPES, JointKind.FIXED, JointKind.FLOATING):
            raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the writer of MJCF")
    for loop in mechanism.loops:
        if loop.kind is JointKind.CABLE:
            raise UnsupportedError(
                f"loop '{loop.name}' is a cable; MuJoCo has spatial tendons, whose length is no joint and drives none: "
                "write it as URDF+"
            )
    writer = _MjcfWriter(mechanism, motors, path.resolve().parent)
    root = writer.write(np.asarray(gravity, dtype=float))
    write_files({path: root})
    lost = (*note_lost_limits(mechanism, "mjcf", balls=("swing",)), *_lost_rates(mechanism, motors))
    return (*writer.notes, *writer.shapes.notes, *lost, *lost_loop_physics(mechanism))


def _lost_rates(mechanism: Mechanism, motors: Sequence[str]) -> Iterator[Note]:
    """Note limits of joints for which there is neither a word of MuJoCo's nor one of ours."""
    for joint in mechanism.joints:
        spans = (
            {key: getattr(joint.bounds, key) for key in ("acceleration", "jerk")} if joint.has_axis else {}
        )
        if joint.has_axis and joint.name not in motors and not np.isfinite(joint.bounds.effort).all():
            spans["effort"] = joint.bounds.effort
        lost = [key for key, span in spans.items() if np.isfinite(span).any()]
        if lost:
            text = f"its limits of {' and '.join(lost)} are left out: 'mjcf' has no word for them"
            yield Note(f"joint '{joint.name}'", text)


class _MjcfWriter:
    def __init__(self, mechanism: Mechanism, motors: Sequence[str], folder: Path) -> None:
        self.mechanism = mechanism
        self.motors = motors
        self.bodies = plan_bodies(mechanism)
        self.elements: dict[str | None, etree._Element] = {}
        self.sites: set[str] = set()
        self.shapes = MjcfShapes(folder)
        self.notes: list[Note] = []
        self.custom = etree.Element("custom")

    def write(self, gravity: FloatArray) -> etree._Element:
        root = etree.Element("mujoco", model=self.mechanism.name)
        etree.SubElement(
            root, "compiler", angle="radian", autolimits="true", balanceinertia="false", inertiafromgeom="false"
        )  # fmt: skip
        etree.SubElement(root, "option", gravity=number_text(gravity))
        tied = bool(self.mechanism.loops or self.mechanism.couplings)
        if tied:
            root.insert(0, etree.Comment(_ABOUT_LOOPS))
            etree.SubElement(etree.SubElement(root, "default"), "equality", solimp=_STIFFEST)
        world = etree.SubElement(root, "worldbody")
        self.elements[None] = world
        for body in self.bodies:
            self._body(body)
        self._vanished()
        self.shapes.finish(root)
        if self.mechanism.platform is not None:
            self._site(self.mechanism.platform, self.mechanism.platform, pin.SE3.Identity())
        if tied:
            write_equalities(root, self.mechanism, self._placements_at_zero(), self._site)
        if self.motors:
            actuators = etree.SubElement(root, "actuator")
            for name in self.motors:
                self._motor(actuators, self.mechanism.joint(name))
        self._home(root, world)
        self._custom(root)
        return root

    def _body(self, body: Body) -> None:
        name = body.link.name
        if name == _WORLD:
            if name != self.mechanism.root:
                raise UnsupportedError(f"link '{name}' moves, and MuJoCo reserves this name; rename the link")
            self.elements[name] = self.elements[None]
            self._note_inertia(body.link, "MuJoCo's world is no body")
            self.shapes.write(self.elements[name], body.link)
            return
        element = etree.SubElement(self.elements[body.parent], "body", name=name)
        place(element, body.placement)
        for joint, placement in body.joints:
            _write_joint(element, joint, placement)
            turned = not np.array_equal(placement.rotation, np.eye(3))
            self.notes += write_physics(element[-1], joint, self.custom, turned=turned)
            # A motor's own limit stands in its actuator.
            effort = joint.bounds.effort
            if joint.has_axis and joint.name not in self.motors and np.isfinite(effort).all() and any(effort):
                element[-1].set("actuatorfrcrange", number_text(effort))
        if body.link.inertia is not None and not is_massless(body.link.inertia):
            self._inertial(element, body.link.name, body.link.inertia)
        else:
            self._note_inertia(body.link, "MuJoCo has no body without mass")
        self.shapes.write(element, body.link)
        self.elements[name] = element

    def _inertial(self, element: etree._Element, name: str, inertia: pin.Inertia) -> None:
        _write_inertial(element, inertia)
        odd = broken_triangle(inertia.inertia)
        if odd:
            text = f"{odd}; MuJoCo refuses it, so the largest is written as the sum of the others"
            self.notes.append(Note(f"link '{name}'", text, Outcome.CHANGED))

    def _note_inertia(self, link: Link, why: str) -> None:
        if link.inertia is not None:
            self.notes.append(Note(f"link '{link.name}'", f"its inertia is left out: {why}"))

    def _vanished(self) -> None:
        """Note what of links and joints MuJoCo has no place for."""
        bodies = {body.link.name for body in self.bodies}
        for link in self.mechanism.links:
            if link.name not in bodies:
                text = "left out: it has no mass, and its joints act in a row in the next body"
                self.notes.append(Note(f"link '{link.name}'", text))
                self.shapes.leave_out(link)
        for joint in self.mechanism.joints:
            if joint.kind is JointKind.FIXED:
                self.notes.append(
                    Note(f"joint '{joint.name}'", "its name is left out: MuJoCo has no fixed joints")
                )

    def _custom(self, root: etree._Element) -> None:
        """Write what MuJoCo has no word for, and hands on: which link is the platform, and limits of speed."""
        custom = self.custom
        if self.mechanism.platform not in (None, PLATFORM):
            etree.SubElement(custom, "text", name=PLATFORM, data=self.mechanism.platform)
        if self.mechanism.assembled:
            etree.SubElement(custom, "text", name=HOME, data=ASSEMBLED)
        for joint in self.mechanism.joints:
            speeds = np.atleast_1d(joint.velocity)
            if joint.has_axis and np.isfinite(speeds).any():
                values = number_text(np.clip(speeds, -UNLIMITED, UNLIMITED))
                etree.SubElement(custom, "numeric", name=f"{SPEED}{joint.name}", data=values)
        if len(custom):
            root.append(custom)

    def _site(self, link: str, name: str, placement: pin.SE3) -> str:
        if name in self.sites:
            raise UnsupportedError(f"two sites would be called '{name}'; rename the loop or the platform")
        self.sites.add(name)
        place(etree.SubElement(self.elements[link], "site", name=name), placement)
        return name

    def _placements_at_zero(self) -> dict[str, pin.SE3]:
        placements: dict[str | None, pin.SE3] = {None: pin.SE3.Identity()}
        for body in self.bodies:
            placements[body.link.name] = placements[body.parent] * body.placement
        return {name: placement for name, placement in placements.items() if name is not None}

    def _motor(self, actuators: etree._Element, joint: Joint) -> None:
        effort = joint.bounds.effort
        if not any(effort):
            raise UnsupportedError(
                f"motor '{joint.name}' has the effort limit 0, which MuJoCo takes for none; raise it, or remove it"
            )
        element = etree.SubElement(actuators, "motor", name=joint.name, joint=joint.name)
        if np.isfinite(effort).any():
            element.set("forcerange", number_text(np.clip(effort, -MUJOCO_FAR, MUJOCO_FAR)))

    def _home(self, root: etree._Element, world: etree._Element) -> None:
        placed = {joint.name: (body, joint, at) for body in self.bodies for joint, at in body.joints}
        values: list[float] = []
        # Document order is MuJoCo's order of coordinates.
        for element in world.iter("joint", "freejoint"):
            body, joint, placement = placed[str(element.get("name"))]
            values.extend(_coordinates(body, joint, placement, self.mechanism.home[joint.name]))
        keyframe = etree.SubElement(root, "keyframe")
        etree.SubElement(keyframe, "key", name="home", qpos=number_text(values))


def _write_joint(body: etree._Element, joint: Joint, placement: pin.SE3) -> None:
    if joint.kind is JointKind.FLOATING:
        # A <freejoint> has no words for damping and the like.
        if joint.physics:
            etree.SubElement(body, "joint", name=joint.name, type="free")
        else:
            etree.SubElement(body, "freejoint", name=joint.name)
        return
    element = etree.SubElement(body, "joint", name=joint.name, type=_TYPES[joint.kind])
    if placement.translation.any():
        element.set("pos", number_text(placement.translation))
    if joint.kind is JointKind.SPHERICAL and joint.turn < np.inf:
        element.set("range", number_text([0.0, joint.turn]))
    if not joint.has_axis:
        return
    element.set("axis", number_text(placement.rotation @ joint.axis))
    if joint.lower == joint.upper:
        raise UnsupportedError(
            f"joint '{joint.name}' has equal limits, which MuJoCo takes for none; make it fixed, or widen them"
        )
    if np.isfinite([joint.lower, joint.upper]).any():
        element.set("range", number_text(np.clip([joint.lower, joint.upper], -MUJOCO_FAR, MUJOCO_FAR)))


def _write_inertial(body: etree._Element, inertia: pin.Inertia) -> None:
    """Write principal moments and axes: MuJoCo's reading of a full matrix loses two digits and refuses laminae."""
    moments, axes = _principal(inertia.inertia)
    element = etree.SubElement(body, "inertial", pos=number_text(inertia.lever))
    if not np.array_equal(axes, np.eye(3)):
        element.set("quat", quaternion_text(axes))
    element.set("mass", number_text([inertia.mass]))
    element.set("diaginertia", number_text(moments))


def _principal(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Diagonalise an inertia: moments (3,) [kg m²] that obey the triangle inequality to the last digit, axes (3, 3)."""
    moments, axes = np.diag(matrix).copy(), np.eye(3)
    if not np.array_equal(matrix, np.diag(moments)):
        moments, axes = np.linalg.eigh(matrix)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    moments = np.maximum(moments, 0.0)
    # Validation lets a lamina miss the inequality by its round-off; MuJoCo does not.
    most = int(np.argmax(moments))
    moments[most] = min(moments[most], moments[most - 1] + moments[most - 2])
    return moments, axes


def _coordinates(body: Body, joint: Joint, placement: pin.SE3, value: FloatArray) -> Iterable[float]:
    """Joint value in MuJoCo's convention: quaternions w x y z, the pose of a free body in the world."""
    if joint.has_axis:
        return value
    if joint.kind is JointKind.SPHERICAL:
        # The same rotation, its axis in the body's frame instead of the joint's.
        x, y, z = placement.rotation @ value[:3]
        return value[3], x, y, z
    pose = pin.SE3ToXYZQUAT(body.placement * pin.XYZQUATToSE3(value))
    return *pose[:3], pose[6], *pose[3:6]
