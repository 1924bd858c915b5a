"""What nobody asks for moves as the mechanism has it, not as it is told."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.state.state import State
from tests.closed_states import close, random_configuration, robot
from tests.rewritten import carry_over, configuration_in_other_unit, in_other_unit, recut, tangent_unit
from tests.zoo.table import zoo_chain


def lopsided() -> stp.ClosedChain:
    """Give the legs of a platform masses beside their axes."""
    chain = stp.load("stewart_sps")
    heavy = pin.Inertia(3.0, np.array([0.05, 0.02, 0.3]), np.diag([0.2, 0.25, 0.07]))
    return stp.build.replace_inertias(chain, {f"leg{k}_lower": heavy for k in range(1, 7)})


CHAINS = {
    "stewart_sps": lambda: robot("stewart_sps"),
    "hexapod_rss": lambda: robot("hexapod_rss"),
    "massless legs": lambda: stp.massless_legs(robot("stewart_sps")),
    "lopsided legs": lopsided,
    "rssr": lambda: zoo_chain("rssr"),
    "gough_6sps": lambda: zoo_chain("gough_6sps"),
}


def moving(chain: stp.ClosedChain, rng: np.random.Generator) -> State:
    """Move a platform as it can, from a generic configuration."""
    q = random_configuration(chain, rng, 0.1)
    here, freedom = chain.at(q), chain.at(q).freedom
    v = freedom.motions @ rng.normal(size=freedom.count.dof)
    there = chain.at(q, v)
    scale = chain.tangent_scale
    a = freedom.motions @ rng.normal(size=freedom.count.dof)
    a = a - scale * there.motions.across(there.loop_bias / chain.row_sizes)
    return stp.platform_motion(
        chain, here.pose, here.P @ v, here.P @ a + there.platform_bias, q_guess=q, limits=False
    )


def again(chain: stp.ClosedChain, q: np.ndarray, like: State, k: float = 1.0) -> State:
    """Ask another telling for the same motion of the platform."""
    unit = np.repeat([k, 1.0], 3)
    acceleration = unit * (like.P @ like.require_accelerating() + like.platform_bias)
    pose = chain.at(q).pose
    return stp.platform_motion(chain, pose, unit * like.twist, acceleration, q_guess=q, limits=False)


@pytest.mark.parametrize("name", CHAINS)
def test_another_cut_moves_alike(name: str, rng: np.random.Generator) -> None:
    chain = CHAINS[name]()
    other = recut(chain)
    assert other is not None and chain.generic.count.idle
    state = moving(chain, rng)
    q, v, a = carry_over(chain, other, state.q, state.v, state.require_accelerating())
    found = again(other, q, state)
    # Round-off of a moment about a thin rod's axis, which forces on the whole rod make up.
    close(found.v, v, 1e-9)
    close(found.require_accelerating(), a, 1e-8)


@pytest.mark.parametrize("name", ["stewart_sps", "massless legs"])
def test_another_unit_moves_alike(name: str, rng: np.random.Generator) -> None:
    chain, k = CHAINS[name](), 1000.0
    other, state = in_other_unit(chain, k), moving(chain, rng)
    found, size = (
        again(other, configuration_in_other_unit(chain, state.q, k), state, k),
        tangent_unit(chain, k),
    )
    close(found.v / size, state.v, 1e-9)
    close(found.require_accelerating() / size, state.require_accelerating(), 1e-8)


@pytest.mark.parametrize("name", ["stewart_sps", "massless legs"])
def test_round_legs_do_not_turn_about_themselves(name: str, rng: np.random.Generator) -> None:
    """As textbooks have it: u·ω = 0, u·α = 0."""
    chain = CHAINS[name]()
    state = moving(chain, rng)
    legs, data = stp.Hexapod.from_chain(chain), pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, state.q, state.v, state.require_accelerating())
    feet = legs.base_points
    heads = state.pose.translation + legs.platform_points @ state.pose.rotation.T
    for motor, foot, head in zip(chain.motors, feet, heads, strict=True):
        joint, along = chain.model.getJointId(motor), (head - foot) / np.linalg.norm(head - foot)
        turn = data.oMi[joint].rotation
        assert abs(along @ turn @ data.v[joint].angular) <= 1e-9
        assert abs(along @ turn @ data.a[joint].angular) <= 1e-8


@pytest.mark.parametrize("name", ["stewart_sps", "lopsided legs", "rssr"])
def test_they_follow_their_own_inertia(name: str, rng: np.random.Generator) -> None:
    state = moving(CHAINS[name](), rng)
    idle, size = state.freedom.idle, np.abs(state.M).max()
    assert np.abs(idle.T @ state.M @ state.v).max() <= 1e-12 * size * np.abs(state.v).max()
    # Inverse dynamics lets them go their own way, which is where they go already.
    close(stp.inverse_dynamics(state).a, state.require_accelerating(), 1e-8)
    mapped = stp.dynamics.motion_map(state, coordinates="platform")
    close(mapped.G @ mapped.rate, state.v, 1e-9)
