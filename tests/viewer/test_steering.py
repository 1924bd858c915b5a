"""A robot moved by hand: what moves, what stays, and what is held."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.state.state import State
from stewart_pin.viewer.steering import Hand, Step, move_joint, move_platform, random_reachable
from tests.closed_states import FEW
from tests.mechanisms import gear_train


def placed(chain: stp.ClosedChain) -> State:
    return chain.home_state()


@pytest.mark.parametrize(
    ("robot", "axes"),
    [
        ("stewart", {"vx", "vy", "vz", "wx", "wy", "wz"}),
        ("delta", {"vx", "vy", "vz"}),
        ("par4", {"vx", "vy", "vz", "wz"}),
        ("three_rps", {"vz", "wx", "wy"}),
        ("agile_eye", {"wx", "wy", "wz"}),
        ("rpr_planar", {"vx", "vy", "wz"}),
    ],
)
def test_a_platform_is_held_by_the_freedoms_it_has(robot, axes):
    assert {grip.name for grip in Hand(stp.load(robot)).platform} == axes


def test_one_leg_moves_and_the_others_keep_their_lengths():
    chain = stp.load("stewart")
    step = move_joint(Hand(chain), placed(chain), "leg1", 1.1)
    assert not step.said
    lengths = stp.leg_lengths(
        stp.Hexapod.from_chain(chain), step.state.pose.translation, step.state.pose.rotation
    )
    before = stp.motor_positions(placed(chain))
    np.testing.assert_allclose(lengths, [1.1, *before[1:]], atol=1e-10)


@pytest.mark.parametrize("robot", FEW)
def test_every_motor_can_be_moved_a_little(robot):
    chain = stp.load(robot)
    hand, start = Hand(chain), placed(chain)
    for k, grip in enumerate(hand.motors):
        before = stp.motor_positions(start)
        # Away from the nearer limit.
        aim = before[k] + (0.02 if grip.high - before[k] > before[k] - grip.low else -0.02)
        step = move_joint(hand, start, grip.name, aim)
        assert not step.said, step.said
        after = stp.motor_positions(step.state)
        assert abs(after[k] - aim) < 1e-10
        assert np.abs(stp.loop_gap(chain, step.state.q)).max(initial=0.0) < 1e-10
        independent = stp.mobility(chain).spare_motors == ()
        if independent:
            np.testing.assert_allclose(np.delete(after, k), np.delete(before, k), atol=1e-10)


def test_a_passive_joint_leads_the_motor():
    chain = stp.load("four_bar")
    hand = Hand(chain)
    rocker = next(grip for grip in hand.joints if grip.name != chain.motors[0])
    at = chain.model.joints[chain.model.getJointId(rocker.name)].idx_q
    aim = chain.q_home[at] + 0.05
    step = move_joint(hand, placed(chain), rocker.name, aim)
    assert not step.said
    assert abs(step.state.q[at] - aim) < 1e-12
    # The same state by the motor.
    again = stp.forward_kinematics(chain, stp.motor_positions(step.state))
    np.testing.assert_allclose(again.q, step.state.q, atol=1e-9)


def test_couplings_follow():
    chain = gear_train(np.random.default_rng(1))
    hand = Hand(chain)
    step = move_joint(hand, placed(chain), hand.joints[0].name, 0.3)
    assert not step.said
    assert np.abs(stp.loop_gap(chain, step.state.q)).max(initial=0.0) < 1e-12


def test_out_of_reach_holds_and_names_the_joint():
    chain = stp.load("stewart")
    start = placed(chain)
    step = move_platform(Hand(chain), start, pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.79])))
    assert step.state is not None
    np.testing.assert_array_equal(step.state.q, start.q)
    assert "leg" in step.said
    assert "1.8" in step.said


def test_coordinates_that_a_platform_lacks_are_not_asked_for():
    chain = stp.load("delta")
    start = placed(chain)
    aim = pin.SE3(pin.rpy.rpyToMatrix(0.2, -0.1, 0.3), start.pose.translation + [0.01, 0.02, -0.01])
    step = move_platform(Hand(chain), start, aim)
    assert not step.said
    np.testing.assert_allclose(step.state.pose.translation, aim.translation, atol=1e-12)
    np.testing.assert_allclose(step.state.pose.rotation, start.pose.rotation, atol=1e-9)


@pytest.mark.parametrize("robot", FEW)
def test_random_states_are_reachable(robot):
    chain = stp.load(robot)
    step = random_reachable(Hand(chain), np.random.default_rng(3))
    assert isinstance(step, Step)
    assert not step.said
    assert stp.limits_exceeded(step.state) == ()
    assert np.abs(stp.loop_gap(chain, step.state.q)).max(initial=0.0) < 1e-10
    assert np.abs(step.state.q - chain.q_home).max() > 1e-3
