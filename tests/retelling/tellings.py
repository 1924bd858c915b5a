"""The same mechanism told in another legal way, and how to carry states and answers over and back.

Most tellings are one `Change` of the description: frames of links moved, joints reversed, their zeros shifted, parts in
another order. Each is written to a file and read again, so that the reader is part of what is told.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from tests.rewritten import carry_over, recut

ONE = pin.SE3.Identity()
State = tuple[np.ndarray, np.ndarray, np.ndarray]


def turn(*rotation: float, shift: tuple[float, float, float] = (0, 0, 0)) -> pin.SE3:
    """Make a placement of a rotation vector and a shift."""
    return pin.SE3(pin.exp3(np.array(rotation, dtype=float)), np.array(shift, dtype=float))


@dataclass(frozen=True, eq=False)
class Told:
    """How the value of one joint is told: ``sign × value + zero``, or for a joint of many freedoms ``A⁻¹ M B``."""

    sign: float = 1.0
    zero: float = 0.0
    before: pin.SE3 = field(default_factory=pin.SE3.Identity)
    after: pin.SE3 = field(default_factory=pin.SE3.Identity)

    def value(self, value: np.ndarray) -> np.ndarray:
        """Tell a value, Pinocchio's convention."""
        if value.size == 1:
            return self.sign * value + self.zero
        moved = self.before.inverse() * _placement(value) * self.after
        whole = pin.SE3ToXYZQUAT(moved)
        return whole if value.size == 7 else whole[3:]

    def back(self) -> Told:
        """Turn the telling round."""
        return Told(self.sign, -self.sign * self.zero, self.before.inverse(), self.after.inverse())

    def rates(self, nv: int) -> np.ndarray:
        """(nv, nv) map of the tangent."""
        if nv == 1:
            return np.array([[self.sign]])
        turned = self.after.inverse().action
        return turned if nv == 6 else turned[3:, 3:]


def _placement(value: np.ndarray) -> pin.SE3:
    shift, turned = (value[:3], value[3:]) if value.size == 7 else (np.zeros(3), value)
    return pin.XYZQUATToSE3(np.concatenate([shift, turned]))


