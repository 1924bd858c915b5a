"""Dry friction at rest: two solvers, against what the law of friction says; and blocks, legs and bases that slip."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.mechanics.constraint_matrix.joint_efforts import friction_at_rest
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.state.joint_effects import held_by

ONE = pin.SE3.Identity()

LEFT = 1e-9
"""Acceleration against friction, relative to the largest; a few round-offs through twelve digits of responses."""


def problem(rng: np.random.Generator, count: int, freedoms: int, spread: float) -> tuple[np.ndarray, ...]:
    """Draw responses of coordinates that share freedoms, of sizes apart by some powers of ten."""
    sizes = 10 ** rng.uniform(-spread, spread, count)
    response = rng.normal(size=(count, freedoms)) * sizes[:, None]
    if count > 2:
        response[1] = -2 * response[0]  # a hinge told twice
    pull = response @ rng.normal(size=freedoms)
    # Some hold with ease, some with effort, some not at all.
    limits = 10 ** rng.uniform(-1.5, 1.0, count) / np.linalg.norm(response, axis=1)
    return response, pull, limits


@pytest.mark.parametrize("spread", [0.0, 2.0])
@pytest.mark.parametrize(("count", "freedoms"), [(1, 1), (3, 3), (3, 1), (6, 4), (12, 5), (8, 8)])
def test_each_coordinate_stays_or_slips_against_its_friction(
    count: int, freedoms: int, spread: float, rng: np.random.Generator
) -> None:
    for _ in range(20):
        response, pull, limits = problem(rng, count, freedoms, spread)
        one = held_by(response, pull, limits)
        two = friction_at_rest(response @ response.T, pull, limits)
        sizes = np.linalg.norm(response, axis=1)
        for friction in (one, two):
            assert (np.abs(friction) <= limits * (1 + 1e-12)).all()
            left = (response @ (response.T @ friction) + pull) / sizes
            left /= np.abs(pull / sizes).max() + np.abs(sizes * limits).max()
            stays = np.abs(left) < LEFT
            slips = np.isclose(np.abs(friction), limits, rtol=1e-9) & (left * friction < 0)
            assert (stays | slips).all()
        scale = np.abs(response.T @ one).max()
        assert response.T @ two == pytest.approx(response.T @ one, rel=1e-6, abs=1e-7 * scale)


def test_a_joint_holds_beside_one_that_slips() -> None:
    # The second slips, and its friction takes the third back to where it holds.
    response = np.array([[0.0, 0.0, 0.46], [-0.40, -0.63, 0.0], [1.70, -0.15, 0.0]])
    pull, limits = np.array([-0.1, -15.2, 3.2]), np.array([1.6, 1.1, 1.45])
    matrix = response @ response.T
    third = -(pull[2] + matrix[2, 1] * limits[1]) / matrix[2, 2]
    expected = [0.1 / 0.46**2, limits[1], third]
    assert held_by(response, pull, limits) == pytest.approx(expected, rel=1e-12)
    assert friction_at_rest(matrix, pull, limits) == pytest.approx(expected, rel=1e-9)


def block(angle: float, *, rail: bool = False, **physics: object) -> stp.ClosedChain:
    """Let a block of 2 kg slide down an incline; with a rail beside it that closes a loop."""
    down = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    body = pin.Inertia(2.0, np.zeros(3), np.eye(3))
    links = (Link("ground"), Link("block", body))
    joints = (Joint("slide", JointKind.PRISMATIC, "ground", "block", ONE, down, independent=True),)
    loops = (Loop("rail", JointKind.POINT_ON_LINE, "ground", "block", ONE, ONE, down),) if rail else ()
    chain = build_chain(Mechanism("block", links, joints, loops, platform="block"))
    return stp.with_joint_physics(chain, {"slide": physics} | ({"rail": physics} if rail else {}))


def accelerations(chain: stp.ClosedChain, tau: list[float], v: float = 0.0) -> list[float]:
    """Ask all ways of forward dynamics."""
    state = chain.at(chain.q_home, np.full(chain.nv, v))
    return [
        float(stp.forward_dynamics(state, tau_motor=tau).a[0]),
        float(stp.dynamics.closed_chain_articulated_body(state, tau_motor=tau).a[0]),
    ]


@pytest.mark.parametrize("rail", [False, True])
def test_a_block_slides_down_an_incline_when_its_weight_is_more_than_friction(*, rail: bool) -> None:
    pull = 9.81 * np.sin(0.3)  # [m/s²]
    friction = 5.0 / (2 if rail else 1)  # the rail has as much
    chain = block(0.3, rail=rail, friction=friction)
    assert accelerations(chain, [0.0]) == pytest.approx([pull - 2.5] * 2, rel=1e-12)
    held = block(0.3, rail=rail, friction=3.0)
    push = 3.0 * (2 if rail else 1)
    # The motor may help or push back within friction, and moves the block beyond.
    weight = 2 * pull
    for tau, a in ((push - weight - 0.1, 0), (-push - weight + 0.1, 0), (push - weight + 0.2, 0.1)):
        assert accelerations(held, [tau]) == pytest.approx([a] * 2, abs=1e-9)
    effort = stp.inverse_dynamics(held, held.q_home, held.rest, held.rest)
    assert effort.band == pytest.approx(np.array([[-weight - push, -weight + push]]))
    # Uphill friction pulls down, downhill up.
    assert accelerations(chain, [0.0], v=-1.0) == pytest.approx([pull + 2.5] * 2, rel=1e-12)
    assert accelerations(chain, [0.0], v=1.0) == pytest.approx([pull - 2.5] * 2, rel=1e-12)


def test_a_gas_spring_lifts_and_a_spring_of_third_order_bends() -> None:
    lifted = block(0.3, force=-30.0, damping=4.0)
    pull = 9.81 * np.sin(0.3)
    assert accelerations(lifted, [0.0]) == pytest.approx([pull - 15.0] * 2, rel=1e-12)
    assert accelerations(lifted, [0.0], v=0.5) == pytest.approx([pull - 15.0 - 1.0] * 2, rel=1e-12)
    bent = block(0.3, stiffness=(10.0, 4.0, 3.0), rest=-0.2, force=1.0)
    expected = pull + (1.0 - 10 * 0.2 - 4 * 0.2**2 - 3 * 0.2**3) / 2
    assert accelerations(bent, [0.0]) == pytest.approx([expected] * 2, rel=1e-12)


def test_friction_holds_a_leg_to_a_floating_base(rng: np.random.Generator) -> None:
    # Held, both fall as one body and nothing turns; the base is free to go.
    chain = stp.with_joint_physics(stp.load("five_bar"), {"left_hip": {"friction": 1e4}})
    base = pin.Inertia(3.0, np.array([0.1, 0.0, 0.2]), np.diag([0.2, 0.3, 0.4]))
    floating = stp.on_floating_base(chain, base_inertia=base)
    q, v = floating.q_home, floating.rest
    a = stp.forward_dynamics(floating, q, v, [0.0, 1.0]).a
    hip = floating.model.joints[floating.model.getJointId("left_hip")].idx_v
    assert abs(a[hip]) < 1e-9 * np.abs(a).max()
    locked = stp.lock_joints(floating, ["left_hip"])
    other = stp.forward_dynamics(locked, locked.q_home, locked.rest, [1.0]).a
    assert np.delete(a, hip) == pytest.approx(other, rel=1e-8, abs=1e-8 * np.abs(a).max())


def test_legs_without_mass_hold_and_slip_as_light_ones() -> None:
    # The legs weigh nothing, so that friction in them is all that they do.
    physics = {"leg1": {"friction": 40.0}, "leg2_x": {"friction": 3.0}}
    chain = stp.with_joint_physics(stp.massless_legs(stp.load("stewart")), physics)
    effort = stp.inverse_dynamics(chain, chain.q_home, chain.rest, chain.rest)
    tau = effort.tau_motor + np.array([39.0, 0, 0, 0, 0, 0])
    assert np.abs(stp.forward_dynamics(chain, chain.q_home, chain.rest, tau).a).max() < 1e-8
    for push in (effort.tau_motor + 45.0, effort.tau_motor - 45.0):
        one = stp.forward_dynamics(chain, chain.q_home, chain.rest, push).a
        two = stp.dynamics.closed_chain_articulated_body(chain, chain.q_home, chain.rest, push).a
        assert two == pytest.approx(one, rel=1e-8, abs=1e-8 * np.abs(one).max())
        again = stp.inverse_dynamics(chain, chain.q_home, chain.rest, one)
        least, most = (again.tau_motor,) * 2 if again.band is None else again.band.T
        assert (least - 1e-6 < push).all() and (push < most + 1e-6).all()
