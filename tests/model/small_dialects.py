"""A four-bar and its closing in the words of every dialect, and what makes two of them the same mechanism."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from tests.small_urdf import AXIS_Z, FOUR_BAR, MOTOR, SQUARE, home, joint, link, loop, robot

TIP = 'xyz="1 0 0"'
TIPS = f"<parent_origin {TIP}/><child_origin {TIP}/>"
FRAMES = (
    link("closing_pin_1", ""),
    joint("frame1", "platform", "closing_pin_1", "fixed", origin=TIP),
    link("closing_pin_2", ""),
    joint("frame2", "rocker", "closing_pin_2", "fixed", origin=TIP),
)
Z_FRAMES = (
    link("closing_pin_1_z", ""),
    joint("frame1_z", "platform", "closing_pin_1_z", "fixed", origin='xyz="1 0 0.1"'),
    link("closing_pin_2_z", ""),
    joint("frame2_z", "rocker", "closing_pin_2_z", "fixed", origin='xyz="1 0 0.1"'),
)
BALL = loop("pin", "spherical", "platform", "rocker", origin1=TIP, origin2=TIP)
HINGE = loop("pin", "revolute", "platform", "rocker", origin1=TIP, origin2=TIP, content=AXIS_Z)
ENDS = '<parent link="platform"/><child link="rocker"/>'
DRAKE_BALL = (
    '<drake:ball_constraint><drake:ball_constraint_body_A name="platform"/>'
    '<drake:ball_constraint_body_B name="rocker"/><drake:ball_constraint_p_AP value="1 0 0"/>'
    '<drake:ball_constraint_p_BQ value="1 0 0"/></drake:ball_constraint>'
)


def bushing(torque: str = "9 8 0", force: str = "1 2 3") -> str:
    frames = "".join(
        f'<frame name="{link}_pin" link="{link}" xyz="1 0 0"/>' for link in ("platform", "rocker")
    )
    return (
        f'{frames}<drake:linear_bushing_rpy><drake:bushing_frameA name="platform_pin"/>'
        f'<drake:bushing_frameC name="rocker_pin"/><drake:bushing_torque_stiffness value="{torque}"/>'
        f'<drake:bushing_torque_damping value="1 1 1"/><drake:bushing_force_stiffness value="{force}"/>'
        "</drake:linear_bushing_rpy>"
    )


BALLS = {
    "isaac": '<loop_joint name="pin" type="spherical"><link1 link="platform" rpy="0 0 0" xyz="1 0 0"/>'
    '<link1 link="rocker" rpy="0 0 0" xyz="1 0 0"/></loop_joint>',
    "isaac link2": '<loop_joint name="pin" type="ball"><link1 link="platform" xyz="1 0 0"/>'
    '<link2 link="rocker" xyz="1 0 0"/></loop_joint>',
    "fusion": f'<loop_joint name="pin" type="spherical">{ENDS}{TIPS}</loop_joint>',
    "drake": DRAKE_BALL,
    "drake bushing": bushing("0 0 0"),
    "urdfdom": f'<constraint name="pin" type="spherical">{ENDS}{TIPS}</constraint>',
    "closing frames": "".join(FRAMES),
}
HINGES = {
    "drake bushing": bushing(),
    "old drake": '<loop_joint name="pin" type="revolute"><link1 link="platform" xyz="1 0 0"/>'
    f'<link2 link="rocker" xyz="1 0 0"/>{AXIS_Z}</loop_joint>',
    "fusion": f'<loop_joint name="pin" type="revolute">{ENDS}{TIPS}'
    '<axis xyz="0 0 1" frame="parent"/></loop_joint>',
    "urdfdom": f'<constraint name="pin" type="revolute">{ENDS}<parent_origin {TIP} rpy="0 0 0.3"/>'
    f'<parent_axis xyz="0 0 1"/><child_origin {TIP} rpy="1.5707963267948966 0 0"/><child_axis xyz="0 1 0"/>'
    "</constraint>",
    "closing frames": "".join((*FRAMES, *Z_FRAMES)),
}


def square(*parts: str) -> str:
    return robot(*FOUR_BAR, *parts, home(**SQUARE), attributes='xmlns:drake="http://drake.mit.edu"')


def assert_same_motion(chain: stp.ClosedChain, other: stp.ClosedChain, rng: np.random.Generator) -> None:
    """Compare what the loops do, whatever frames they are written in: closed states, and the motor's effort."""
    assert chain.nv == other.nv and chain.motors == other.motors
    np.testing.assert_allclose(chain.q_home, other.q_home, atol=1e-9)
    q = other.q_home + 0.2 * rng.normal(size=other.nq)
    # The same loop in other frames: the same null space of its Jacobian.
    ours, theirs = (np.linalg.svd(stp.loop_jacobian(c, q)) for c in (chain, other))
    rank = int((theirs.S > 1e-9).sum())
    assert int((ours.S > 1e-9).sum()) == rank
    np.testing.assert_allclose(ours.Vh[rank:] @ theirs.Vh[:rank].T, 0, atol=1e-9)
    q = stp.close_loops(other, q).q
    assert np.abs(stp.loop_gap(chain, q)).max() < 1e-9
    v, a = np.zeros((2, other.nv))
    ours, theirs = (stp.inverse_dynamics(c, q, v, a).tau_motor for c in (chain, other))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def open_square(*parts: str) -> str:
    """Put the four-bar together as Gazebo does: the joints' origins make the square, all values are zero."""
    up, side = 'xyz="0 0 0" rpy="0 0 1.5707963267948966"', 'xyz="1 0 0" rpy="0 0 1.5707963267948966"'
    return robot(
        *FOUR_BAR[:4],
        joint("crank_turn", "base", "crank", origin=up, attributes=MOTOR),
        joint("coupler_turn", "crank", "platform", origin='xyz="1 0 0" rpy="0 0 -1.5707963267948966"'),
        joint("rocker_turn", "base", "rocker", origin=side),
        *parts,
    )


