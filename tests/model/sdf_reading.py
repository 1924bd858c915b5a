"""Small SDFormat files as the reader has them: where links stand, and a four-bar closed in several ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import JointKind, Mechanism
from stewart_pin.model.formats.sdf import read_sdf
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.model.validation import validate
from tests.small_sdf import joint, link, sdf, write

R, S = JointKind.REVOLUTE, JointKind.SPHERICAL


def read(folder: Path, *parts: str, version: str = "1.9", attributes: str = "") -> Mechanism:
    mechanism = read_sdf(write(folder, sdf(*parts, version=version, attributes=attributes)))
    validate(mechanism)
    return mechanism


def standing(mechanism: Mechanism, **values: float) -> dict[str, pin.SE3]:
    """Placements of all links in the world, at home but for the values given."""
    model = build_tree(mechanism, (0, 0, -9.81))
    data, q = pin.Data(model), pin.neutral(model)
    for name, value in {**mechanism.home, **values}.items():
        entry = model.joints[model.getJointId(name)]
        q[entry.idx_q : entry.idx_q + entry.nq] = value
    pin.framesForwardKinematics(model, data, q)
    return {link.name: data.oMf[link_frame(model, link.name)] for link in mechanism.links}


def position(mechanism: Mechanism, link: str, **values: float) -> np.ndarray:
    return np.round(standing(mechanism, **values)[link].translation, 12) + 0.0


FOUR_BAR = (
    link("ground", "0 0 0 0 0 0"),
    joint("hold", "world", "ground", "fixed", xyz=""),
    link("crank", "0 0 0.5 0 0 0"),
    link("coupler", "0.5 0 1 0 0 0"),
    link("rocker", "1 0 0.5 0 0 0"),
    joint("crank_hinge", "ground", "crank", pose="0 0 -0.5 0 0 0", xyz="0 1 0"),
    joint("left_pin", "crank", "coupler", pose="-0.5 0 0 0 0 0", xyz="0 1 0"),
    joint("rocker_hinge", "ground", "rocker", pose="0 0 -0.5 0 0 0", xyz="0 1 0"),
)


def four_bar(*closing: str, xmlns: bool = True) -> tuple[str, dict[str, str]]:
    attributes = 'xmlns:drake="drake.mit.edu"' if xmlns else ""
    return sdf(*FOUR_BAR, *closing, attributes=attributes), {}


CLOSINGS = {
    "a second parent": (joint("right_pin", "coupler", "rocker", pose="0 0 0.5 0 0 0", xyz="0 1 0"), R),
    "a ball": (
        '<joint name="right_pin" type="ball"><pose>0 0 0.5 0 0 0</pose><parent>coupler</parent>'
        "<child>rocker</child></joint>",
        S,
    ),
    "Drake's ball constraint": (
        "<drake:ball_constraint><drake:ball_constraint_body_A>coupler</drake:ball_constraint_body_A>"
        "<drake:ball_constraint_body_B>rocker</drake:ball_constraint_body_B>"
        "<drake:ball_constraint_p_AP>0.5 0 0</drake:ball_constraint_p_AP>"
        "<drake:ball_constraint_p_BQ>0 0 0.5</drake:ball_constraint_p_BQ></drake:ball_constraint>",
        S,
    ),
    "Drake's bushing": (
        '<frame name="one" attached_to="coupler"><pose>0.5 0 0 0 0 0</pose></frame>'
        '<frame name="two" attached_to="rocker"><pose>0 0 0.5 0 0 0</pose></frame>'
        "<drake:linear_bushing_rpy><drake:bushing_frameA>one</drake:bushing_frameA>"
        "<drake:bushing_frameC>two</drake:bushing_frameC>"
        "<drake:bushing_torque_stiffness>5 0 5</drake:bushing_torque_stiffness>"
        "<drake:bushing_torque_damping>1 1 1</drake:bushing_torque_damping>"
        "<drake:bushing_force_stiffness>9 9 9</drake:bushing_force_stiffness></drake:linear_bushing_rpy>",
        R,
    ),
}
