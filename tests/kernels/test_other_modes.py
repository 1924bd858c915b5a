"""States at which loops have come together in another way than around home: other entries vanish there."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.verbs.configurations import POOR
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.generic import regularity
from tests.closed_states import close, robot


def turned_delta(rng: np.random.Generator) -> np.ndarray:
    """Close the loops of a Delta with its platform turned: its parallelograms are none any more."""
    chain = robot("delta")
    for _ in range(200):
        guess = pin.integrate(
            chain.model, chain.q_home, rng.uniform(-0.4, 0.4, chain.nv) * chain.tangent_scale
        )
        guess[-4:] = pin.Quaternion(pin.exp3(rng.uniform(-1.0, 1.0, 3))).coeffs()
        closure = stp.close_loops(chain, guess, throw=False)
        turn = np.linalg.norm(pin.log3(stp.platform_pose(closure.state).rotation))
        if closure.success and turn > 0.2 and regularity(closure.state) > 0.1:
            return closure.q
    raise AssertionError("a Delta has such states")


@pytest.mark.slow
def test_trees_are_solved_by_what_is_there(rng: np.random.Generator) -> None:
    """What vanishes around home is not taken for zero where it does not vanish."""
    chain = robot("delta")
    kernels, still = stp.compile_kernels(chain, coordinates="tree"), np.zeros(chain.nv)
    q = np.array([turned_delta(rng) for _ in range(3)] + [chain.q_home])
    conditioning = np.empty(len(q))
    tau = kernels.inverse_dynamics(q, still, still, conditioning=conditioning)
    for one, found, share in zip(q, tau, conditioning, strict=True):
        # A thousand operations in a row, and what the pivots lose.
        close(found, stp.inverse_dynamics(chain, one, still, still).tau_motor, 1e-11 / share)
    assert (conditioning > 1e-3).all()


def test_platforms_that_only_translate_are_not_turned(rng: np.random.Generator) -> None:
    """The legs of a Delta meet a turned platform, but its twists there are no translations: the verbs refuse it too."""
    chain = robot("delta")
    kernels, status = stp.compile_kernels(chain), np.empty(1, dtype=np.int8)
    pose = stp.platform_pose(chain, turned_delta(rng))
    kernels.inverse_dynamics(pin.SE3ToXYZQUAT(pose)[None], np.zeros(6), np.zeros(6), status=status)
    assert status[0] == StateStatus.OUT_OF_BOUNDS
    assert not stp.inverse_kinematics(chain, pose, limits=False, throw=False).success


def test_one_motion_serves_many_states_of_which_some_are_poor() -> None:
    """A scissor lift folds up to where its bars are in one line: two singularities there at once, and none beyond."""
    chain = robot("scissor_lift")
    kernels = stp.compile_kernels(chain, coordinates="motor")
    feet = np.array([*np.linspace(0.8, 0.01, 12), *np.linspace(-0.01, -0.7, 10)])
    place = (1.0 - feet)[:, None]
    status, conditioning = np.empty(len(place), dtype=np.int8), np.empty(len(place))
    tau = kernels.inverse_dynamics(
        place, np.zeros((1, 1)), np.zeros((1, 1)), status=status, conditioning=conditioning
    )
    assert conditioning[:12].min() < POOR  # these are looked at again
    for x, found, code in zip(place, tau, status, strict=True):
        closure = stp.forward_kinematics(chain, x, limits=False, throw=False)
        assert (code == StateStatus.OK) == closure.success
        if closure.success:
            expected = stp.inverse_dynamics(
                chain, closure.q, np.zeros(chain.nv), np.zeros(chain.nv)
            ).tau_motor
            # A configuration that loses digits to two singularities loses them again to the dynamics.
            np.testing.assert_allclose(found, expected, rtol=1e-7)


@pytest.mark.parametrize(
    "turn", [1.5706, np.pi / 2, *(pytest.param(turn, marks=pytest.mark.slow) for turn in (0.3, 1.59, 2.8))]
)
def test_a_door_on_two_hinges_turns_by_any_angle(turn: float) -> None:
    """A right angle from where the pivots were chosen the entry that they stand for vanishes."""
    chain = robot("door_on_two_hinges")
    pose = pin.SE3ToXYZQUAT(stp.platform_pose(chain, [turn]))
    status = np.empty(1, dtype=np.int8)
    stp.compile_kernels(chain).inverse_dynamics(pose[None], np.zeros(6), np.zeros(6), status=status)
    assert status[0] == StateStatus.OK