GAZEBO = (
    '<gazebo><joint name="pin" type="{kind}"><parent>platform</parent><child>rocker</child>'
    "<pose>1 0 0 0 0 0.4</pose>{axis}</joint></gazebo>"
)
YAML = """closed_loop: [['closedloop1_A', 'closedloop1_B']]
type: ['{kind}']
name_mot: ['mot1', 'mot2']
"""


def five_bar(*parts: str) -> str:
    """Write a five-bar as the dialect's own example does: the loop's frames are joints that only carry a frame."""
    x, half = 'xyz="1 0 0"', 'rpy="0 0 -1.5707963267948966"'
    return robot(
        link("base"),
        *(link(name) for name in ("left", "platform", "right", "far")),
        *(link(name, "") for name in ("sphere", "sphere_2")),
        joint("mot2", "base", "right", origin=f'{x} rpy="0 0 1.5707963267948966"'),
        joint("mot1", "base", "left", origin='rpy="0 0 1.5707963267948966"'),
        joint("free1", "left", "platform", origin=f"{x} {half}"),
        joint("free2", "right", "far", origin=f"{x} {half}"),
        joint("closedloop1_A", "platform", "sphere", "fixed", origin='xyz="0.5 0.5 0"'),
        joint("closedloop1_B", "far", "sphere_2", "fixed", origin='xyz="-0.5 0.5 0"'),
        *parts,
    )


PLUGIN = (
    '<gazebo><plugin filename="libroboticsgroup_gazebo_mimic_joint_plugin.so" name="m"><joint>elbow</joint>'
    "<mimicJoint>follow</mimicJoint><multiplier>-2.0</multiplier><offset>0.5</offset><hasPID/></plugin></gazebo>"
)


def drake_joint(kind: str, content: str = "") -> str:
    return (
        f'<drake:joint name="j" type="{kind}"><parent link="base"/><child link="platform"/>'
        f"<origin {TIP}/>{content}</drake:joint>"
    )


def transmission(joint_name: str) -> str:
    return (
        f'<transmission name="t_{joint_name}"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{joint_name}"/><actuator name="m"><drake:rotor_inertia value="1"/></actuator></transmission>'
    )