@dataclass(frozen=True, eq=False)
class Telling:
    """A chain told otherwise, with the way from the plain one.

    Attributes
    ----------
    name
        What is told otherwise.
    plain, chain
        The chain as it is bundled, and as it is told.
    joints
        How joints tell their values; those not named tell the plain ones.
    world
        Plain world in the told one.
    carry
        How a state is carried over where the joints are others; None: joint by joint.
    same_rows
        Whether the rows of loops are the plain ones, but for turned frames.
    same_gap
        Whether open loops have the plain gaps, but for turned frames.
    same_limits
        Whether all limits are told: MuJoCo has none for speeds.
    exact
        Whether nothing but round-off is lost.
    tolerance
        Relative size of what is lost in telling: round-off, or the digits that were printed.
    """

    name: str
    plain: stp.ClosedChain
    chain: stp.ClosedChain
    joints: Mapping[str, Told] = field(default_factory=dict)
    world: pin.SE3 = field(default_factory=pin.SE3.Identity)
    carry: Callable[[np.ndarray, np.ndarray, np.ndarray], State] | None = None
    same_rows: bool = True
    same_gap: bool = True
    same_limits: bool = True
    exact: bool = True
    tolerance: float = 1e-9

    @property
    def same_size(self) -> bool:
        """Whether lengths and angles are compared as before: joints that stand elsewhere make another size."""
        return abs(self.chain.length_scale / self.plain.length_scale - 1) <= self.tolerance

    @property
    def turned_base(self) -> bool:
        """Whether the world is another one."""
        return not self.world.isIdentity(1e-12)

    @property
    def joint_by_joint(self) -> bool:
        """Whether the tangents correspond."""
        return self.carry is None

    # --- to the told chain -----------------------------------------------------------------------------------

    def q(self, q: np.ndarray) -> np.ndarray:
        """Tell a configuration as it is, open or closed."""
        return _joint_by_joint(self.plain, self.chain, self.joints, q)

    def state(self, q: np.ndarray, v: np.ndarray | None = None, a: np.ndarray | None = None) -> State:
        """Tell a state with closed loops; printed digits open them by a little."""
        v, a = (np.zeros(self.plain.nv) if x is None else x for x in (v, a))
        if self.carry is not None:
            return self.carry(q, v, a)
        q, v, a = self.q(q), self.T @ v, self.T @ a
        if not self.exact:
            q = stp.close_loops(self.chain, q).q
            rows = self.chain.at(q, v).J_c * self.chain.tangent_scale
            least = self.chain.tangent_scale[:, None] * np.linalg.pinv(rows, rcond=1e-6)
            v = v - least @ (self.chain.at(q).J_c @ v)
            a = a - least @ (self.chain.at(q).J_c @ a + stp.loop_bias(self.chain, q, v))
        return q, v, a

    @cached_property
    def T(self) -> np.ndarray:
        """(nv, nv) told tangent per plain one."""
        T = np.zeros((self.chain.nv, self.plain.nv))
        for name, joint, other in _pairs(self.plain, self.chain):
            rows, columns = (slice(j.idx_v, j.idx_v + j.nv) for j in (other, joint))
            T[rows, columns] = self.joints.get(name, Told()).rates(joint.nv)
        return T

    @cached_property
    def order(self) -> np.ndarray:
        """Index of each plain motor among the told ones."""
        return np.array([self.chain.motors.index(name) for name in self.plain.motors])

    @cached_property
    def signs(self) -> np.ndarray:
        """(nu,) sign of each plain motor."""
        return np.array([self.joints.get(name, Told()).sign for name in self.plain.motors])

    @cached_property
    def zeros(self) -> np.ndarray:
        """(nu,) what each motor reads where the plain one reads zero."""
        return np.array([self.joints.get(name, Told()).zero for name in self.plain.motors])

    def readings(self, plain: np.ndarray) -> np.ndarray:
        """Tell motor positions."""
        told = np.empty_like(plain)
        told[..., self.order] = self.signs * plain + self.zeros
        return told

    def efforts(self, plain: np.ndarray) -> np.ndarray:
        """Tell motor rates or efforts."""
        told = np.empty_like(plain)
        told[..., self.order] = self.signs * plain
        return told

    def sizes(self, plain: np.ndarray) -> np.ndarray:
        """Tell what motors have without sign, as a stiffness or a limit."""
        told = np.empty_like(plain)
        told[..., self.order] = plain
        return told

    def turned(self, plain: np.ndarray) -> np.ndarray:
        """Turn the vectors that make up a twist, a wrench or a row of them into the told world."""
        shape = plain.shape
        return (plain.reshape(-1, 3) @ self.world.rotation.T).reshape(shape)

    def samples(self, plain: stp.PlatformSamples) -> stp.PlatformSamples:
        """Tell a motion of the platform."""
        W = self.world
        return stp.PlatformSamples(
            plain.time,
            plain.position @ W.rotation.T + W.translation,
            W.rotation @ plain.rotation,
            self.turned(plain.twist),
            self.turned(plain.acceleration),
        )

    # --- and back --------------------------------------------------------------------------------------------

    def motors(self, told: np.ndarray, axis: int = -1) -> np.ndarray:
        """Bring rates or efforts of motors, or a matrix with motors along an axis, back."""
        told = np.moveaxis(np.asarray(told), axis, -1)[..., self.order] * self.signs
        return np.moveaxis(told, -1, axis)

    def unsigned(self, told: np.ndarray) -> np.ndarray:
        """Bring back what motors have without sign."""
        return np.asarray(told)[..., self.order]

    def positions(self, told: np.ndarray) -> np.ndarray:
        """Bring motor positions back."""
        return (np.asarray(told)[..., self.order] - self.zeros) * self.signs

    def twists(self, told: np.ndarray, axis: int = -1) -> np.ndarray:
        """Bring vectors in world axes back, along an axis of length 3 or 6."""
        told = np.moveaxis(np.asarray(told), axis, -1)
        turned = (told.reshape(-1, 3) @ self.world.rotation).reshape(told.shape)
        return np.moveaxis(turned, -1, axis)

    def pose(self, told: pin.SE3) -> np.ndarray:
        """Bring a pose back."""
        return (self.world.inverse() * told).homogeneous[:3]

    def tangent(self, told: np.ndarray) -> np.ndarray:
        """Bring tangent vectors, as columns, back."""
        return np.linalg.solve(self.T, told)

    def cotangent(self, told: np.ndarray) -> np.ndarray:
        """Bring joint efforts, as columns, back."""
        return self.T.T @ told

    def configuration(self, told: np.ndarray) -> np.ndarray:
        """Bring a configuration back, rotations as matrices: a quaternion has two signs."""
        back = {name: joint.back() for name, joint in self.joints.items()}
        q = _joint_by_joint(self.chain, self.plain, back, told)
        parts = [np.zeros(0)]
        for joint in self.plain.model.joints[1:]:
            value = q[joint.idx_q : joint.idx_q + joint.nq]
            parts.append(value if value.size == 1 else _placement(value).homogeneous[:3].ravel())
        return np.concatenate(parts)


