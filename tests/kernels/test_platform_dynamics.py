"""Graphs in platform coordinates against the one-state verbs and the closed form of hexapods."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.hexapod_bodies import hexapod_bodies
from stewart_pin.kernels.graph.platform_dynamics import (
    PlacedPlatform,
    forward_dynamics_function,
    inverse_dynamics_function,
    motor_columns,
    place_platform,
)
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.model.description import JointKind
from tests import mechanisms
from tests.closed_states import close, robot, slow_but_for_few
from tests.kernels.platforms import FEW_PLATFORMS, PLATFORMS, crossed_hinge

AGREE = 1e-10


@cache
def platform(name: str) -> PlacedPlatform:
    return place_platform(plan_platform(PLATFORMS[name]()))


def states(placed: PlacedPlatform, rng: np.random.Generator, count: int = 4):
    """Poses within a fifth of the robot's size and 20° of home, and motions that the platform can do."""
    plan = placed.plan
    home = stp.platform_pose(plan.chain, plan.chain.q_home)
    for _ in range(count):
        for _ in range(50):
            shift = plan.twists @ rng.uniform(-1, 1, plan.twists.shape[1])
            move = 0.15 * plan.chain.length_scale * shift[:3] / max(1.0, np.abs(shift[:3]).max(initial=0.0))
            pose = pin.SE3(pin.exp3(0.35 * shift[3:]) @ home.rotation, home.translation + move)
            twist, acceleration = (plan.twists @ rng.normal(size=plan.twists.shape[1]) for _ in range(2))
            try:
                state = stp.platform_motion(plan.chain, pose, twist, acceleration, limits=False)
            except stp.errors.ClosureError:
                continue
            yield pin.SE3ToXYZQUAT(pose), twist, acceleration, state
            break
        else:
            raise AssertionError("no pose in reach")


def call(function: ca.Function, *arguments: np.ndarray) -> np.ndarray:
    return np.array(function.call([ca.DM(x) for x in arguments])[0]).ravel()


@pytest.mark.parametrize("name", slow_but_for_few(PLATFORMS, FEW_PLATFORMS))
def test_inverse_dynamics_agrees(name: str, rng: np.random.Generator) -> None:
    placed = platform(name)
    inverse = inverse_dynamics_function(placed)
    for pose, twist, acceleration, s in states(placed, rng):
        expected = stp.inverse_dynamics(placed.plan.chain, s.q, s.v, s.a).tau_motor
        close(call(inverse, pose, twist, acceleration), expected, AGREE)


@pytest.mark.parametrize("name", slow_but_for_few(PLATFORMS, FEW_PLATFORMS))
def test_forward_dynamics_agrees(name: str, rng: np.random.Generator) -> None:
    placed = platform(name)
    chain, forward = placed.plan.chain, forward_dynamics_function(placed)
    for pose, twist, _, s in states(placed, rng):
        tau_motor = stp.inverse_dynamics(chain, s.q, s.v, s.a).tau_motor * rng.uniform(0.5, 1.5, chain.nu)
        a = stp.forward_dynamics(chain, s.q, s.v, tau_motor).a
        expected = chain.at(s.q).P @ a + chain.at(s.q, s.v).platform_bias
        close(call(forward, pose, twist, tau_motor), expected, AGREE)


@pytest.mark.parametrize("name", PLATFORMS)
def test_motor_columns_are_the_transposed_jacobian(name: str, rng: np.random.Generator) -> None:
    placed = platform(name)
    columns = ca.Function("columns", [placed.pose], [motor_columns(placed)])
    for pose, twist, _, s in states(placed, rng):
        expected = stp.motor_jacobian(placed.plan.chain, s.q) @ twist
        close(np.array(columns(pose)).T @ twist, expected, AGREE)


@pytest.mark.parametrize("name", ["stewart", "stewart_cad", "stewart_s1"])
def test_inverse_dynamics_agrees_with_the_closed_form(name: str, rng: np.random.Generator) -> None:
    placed, chain = platform(name), robot(name)
    inverse, hexapod, bodies = (
        inverse_dynamics_function(placed),
        stp.Hexapod.from_chain(chain),
        hexapod_bodies(chain),
    )
    for pose, twist, acceleration, _ in states(placed, rng):
        rotation = pin.Quaternion(pose[3:]).matrix()
        forces = stp.hexapods.hexapod_inverse_dynamics(
            hexapod, bodies, pose[:3], rotation, twist, acceleration
        )
        close(call(inverse, pose, twist, acceleration), forces.actuator, AGREE)


def operations(function: ca.Function) -> int:
    kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    return sum(kind not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST) for kind in kinds)


def test_the_usual_hexapod_costs_no_more_than_its_closed_form() -> None:
    # 1497 operations of the closed form written by hand; a change of the algebra that costs more should be seen.
    placed = platform("stewart")
    assert operations(inverse_dynamics_function(placed)) <= 1450
    assert operations(forward_dynamics_function(placed)) <= 2450


@pytest.mark.parametrize(
    ("build", "reason"),
    [
        (lambda: robot("arm_7r"), "motor 'joint7' carries the platform"),
        (mechanisms.four_bar, "1 freedom.* along twists that change with the pose"),
        (crossed_hinge, "ends in a hinge, and joint 'a0' turns about another axis"),
        (
            lambda: mechanisms.two_bodies(JointKind.CYLINDRICAL, np.random.default_rng(1)),
            "carries the platform",
        ),
    ],
    ids=["arm", "four-bar", "crossed hinge", "sled"],
)
def test_refuses_with_a_reason(build, reason: str) -> None:
    with pytest.raises(stp.errors.UnsupportedError, match=reason):
        plan_platform(build())
