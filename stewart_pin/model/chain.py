"""The closed chain: a Pinocchio tree, the loops it lacks, the motors, and the platform. Immutable."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.model.description import Coupling, Loop, Mechanism, Report
from stewart_pin.model.leg_points import leg_points
from stewart_pin.model.loop_table import LoopTable, build_loop_table
from stewart_pin.model.motors import mark_motors
from stewart_pin.model.tree import link_frame
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

_UNIT_QUATERNION = 1e-6
"""Deviation from unit length that printed or integrated quaternions may show."""


@dataclass(frozen=True, eq=False)
class ClosedChain:
    """A mechanism with loops, ready for computation.

    Attributes
    ----------
    mechanism
        The description: links, joints, loops.
    model
        Pinocchio model of the spanning tree (a body without a fixed base is a free-flyer joint).
    motors
        Names of the motor joints, in the order of motor coordinates and efforts.
    platform
        Name of the platform frame.
    q_home
        (nq,) home configuration, with the loops closed [m, rad, unit quaternions].
    """

    mechanism: Mechanism
    model: pin.Model = field(repr=False)
    motors: tuple[str, ...]
    platform: str
    q_home: Configuration = field(repr=False)

    def __post_init__(self) -> None:
        home = np.array(self.q_home, dtype=float)
        home.setflags(write=False)
        object.__setattr__(self, "q_home", home)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.mechanism.name

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Loops that the spanning tree leaves open."""
        return self.mechanism.loops

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """Joints that move together by gears, belts or threads."""
        return self.mechanism.couplings

    @property
    def report(self) -> Report:
        """What the file held and the chain does not; print it."""
        return Report(self.mechanism.notes)

    @property
    def nq(self) -> int:
        """Size of the configuration."""
        return self.model.nq

    @property
    def nv(self) -> int:
        """Size of the tangent."""
        return self.model.nv

    @property
    def nu(self) -> int:
        """Number of motors."""
        return len(self.motors)

    @property
    def nc(self) -> int:
        """Number of rows of loops and couplings."""
        return self.loop_table.size

    @property
    def gravity(self) -> FloatArray:
        """(3,) acceleration of free fall in the world frame [m/s²]."""
        return np.array(self.model.gravity.linear)

    @cached_property
    def loop_table(self) -> LoopTable:
        """Loops as arrays, for vectorised evaluation."""
        return build_loop_table(self.mechanism, self.model)

    @cached_property
    def motor_index(self) -> np.ndarray:
        """(nu,) index of each motor in the tangent."""
        joints = [self.model.joints[self.model.getJointId(name)] for name in self.motors]
        return np.array([joint.idx_v for joint in joints], dtype=int)

    @cached_property
    def motor_q_index(self) -> np.ndarray:
        """(nu,) index of each motor in the configuration."""
        joints = [self.model.joints[self.model.getJointId(name)] for name in self.motors]
        return np.array([joint.idx_q for joint in joints], dtype=int)

    @cached_property
    def platform_id(self) -> int:
        """Pinocchio frame id of the platform."""
        return link_frame(self.model, self.platform)

    @cached_property
    def tangent_names(self) -> tuple[str, ...]:
        """Readable name of every tangent entry: the joint, with an axis when the joint has several."""
        names: list[str] = []
        for name, joint in zip(self.model.names[1:], self.model.joints[1:], strict=True):
            axes = {1: ("",), 3: (" wx", " wy", " wz"), 6: (" vx", " vy", " vz", " wx", " wy", " wz")}[
                joint.nv
            ]
            names.extend(name + axis for axis in axes)
        return tuple(names)

    @cached_property
    def length_scale(self) -> float:
        """Size of the robot: the farthest joint, loop or leg end from its link's origin [m]."""
        placements = [joint.placement for joint in self.mechanism.joints]
        for loop in self.loops:
            placements += [loop.placement1, loop.placement2]
        lengths = [float(np.linalg.norm(placement.translation)) for placement in placements]
        size = max([*lengths, *(loop.length for loop in self.loops)], default=0.0)
        return size if size > 0 else 1.0

    @cached_property
    def tangent_scale(self) -> FloatArray:
        """(nv,) natural size of each tangent entry: `length_scale` for lengths [m], 1 for angles [rad]."""
        scale = np.ones(self.nv)
        for joint in self.model.joints[1:]:
            short = joint.shortname()
            if "JointModelP" in short and joint.nv == 1:
                scale[joint.idx_v] = self.length_scale
            elif joint.nv == 6:
                scale[joint.idx_v : joint.idx_v + 3] = self.length_scale
        return scale

    def described(self) -> Mechanism:
        """Return the description with this chain's own motors, platform, home and gravity written into it.

        The motors stand in their order, each where the description had one of them.

        Returns
        -------
        Mechanism
            What a writer needs.
        """
        home: dict[str, FloatArray] = {}
        for name, joint in zip(self.model.names[1:], self.model.joints[1:], strict=True):
            home[name] = self.q_home[joint.idx_q : joint.idx_q + joint.nq]
        x, y, z = map(float, self.gravity)
        return replace(
            mark_motors(self.mechanism, self.motors),
            platform=self.platform,
            home=home,
            home_is_guess=False,
            gravity=(x, y, z),
        )

    def leg_points(self) -> tuple[FloatArray, FloatArray]:
        """Find the ends of the legs that the motors drive.

        Returns
        -------
        base_points : numpy.ndarray
            (nu, 3) in the world frame [m].
        platform_points : numpy.ndarray
            (nu, 3) in the platform frame [m].
        """
        return leg_points(self.mechanism, self.motors, self.platform)


def as_configuration(chain: ClosedChain, name: str, q: ArrayLike) -> Configuration:
    """Check a configuration at the door.

    Parameters
    ----------
    chain
        Closed chain.
    name
        Name of the argument, for the message.
    q
        (nq,) what the caller passed [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nq,) the configuration as float64 [m, rad, unit quaternions].

    Raises
    ------
    InputError
        If the shape is wrong, an entry is not finite, or a quaternion is not of unit length.
    """
    q = as_array(name, q, (chain.nq,))
    if not pin.isNormalized(chain.model, q, _UNIT_QUATERNION):
        raise InputError(
            f"{name} holds a quaternion that is not of unit length; pass pinocchio.normalize(model, q)"
        )
    return q


def as_pose(name: str, pose: pin.SE3) -> pin.SE3:
    """Check a placement at the door.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    pose
        What the caller passed.

    Returns
    -------
    pinocchio.SE3
        The placement.

    Raises
    ------
    InputError
        If it is no placement, or holds no finite numbers or no rotation.
    """
    if not isinstance(pose, pin.SE3):
        raise InputError(f"{name} must be a pinocchio.SE3, got {type(pose).__name__}")
    as_array(f"{name}.translation", pose.translation, (3,))
    as_rotation(f"{name}.rotation", pose.rotation)
    return pose