def _pairs(one: stp.ClosedChain, two: stp.ClosedChain):
    for name, joint in zip(one.model.names[1:], one.model.joints[1:], strict=True):
        if two.model.existJointName(name):
            yield name, joint, two.model.joints[two.model.getJointId(name)]


def _joint_by_joint(
    one: stp.ClosedChain, two: stp.ClosedChain, joints: Mapping[str, Told], q: np.ndarray
) -> np.ndarray:
    told = two.q_home.copy()
    for name, joint, other in _pairs(one, two):
        value = q[joint.idx_q : joint.idx_q + joint.nq]
        told[other.idx_q : other.idx_q + other.nq] = joints.get(name, Told()).value(value)
    return told


# --- a change of the description -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Change:
    """What is told otherwise of a description.

    Attributes
    ----------
    links
        Told frame of a link in the plain one. The axis of the joint above has to keep its line.
    joints
        Signs and zeros of joints; those of many freedoms may turn their frame (`before`).
    loops
        Told frames 1 and 2 of a loop in the plain ones.
    mirrored
        Whether links, joints and loops stand in the file the other way round.
    swapped
        Whether loops go from link 2 to link 1.
    """

    links: Mapping[str, pin.SE3] = field(default_factory=dict)
    joints: Mapping[str, Told] = field(default_factory=dict)
    loops: Mapping[str, tuple[pin.SE3, pin.SE3]] = field(default_factory=dict)
    mirrored: bool = False
    swapped: bool = False


def changed(old: Mechanism, change: Change) -> tuple[Mechanism, dict[str, Told]]:
    """Tell a description otherwise, and say how its joints tell their values."""
    frame = lambda link: change.links.get(link, ONE)  # noqa: E731 - a look-up
    told = {}

    def joint(j: Joint) -> Joint:
        how, above, own = change.joints.get(j.name, Told()), frame(j.parent).inverse(), frame(j.child)
        if not j.has_axis:
            told[j.name] = how = replace(how, after=own)
            # A fixed joint has no value: its placement carries both ends.
            end = own if j.kind is JointKind.FIXED else how.before
            return replace(j, placement=above * j.placement * end)
        told[j.name] = how
        # With the told value x = sign q + zero: plain motion(q) = motion along the told axis(x) after one of -zero.
        turning = j.kind is JointKind.REVOLUTE
        back = -how.sign * how.zero * j.axis
        start = turn(*back) if turning else turn(0, 0, 0, shift=tuple(back))
        ends = sorted(how.sign * x + how.zero for x in (j.lower, j.upper))
        return replace(
            j,
            placement=above * j.placement * start * own,
            axis=own.rotation.T @ (how.sign * j.axis),
            lower=ends[0],
            upper=ends[1],
        )

    def link(part: Link) -> Link:
        body = part.inertia
        return part if body is None else replace(part, inertia=body.se3ActionInverse(frame(part.name)))

    def loop(p: Loop) -> Loop:
        one, two = change.loops.get(p.name, (ONE, ONE))
        moved = replace(
            p,
            placement1=frame(p.link1).inverse() * p.placement1 * one,
            placement2=frame(p.link2).inverse() * p.placement2 * two,
            axis=one.rotation.T @ p.axis,
            axis2=two.rotation.T @ p.axis2,
        )
        return _swapped(moved) if change.swapped else moved

    links, joints, loops = map(link, old.links), map(joint, old.joints), map(loop, old.loops)
    step = -1 if change.mirrored else 1
    gravity = None if old.gravity is None else frame(old.root).rotation.T @ np.array(old.gravity)
    new = replace(
        old,
        links=tuple(links)[::step],
        joints=tuple(joints)[::step],
        loops=tuple(loops)[::step],
        gravity=None if gravity is None else (float(gravity[0]), float(gravity[1]), float(gravity[2])),
    )
    home = {name: told[name].value(np.atleast_1d(value)) for name, value in old.home.items()}
    return replace(new, home=home), told


