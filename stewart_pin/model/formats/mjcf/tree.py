"""Bodies, joints and sites of MuJoCo's compiled model as links and joints.

MuJoCo hangs any number of joints into one body, each with an anchor and an axis in the body's own frame, and lets
them act in a row. Here a joint moves one link, whose frame it carries: links without inertia stand between the joints
of one body, and between the last one and the body where the anchor is not the body's origin. Coordinates of hinges
and slides are MuJoCo's (``ref`` is honoured); a ball's are the same rotation; those of a free body are its pose
relative to the one in the file, where MuJoCo counts from the world's origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Joint, JointKind, Link, Note, Outcome
from stewart_pin.model.formats.mjcf.bodies import placement_of
from stewart_pin.model.formats.mjcf.compiling import (
    PLATFORM,
    SPEED,
    Asides,
    Names,
    given_names,
    import_mujoco,
)
from stewart_pin.model.formats.mjcf.shapes import read_shapes
from stewart_pin.typing import FloatArray

MUJOCO_FAR = 1e10
"""MuJoCo's mjMAXVAL: no coordinate gets there, so a limit at this value [m or rad] is none."""


@dataclass(frozen=True, eq=False)
class Tree:
    """The tree of a compiled model.

    Attributes
    ----------
    links, joints
        Of the tree; the world first.
    bodies
        Link of every body, by MuJoCo's number.
    joint_names
        Name of every joint, by MuJoCo's number.
    home
        Joint values at MuJoCo's configuration: ``{joint: values}`` [m, rad, quaternion].
    platform
        Link or site that the file names as the platform, or that is called ``platform``; None: there is none.
    notes
        What was made of them.
    """

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    bodies: tuple[str, ...]
    joint_names: tuple[str, ...]
    home: Mapping[str, FloatArray]
    platform: str | None
    notes: tuple[Note, ...]


def read_tree(model: Any, asides: Asides, *, key: int | None, source: str = "") -> Tree:
    """Turn bodies, joints and sites into links and joints.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    asides
        What the file says besides: shapes, name of the platform, limits of speed.
    key
        Number of the keyframe that is home; None: the configuration of the file.
    source
        The file, for messages.

    Returns
    -------
    Tree
        Links and joints; sites that close no loop are links without inertia.

    Raises
    ------
    FileFormatError
        If the file names a platform that is no body and no site.
    """
    return _TreeReader(model, asides, key, source).read()


