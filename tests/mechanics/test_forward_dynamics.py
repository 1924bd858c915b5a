"""Accelerations under given efforts, by projection and by Pinocchio's own constrained algorithm."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError, UnsupportedError
from stewart_pin.model.description import LOOP_KINDS, JointKind
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.mechanisms import arm, four_bar, two_bodies

FORWARD = ("projection", "constraint_dynamics")


def pushed(chain: stp.ClosedChain, rng: np.random.Generator):
    q = random_configuration(chain, rng, 0.1)
    return q, random_motion(chain, rng, q)[0], 10 * rng.normal(size=chain.nu)


@pytest.mark.parametrize("name", ["stewart", "stewart_sps", "stewart_cad", "stewart_s1"])
def test_both_methods_agree(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    for _ in range(5):
        q, v, tau_motor = pushed(chain, rng)
        one, two = (stp.forward_dynamics(chain, q, v, tau_motor, method=method) for method in FORWARD)
        close(two.a, one.a, 1e-10)
        close(two.lambda_c, one.lambda_c, 1e-10)


@pytest.mark.parametrize("kind", [JointKind.SPHERICAL, JointKind.FIXED])
def test_reactions_of_pinocchio_in_our_rows(kind: JointKind, rng: np.random.Generator) -> None:
    """Trap: the sign of Pinocchio's multipliers; and its moments are about x, y, z, ours about the loop's axes."""
    chain = two_bodies(kind, rng)
    q, v, tau_motor = pushed(chain, rng)
    motion = stp.forward_dynamics(chain, q, v, tau_motor, method="constraint_dynamics")
    left = pin.rnea(chain.model, pin.Data(chain.model), q, v, motion.a)
    right = stp.loop_jacobian(chain, q).T @ motion.lambda_c
    right[chain.motor_index] += tau_motor
    close(right, left, 1e-11)


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_loops_of_any_kind_stay_closed(kind: JointKind, rng: np.random.Generator) -> None:
    chain = two_bodies(kind, rng)
    q, v, tau_motor = pushed(chain, rng)
    motion = stp.forward_dynamics(chain, q, v, tau_motor)
    left = stp.loop_jacobian(chain, q) @ motion.a + stp.loop_bias(chain, q, v)
    assert np.abs(left).max() <= 1e-11 * max(1.0, np.abs(motion.a).max())
    # Gauss: of all accelerations that keep the loops closed, forces and reactions leave this one.
    left = pin.rnea(chain.model, pin.Data(chain.model), q, v, motion.a)
    right = stp.loop_jacobian(chain, q).T @ motion.lambda_c
    right[chain.motor_index] += tau_motor
    close(right, left, 1e-11)


def test_serial_arms_obey_the_articulated_body_algorithm(rng: np.random.Generator) -> None:
    chain = arm(rng, 7)
    q, v, tau_motor = pushed(chain, rng)
    expected = pin.aba(chain.model, pin.Data(chain.model), q, v, tau_motor)
    for method in FORWARD:
        close(stp.forward_dynamics(chain, q, v, tau_motor, method=method).a, expected, 1e-11)


def test_free_fall_of_a_held_nothing() -> None:
    """A platform on legs without mass and without force falls freely."""
    chain = stp.massless_legs(robot("stewart"))
    rest = np.zeros(chain.nv)
    a = stp.forward_dynamics(chain, chain.q_home, rest, np.zeros(6)).a
    fall = a[[k for k, name in enumerate(chain.tangent_names) if name == "platform_pose vz"]]
    assert fall == pytest.approx([-9.81], rel=1e-12)


def test_calls_leave_nothing_behind(rng: np.random.Generator) -> None:
    """Trap: constraint datas keep desired accelerations of other algorithms; each call makes its own."""
    chain = robot("stewart")
    q, v, tau_motor = pushed(chain, rng)
    first = stp.forward_dynamics(chain, q, v, tau_motor, method="constraint_dynamics")
    stp.forward_dynamics(chain, *pushed(chain, rng), method="constraint_dynamics")
    again = stp.forward_dynamics(chain, q, v, tau_motor, method="constraint_dynamics")
    np.testing.assert_array_equal(again.a, first.a)


def test_redundant_loops(rng: np.random.Generator) -> None:
    """Trap: Pinocchio gives NaN for them; the projection needs no special case."""
    chain = four_bar()
    q, v, tau_motor = pushed(chain, rng)
    motion = stp.forward_dynamics(chain, q, v, tau_motor)
    assert np.isfinite(motion.a).all() and np.isfinite(motion.lambda_c).all()
    effort = stp.inverse_dynamics(chain, q, v, motion.a)
    close(effort.tau_motor, tau_motor, 1e-11)
    with pytest.raises(UnsupportedError, match="cannot treat redundant loops"):
        stp.forward_dynamics(chain, q, v, tau_motor, method="constraint_dynamics")


def test_loops_that_pinocchio_does_not_know(rng: np.random.Generator) -> None:
    chain = two_bodies(JointKind.REVOLUTE, rng)
    with pytest.raises(UnsupportedError, match="loop 'loop' is revolute"):
        stp.forward_dynamics(chain, *pushed(chain, rng), method="constraint_dynamics")


def test_bodies_without_mass(rng: np.random.Generator) -> None:
    """Massless legs are fine, their idle spins stay at rest; a platform that is a point cannot be turned."""
    chain = stp.massless_legs(robot("stewart_sps"))
    q, v, tau_motor = pushed(chain, rng)
    motion = stp.forward_dynamics(chain, q, v, tau_motor)
    effort = stp.inverse_dynamics(chain, q, v, motion.a)
    close(effort.tau_motor, tau_motor, 1e-10)
    point = stp.massless_legs(robot("stewart"), point_platform=True)
    q, v, tau_motor = pushed(point, rng)
    with pytest.raises(SingularityError, match="nothing with inertia takes part in the motion") as caught:
        stp.forward_dynamics(point, q, v, tau_motor)
    assert caught.value.names == point.tangent_names and caught.value.direction.shape == (point.nv,)


def test_wrong_input() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    for arguments, message in (
        ((chain.q_home, rest, np.zeros(5)), r"tau_motor must have shape \(6,\), got \(5,\)"),
        ((chain.q_home, rest, np.full(6, np.inf)), "tau_motor must be finite"),
        ((chain.q_home, rest[1:], np.zeros(6)), "v must have shape"),
        ((rest, rest, np.zeros(6)), "q must have shape"),
        ((pin.integrate(chain.model, chain.q_home, rest + 0.1), rest, np.zeros(6)), "q does not keep"),
        ((chain.q_home, rest + 0.1, np.zeros(6)), "v does not keep"),
    ):
        for method in FORWARD:
            with pytest.raises(InputError, match=message):
                stp.forward_dynamics(chain, *arguments, method=method)
    with pytest.raises(InputError, match="method must be 'projection' or 'constraint_dynamics', got 'euler'"):
        stp.forward_dynamics(chain, chain.q_home, rest, np.zeros(6), method="euler")