def _swapped(loop: Loop) -> Loop:
    axis, axis2 = (loop.axis2, loop.axis) if loop.kind is JointKind.UNIVERSAL else (loop.axis, loop.axis2)
    return replace(
        loop,
        link1=loop.link2,
        link2=loop.link1,
        placement1=loop.placement2,
        placement2=loop.placement1,
        axis=axis,
        axis2=axis2,
    )


def _save(chain: stp.ClosedChain, folder: Path, format: str = "urdf+", digits: int | None = None) -> Path:
    """Write a chain in a format, its numbers with so many digits."""
    path = folder / (f"{chain.name}.xml" if format == "mjcf" else f"{chain.name}.urdf")
    stp.export(chain, path, format=format)
    if digits is not None:
        number = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
        text = re.sub(
            r'(?<!name)(?<!link)="([^"]*)"',
            lambda m: '="' + number.sub(lambda n: f"{float(n[0]):.{digits}g}", m[1]) + '"',
            path.read_text(encoding="utf-8"),
        )
        path.write_text(text, encoding="utf-8")
    return path


def by_change(
    name: str,
    plain: stp.ClosedChain,
    change: Change,
    folder: Path,
    save: Callable[[stp.ClosedChain, Path], Path] = _save,
    **more: Any,
) -> Telling:
    """Write a changed description, and read it."""
    old = plain.described()
    mechanism, joints = changed(old, change)
    # The order of the file is that of the motors.
    path = save(build_chain(mechanism, platform=plain.platform), folder)
    world = change.links.get(old.root, ONE).inverse()
    return Telling(name, plain, stp.load(path), joints, world, same_gap=not change.swapped, **more)


# --- the tellings --------------------------------------------------------------------------------------------


def _axes(chain: stp.ClosedChain) -> list[Joint]:
    return [joint for joint in chain.mechanism.joints if joint.has_axis]


def _reversed(chain: stp.ClosedChain, each: int = 1) -> Change:
    return Change(joints={joint.name: Told(sign=-1.0) for joint in _axes(chain)[::each]})


def _shifted(chain: stp.ClosedChain) -> Change:
    size = {JointKind.REVOLUTE: 0.3, JointKind.PRISMATIC: 0.2 * chain.length_scale}
    return Change(
        joints={j.name: Told(zero=size[j.kind] * (1 + 0.1 * k)) for k, j in enumerate(_axes(chain))}
    )


def _turned(chain: stp.ClosedChain) -> Change:
    """Turn every link but the platform, and those fixed to something: how much depends on the joint above."""
    links, joints = {}, {}
    for k, j in enumerate(chain.mechanism.joints):
        shift = (0.07 + 0.01 * k) * chain.length_scale
        match j.kind:
            case JointKind.REVOLUTE:
                move = turn(*((0.5 + 0.2 * k) * j.axis), shift=tuple(shift * j.axis))
            case JointKind.PRISMATIC:
                move = turn(0.4, -0.3 - 0.1 * k, 0.6, shift=(shift, -shift, 0.5 * shift))
            case JointKind.SPHERICAL:
                move = turn(0.4, -0.3 - 0.1 * k, 0.6)
                joints[j.name] = Told(before=turn(-0.2, 0.3, 0.5))
            case JointKind.FLOATING:
                move = turn(0.4, -0.3, 0.6, shift=(shift, 0, -shift))
                joints[j.name] = Told(before=turn(-0.2, 0.3, 0.5, shift=(0, shift, shift)))
            case _:
                move = turn(0.2, 0.1, -0.3, shift=(shift, 0, 0))
        links[j.child] = ONE if j.child == chain.platform else move
    return Change(links=links, joints=joints)


def _turned_loops(chain: stp.ClosedChain) -> Change:
    loops = {}
    for k, p in enumerate(chain.loops):
        angles = (0.4 + 0.1 * k, -0.7)
        if p.kind is JointKind.SPHERICAL:
            loops[p.name] = (turn(0.3, angles[0], -0.2), turn(angles[1], 0.1, 0.5))
        elif p.kind is JointKind.REVOLUTE:
            loops[p.name] = (turn(*(angles[0] * p.axis)), turn(*(angles[1] * p.axis)))
    return Change(loops=loops)


def _moved(chain: stp.ClosedChain) -> Change:
    L = chain.length_scale
    return Change(links={chain.mechanism.root: turn(0.7, -0.4, 1.1, shift=(0.8 * L, -0.5 * L, 0.3 * L))})


