"""A torso that a spindle lifts, with the screw between them written by hand as a joint that follows another."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from stewart_pin.typing import FloatArray

THREADS = {"screw_thread_pitch": ("0.05", -0.05 / (2 * np.pi)), "thread_pitch": ("100", 1 / 100)}
"""The torso rises by so much per turn of the spindle, which turns and travels against it [m/rad]: by hand."""

INERTIAL = (
    '<inertial><origin xyz="0.1 -0.2 0.3" rpy="0.2 -0.1 0.4"/><mass value="2"/>'
    '<inertia ixx="0.5" iyy="0.6" izz="0.7" ixy="0.01" ixz="-0.02" iyz="0.03"/></inertial>'
)


def lift(*, of_lift: str = "", more: str = "") -> str:
    """Write column, torso on a slide and spindle on a hinge; what more the slide and the robot hold."""
    places = {"lift": ("torso", "prismatic", "0.1 0 0.4"), "spin": ("spindle", "continuous", "0.2 0 0.3")}
    joints = "".join(
        f'<link name="{child}">{INERTIAL}</link><joint name="{name}" type="{kind}"><parent link="column"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="0 0 1"/>{of_lift if name == "lift" else ""}</joint>'
        for name, (child, kind, xyz) in places.items()
    )
    return f'<robot name="lift"><link name="column"/>{joints}{more}</robot>'


def lift_by_hand(travel: float) -> str:
    return lift(of_lift=f'<mimic joint="spin" multiplier="{travel!r}"/>')


def raised(chain: stp.ClosedChain, rise: float) -> FloatArray:
    """Accelerate the torso after more than two turns of the spindle; return how both move, and what the motor does."""
    q = stp.forward_kinematics(chain, [rise]).q
    J_c = stp.loop_jacobian(chain, q)
    (v,) = np.linalg.svd(J_c).Vh[np.linalg.matrix_rank(J_c) :]
    lift = chain.model.idx_vs[chain.model.getJointId("lift")]
    v *= 0.7 / v[lift]
    a = stp.forward_dynamics(chain, q, v, [0.3]).a
    by_pinocchio = stp.inverse_dynamics(chain, q, v, a).tau_motor
    by_rows = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix").tau_motor
    turn = stp.platform_pose(chain, q).rotation[:2, 0]
    return np.concatenate([turn, [a[lift]], by_pinocchio, by_rows])
