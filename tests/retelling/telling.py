"""A chain told otherwise, and how states go over to it and answers come back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

import stewart_pin as stp

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

    def samples(self, plain: stp.motions.PlatformSamples) -> stp.motions.PlatformSamples:
        """Tell a motion of the platform."""
        W = self.world
        return stp.motions.PlatformSamples(
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