def _all_at_once(chain: stp.ClosedChain) -> Change:
    signs, zeros, turned = _reversed(chain, 2).joints, _shifted(chain).joints, _turned(chain)
    joints = {name: replace(told, sign=signs.get(name, Told()).sign) for name, told in zeros.items()}
    return Change(
        links={**turned.links, **_moved(chain).links},
        joints={**turned.joints, **joints},
        loops=_turned_loops(chain).loops,
        mirrored=True,
        swapped=True,
    )


_CHANGES: dict[str, Callable[[stp.ClosedChain], Change]] = {
    "every axis reversed": _reversed,
    "every second axis reversed": lambda chain: _reversed(chain, 2),
    "zeros shifted": _shifted,
    "frames turned": _turned,
    "loop frames turned": _turned_loops,
    "legs in another order": lambda chain: Change(mirrored=True),
    "loops from the other side": lambda chain: Change(swapped=True),
    "base moved and turned": _moved,
    "all at once": _all_at_once,
}


def _on_a_pedestal(name: str, plain: stp.ClosedChain, folder: Path) -> Telling:
    """Give the tree another root, to which the base is fixed."""
    old, place = plain.described(), turn(-0.3, 0.9, 0.2, shift=(0.1, 0.4, -0.2))
    x, y, z = (place.rotation @ plain.gravity).tolist()
    mechanism = replace(
        old,
        links=(Link("pedestal"), *old.links),
        joints=(Joint("bolts", JointKind.FIXED, "pedestal", old.root, place), *old.joints),
        gravity=(x, y, z),
    )
    path = _save(build_chain(mechanism, motors=plain.motors, platform=plain.platform), folder)
    return Telling(name, plain, stp.load(path), world=place)


def _cut_elsewhere(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    other = recut(plain)
    if other is None:
        return None
    told = stp.load(_save(other, folder))
    # Idle freedoms get the least motion, counted over other joints: a thin rod then spins otherwise.
    tolerance = 1e-6 if stp.mobility(plain).idle else 1e-9
    carry = partial(carry_over, plain, told)
    return Telling(name, plain, told, carry=carry, same_rows=False, tolerance=tolerance)


def _by_balls(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    if all(loop.kind is JointKind.SPHERICAL for loop in plain.loops):
        return None
    return Telling(name, plain, stp.load(_save(stp.loops_by_balls(plain), folder)), same_rows=False)


@dataclass(frozen=True)
class _Written:
    """Everything told otherwise, or nothing, in another format or with fewer digits."""

    format: str = "urdf+"
    digits: int | None = None
    changed: bool = True

    def __call__(self, name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
        # MuJoCo has no hinge as a loop: two balls stand for it.
        more: dict[str, Any] = {"same_rows": self.format != "mjcf", "same_limits": self.format != "mjcf"}
        if self.digits is not None:
            # A number keeps half a unit of its last digit; elimination multiplies that by condition numbers near 100.
            more["exact"] = False
            more["tolerance"] = 200 * 0.5 * 10.0 ** (1 - self.digits)
        try:
            return by_change(
                name,
                plain,
                _all_at_once(plain) if self.changed else Change(),
                folder,
                partial(_save, format=self.format, digits=self.digits),
                **more,
            )
        except stp.errors.UnsupportedError:
            return None


_OTHERS: dict[str, Callable[[str, stp.ClosedChain, Path], Telling | None]] = {
    "on a pedestal": _on_a_pedestal,
    "cut elsewhere": _cut_elsewhere,
    "hinges as balls": _by_balls,
    "all at once in Drake": _Written("drake"),
    "all at once in Isaac": _Written("isaac"),
    "all at once in Gepetto": _Written("gepetto"),
    "all at once in MJCF": _Written("mjcf"),
    "six digits": _Written(digits=6, changed=False),
    "nine digits": _Written(digits=9, changed=False),
    "all at once with six digits": _Written(digits=6),
    "all at once with nine digits": _Written(digits=9),
}

TELLINGS = (*_CHANGES, *_OTHERS)
"""Names of the ways to tell a mechanism."""


def tell(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    """Tell a chain otherwise; None where this way has no words for it."""
    if name in _OTHERS:
        return _OTHERS[name](name, plain, folder)
    change = _CHANGES[name](plain)
    if name == "loop frames turned" and not change.loops:
        return None
    return by_change(name, plain, change, folder)
