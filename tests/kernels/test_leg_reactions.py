"""Reactions leg by leg against the one-state verb and the whole tree."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.function_set import Coordinates
from stewart_pin.kernels.graph.leg_reactions import reactions_function
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, place_platform
from stewart_pin.kernels.kernels import compile_kernels, count_operations
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, robot, slow_but_for_few
from tests.kernels.platforms import PLATFORMS, delta
from tests.kernels.test_compile import kernels, platform_states
from tests.kernels.test_platform_dynamics import call, platform, states
from tests.kernels.tied_platforms import TIED, carts, in_the_tree, swapped

AGREE = 1e-10
BUNDLED = ("stewart", "stewart_sps", "stewart_cad", "stewart_s1", "rpr_planar", "delta", "hexapod_rss")
"""Robots that come apart into legs."""


@cache
def placed_platform(name: str) -> PlacedPlatform:
    return place_platform(plan_platform(TIED[name]())) if name in TIED else platform(name)


@pytest.mark.parametrize("name", [*PLATFORMS, *TIED])
def test_reactions_agree_with_the_one_state_verb(name: str, rng: np.random.Generator) -> None:
    placed = placed_platform(name)
    reactions = reactions_function(placed)
    for pose, twist, acceleration, s in states(placed, rng, 2):
        expected = stp.inverse_dynamics(placed.plan.chain, s.q, s.v, s.a).lambda_c
        close(call(reactions, pose, twist, acceleration), expected, AGREE)


@pytest.mark.parametrize("name", slow_but_for_few(BUNDLED, ["stewart", "rpr_planar"]))
def test_reactions_of_bundled_robots(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    assert many.report.route == "legs"
    tree = many.casadi("tree_inverse_dynamics")
    whole, (pose, twist, acceleration, _) = platform_states(many, rng, 3)
    reactions = many.reactions(pose, twist, acceleration)
    for k, s in enumerate(whole):
        close(reactions[k], stp.inverse_dynamics(many.chain, s.q, s.v, s.a).lambda_c, AGREE)
        close(reactions[k], np.array(tree(s.q, s.v, s.a)[1]).ravel(), AGREE)
    assert many.casadi("reactions").name_in() == ["pose", "twist", "acceleration"]


def test_reactions_move_the_platform(rng: np.random.Generator) -> None:
    # Newton and Euler by hand: the balls, on the platform as link 1, give what its motion and its weight ask for.
    many, chain = kernels("stewart"), robot("stewart")
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    reactions = many.reactions(pose, twist, acceleration).reshape(-1, 6, 3)
    points = np.array([loop.placement1.translation for loop in chain.loops])
    inertia = chain.model.inertias[chain.model.frames[chain.platform_id].parentJoint]
    for k in range(2):
        back = pin.XYZQUATToSE3(pose[k]).rotation.T
        omega, rate = back @ twist[k, 3:], back @ acceleration[k, 3:]
        force = inertia.mass * (back @ (acceleration[k, :3] - chain.gravity))
        moment = inertia.inertia @ rate + np.cross(omega, inertia.inertia @ omega)
        close(-reactions[k].sum(axis=0), force, AGREE)
        close(-np.cross(points, reactions[k]).sum(axis=0), moment, AGREE)


def test_forces_that_legs_cannot_share_out_come_from_the_tree(rng: np.random.Generator) -> None:
    many = compile_kernels(in_the_tree(carts()))
    assert many.report.route == "legs"
    assert many.casadi("reactions").name_in()[0] == "q"
    whole, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    reactions = many.reactions(pose, twist, acceleration)
    for k, s in enumerate(whole):
        close(reactions[k], stp.inverse_dynamics(many.chain, s.q, s.v, s.a).lambda_c, AGREE)


@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_rows_on_rods_that_may_spin_are_refused(coordinates: Coordinates) -> None:
    # Where the rods stand about their own axes follows neither from the pose nor from the motors.
    many = compile_kernels(swapped(robot("stewart_sps")), coordinates=coordinates)
    with pytest.raises(UnsupportedError, match="'leg1_ball' are told in axes of 'leg1_upper'"):
        many.casadi("reactions")
    assert many.casadi("inverse_dynamics").name_in()[0] == "pose"


def test_a_demand_that_the_platform_cannot_follow_has_a_code(rng: np.random.Generator) -> None:
    many = kernels("rpr_planar")
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    acceleration[1] += [0.0, 0.0, 0.3, 0.2, 0.0, 0.0]
    status = np.empty(2, dtype=np.int8)
    assert np.isnan(many.reactions(pose, twist, acceleration, status=status)[1]).all()
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS]


def test_reactions_are_lost_where_the_rods_let_the_platform_turn() -> None:
    # Two parallel rods hold a delta against turns about the normal of their plane. Where the three normals lie in one
    # plane something is free to turn, although the motors still hold every shift.
    many = compile_kernels(delta(ball_elbows=False))
    turns = [pin.exp3(np.array([0, 0, 2 * np.pi * k / 3])) for k in range(3)]

    def pose(t: float) -> np.ndarray:
        return np.array([0.41 * t, -0.03 * t, -0.42 + 0.23 * t, 0, 0, 0, 1])

    def volume_of_normals(t: float) -> float:
        normals = []
        for turn, angle in zip(turns, many.inverse_kinematics(pose(t)), strict=True):
            elbow = turn @ [0.15 + 0.2 * np.cos(angle), 0, -0.2 * np.sin(angle)]
            rod = pose(t)[:3] + turn @ [0.05, 0, 0] - elbow
            normals.append(np.cross(rod, turn[:, 1]))
        return float(np.linalg.det(normals))

    there = brentq(volume_of_normals, 0.0, 1.0, xtol=1e-15)
    poses = np.array([pose(there + gap) for gap in (0.0, -1e-5, -1e-3, -there)])
    status, near, held = np.empty(4, dtype=np.int8), np.empty(4), np.empty(4)
    rest = np.zeros(6)
    found = many.reactions(poses, rest, rest, status=status, conditioning=near)
    assert status.tolist() == [StateStatus.SINGULAR, StateStatus.OK, StateStatus.OK, StateStatus.OK]
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(near[1] / near[2], 1e-2, rtol=0.1)
    many.inverse_dynamics(poses, rest, rest, status=status, conditioning=held)
    assert (status == StateStatus.OK).all()
    assert (held > 0.1).all()


def test_reactions_cost_little_more_than_the_efforts() -> None:
    # 1412 operations for the efforts; the whole tree takes 2735 besides the Newton steps that close it.
    assert count_operations(reactions_function(platform("stewart"))) <= 1600
    # 620 or 621: whether a constant at home is zero to the last bit depends on the machine.
    assert count_operations(reactions_function(platform("3-RPR"))) <= 630