class _TreeReader:
    def __init__(self, model: Any, asides: Asides, key: int | None, source: str) -> None:
        self.model, self.asides, self.source = model, asides, source
        self.types = import_mujoco().mjtJoint
        bodies, joints = given_names(model, "body", model.nbody), given_names(model, "joint", model.njnt)
        self.link_names, self.joint_names = Names(bodies), Names(joints)
        self.bodies = [name or self.link_names.fresh(f"body_{k}") for k, name in enumerate(bodies)]
        self.named = [name or self._unnamed_joint(k) for k, name in enumerate(joints)]
        self.qpos = np.array(model.qpos0 if key is None else model.key_qpos[key])
        self.mocap = None if key is None else (model.key_mpos[key], model.key_mquat[key])
        self.links: list[Link] = []
        self.joints: list[Joint] = []
        self.home: dict[str, FloatArray] = {}
        self.notes: list[Note] = []

    def read(self) -> Tree:
        shapes = read_shapes(self.model, self.asides.geoms)
        self.notes += shapes.notes
        for name in self.asides.speeds:
            if name not in self.named:
                self.notes.append(Note(f"<numeric name='{SPEED}{name}'>", "no joint of this name"))
        for body in range(self.model.nbody):
            seen, found = shapes.visuals.get(body, ()), shapes.collisions.get(body, ())
            self.links.append(Link(self.bodies[body], _inertia(self.model, body), seen, found))
            if body > 0:
                self._body(body)
        sites = self._sites()
        named = self.asides.platform
        platform = named if named in self.bodies else sites.get(named)
        if platform is None and named != PLATFORM:
            raise FileFormatError(
                f"<text name='{PLATFORM}'> names '{named}', which is no body and no site; correct the name",
                path=self.source,
                culprit=named,
            )
        return Tree(
            links=tuple(self.links),
            joints=tuple(self.joints),
            bodies=tuple(self.bodies),
            joint_names=tuple(self.named),
            home=self.home,
            platform=platform,
            notes=tuple(self.notes),
        )

    def _unnamed_joint(self, joint: int) -> str:
        return self.joint_names.fresh(f"{self.bodies[self.model.jnt_bodyid[joint]]}_joint")

    def _body(self, body: int) -> None:
        model, name = self.model, self.bodies[body]
        parent = self.bodies[model.body_parentid[body]]
        placement = placement_of(model.body_pos[body], model.body_quat[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if model.body_mocapid[body] >= 0:
            placement = self._mocap(body, placement)
        if count == 0:
            self._fix(f"{name}_fixed", parent, name, placement)
            return
        if model.jnt_type[first] == self.types.mjJNT_FREE:
            pose = placement.actInv(self._free_pose(int(model.jnt_qposadr[first])))
            joint = Joint(self.named[first], JointKind.FLOATING, parent, name, placement)
            self._add(joint, pin.SE3ToXYZQUAT(pose))
            return
        self._row(parent, name, placement, range(first, first + count))

    def _row(self, parent: str, body: str, ahead: pin.SE3, joints: range) -> None:
        """Let the joints of a body act in a row; `ahead` is the body's frame in the parent, at zero joint values."""
        anchors = self.model.jnt_pos
        off_centre = bool(np.any(anchors[joints[-1]]))
        between = len(joints) - 1 + off_centre
        carried = [self.link_names.fresh(f"{body}_between_{k + 1}") for k in range(between)]
        self.links += [Link(name) for name in carried]
        carried += [] if off_centre else [body]
        for joint, child in zip(joints, carried, strict=True):
            self._moving(joint, parent, child, ahead * _shift(anchors[joint]))
            ahead, parent = _shift(-anchors[joint]), child
        if off_centre:
            self._fix(f"{body}_fixed", parent, body, ahead)
        if between:
            text = "its joints act in a row, with links without inertia between them and the body"
            self.notes.append(Note(f"body '{body}'", text, Outcome.CHANGED))

    def _moving(self, number: int, parent: str, child: str, placement: pin.SE3) -> None:
        model, name = self.model, self.named[number]
        at = int(model.jnt_qposadr[number])
        if model.jnt_type[number] == self.types.mjJNT_BALL:
            w, x, y, z = self.qpos[at : at + 4] / np.linalg.norm(self.qpos[at : at + 4])
            # MuJoCo limits the whole angle of a ball's rotation.
            joint = Joint(name, JointKind.SPHERICAL, parent, child, placement, turn=self._limits(number)[1])
            self._add(joint, np.array([x, y, z, w]))
            return
        axis, ref = np.array(model.jnt_axis[number]), float(model.qpos0[at])
        kind = JointKind.PRISMATIC
        back = _shift(-ref * axis)
        if model.jnt_type[number] == self.types.mjJNT_HINGE:
            kind, back = JointKind.REVOLUTE, pin.SE3(pin.exp3(-ref * axis), np.zeros(3))
        lower, upper = self._limits(number)
        # The body stands as drawn at the coordinate `ref`.
        placement = placement * back if ref else placement
        speed = self.asides.speeds.get(name, np.inf)
        joint = Joint(name, kind, parent, child, placement, axis, lower, upper, velocity=speed)
        self._add(joint, self.qpos[at : at + 1])

    def _limits(self, number: int) -> tuple[float, float]:
        off = import_mujoco().mjtDisableBit
        if not self.model.jnt_limited[number]:
            return -np.inf, np.inf
        if self.model.opt.disableflags & (off.mjDSBL_LIMIT | off.mjDSBL_CONSTRAINT):
            self.notes.append(
                Note(f"joint '{self.named[number]}'", "its limits: the file disables all limits")
            )
            return -np.inf, np.inf
        lower, upper = (float(value) for value in self.model.jnt_range[number])
        return lower if lower > -MUJOCO_FAR else -np.inf, upper if upper < MUJOCO_FAR else np.inf

    def _free_pose(self, at: int) -> pin.SE3:
        return placement_of(self.qpos[at : at + 3], self.qpos[at + 3 : at + 7])

    def _mocap(self, body: int, placement: pin.SE3) -> pin.SE3:
        text = "a mocap body, moved by hand in MuJoCo: fixed where it stands at home"
        self.notes.append(Note(f"body '{self.bodies[body]}'", text, Outcome.CHANGED))
        if self.mocap is None:
            return placement
        number = int(self.model.body_mocapid[body])
        return placement_of(self.mocap[0].reshape(-1, 3)[number], self.mocap[1].reshape(-1, 4)[number])

    def _sites(self) -> dict[str, str]:
        """Make links of the sites that close no loop; return the link of each named site."""
        model, names = self.model, given_names(self.model, "site", self.model.nsite)
        ends = _loop_sites(model)
        links: dict[str, str] = {}
        for k, name in enumerate(names):
            body = self.bodies[model.site_bodyid[k]]
            if not name or (k in ends and name != self.asides.platform):
                continue
            placement = placement_of(model.site_pos[k], model.site_quat[k])
            if name == body and placement.isApprox(pin.SE3.Identity(), 1e-15):
                links[name] = body
                continue
            links[name] = self.link_names.fresh(name if name not in self.link_names.taken else f"{name}_site")
            self.links.append(Link(links[name]))
            self._fix(f"{links[name]}_fixed", body, links[name], placement)
        return links

    def _fix(self, name: str, parent: str, child: str, placement: pin.SE3) -> None:
        self.joints.append(Joint(self.joint_names.fresh(name), JointKind.FIXED, parent, child, placement))

    def _add(self, joint: Joint, home: FloatArray) -> None:
        self.joints.append(joint)
        self.home[joint.name] = np.array(home, dtype=float)


def _loop_sites(model: Any) -> set[int]:
    """Find the sites at which loops or tendons end: they are the frames of those, and no links."""
    mujoco = import_mujoco()
    ends: set[int] = set()
    for k in range(model.neq):
        if model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE:
            ends |= {int(model.eq_obj1id[k]), int(model.eq_obj2id[k])}
    on_tendons = np.asarray(model.wrap_type) == mujoco.mjtWrap.mjWRAP_SITE
    return ends | {int(site) for site in np.asarray(model.wrap_objid)[on_tendons]}


def _inertia(model: Any, body: int) -> pin.Inertia | None:
    mass, moments = float(model.body_mass[body]), np.array(model.body_inertia[body])
    if body == 0 or (mass == 0 and not moments.any()):
        return None
    axes = placement_of(model.body_ipos[body], model.body_iquat[body])
    matrix = axes.rotation @ np.diag(moments) @ axes.rotation.T
    # Set afterwards: the constructor refuses negative moments with an error that names nothing.
    inertia = pin.Inertia(mass, axes.translation, np.zeros((3, 3)))
    inertia.inertia = (matrix + matrix.T) / 2
    return inertia


def _shift(vector: FloatArray) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array(vector, dtype=float))
