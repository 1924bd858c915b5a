"""Linear systems, stiffness and natural frequencies: textbook pendulums, closed forms, and simulated motion."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from tests.closed_states import close, random_configuration, robot
from tests.mechanisms import Y, at, five_bar, four_bar, rotary_hexapod

g = 9.81


def pendulum(angle: float = 0.0) -> stp.ClosedChain:
    """Build a compound pendulum about y: 2 kg at 0.5 m below the hinge, 0.1 kg m² about its centre."""
    inertia = pin.Inertia(2.0, np.array([0.0, 0.0, -0.5]), 0.1 * np.eye(3))
    links = (Link("ground"), Link("bob", inertia))
    joint = Joint("hinge", JointKind.REVOLUTE, "ground", "bob", at(), Y, independent=True)
    home = {"hinge": np.array([angle])}
    return build_chain(Mechanism("pendulum", links, (joint,), platform="bob", home=home))


def test_a_pendulum_swings_and_topples() -> None:
    moment = 0.1 + 2.0 * 0.25
    rate = np.sqrt(2.0 * g * 0.5 / moment)
    hanging, standing = pendulum(), pendulum(np.pi)
    system = stp.linearise(hanging, hanging.q_home)
    np.testing.assert_allclose(system.A, [[0, 1], [-(rate**2), 0]], atol=1e-12)
    np.testing.assert_allclose(system.B, [[0], [1 / moment]], rtol=1e-13)
    free = stp.natural_frequencies(hanging, hanging.q_home, motor_stiffness=0.0)
    np.testing.assert_allclose(free.frequency, rate / (2 * np.pi), rtol=1e-12)
    assert free.stable
    toppling = stp.natural_frequencies(standing, standing.q_home, motor_stiffness=0.0)
    np.testing.assert_allclose(toppling.frequency, -rate / (2 * np.pi), rtol=1e-12)
    assert not toppling.stable
    # A spring of the weight's own stiffness, m g l, leaves the standing pendulum indifferent; a stiffer one holds it.
    held = stp.natural_frequencies(standing, standing.q_home, motor_stiffness=2 * 2.0 * g * 0.5)
    np.testing.assert_allclose(held.frequency, rate / (2 * np.pi), rtol=1e-12)


def test_a_dead_load_pulls_a_pendulum_straight() -> None:
    """A force that keeps its direction, at a tip 0.8 m below the hinge, adds P · 0.8 to the weight's m g l."""
    moment, pull = 0.1 + 2.0 * 0.25, 30.0
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.8]))
    chain = stp.with_platform(pendulum(), "bob", placement=tip, name="tip")
    down = {"tip": [0, 0, -pull, 0, 0, 0]}
    rate = np.sqrt((2.0 * g * 0.5 + pull * 0.8) / moment)
    system = stp.linearise(chain, chain.q_home, wrenches=down)
    np.testing.assert_allclose(system.A, [[0, 1], [-(rate**2), 0]], atol=1e-12)
    found = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=0.0, wrenches=down)
    np.testing.assert_allclose(found.frequency, rate / (2 * np.pi), rtol=1e-12)
    # A pull to the side bends it: the motor holds it, and the same force then stiffens as its part along the rod.
    aside = {"tip": [pull, 0, 0, 0, 0, 0]}
    held = stp.linearise(chain, chain.q_home, wrenches=aside)
    np.testing.assert_allclose(held.tau_motor, [pull * 0.8], rtol=1e-13)  # about y, from z to x
    np.testing.assert_allclose(held.A[1, 0], -(2.0 * g * 0.5) / moment, rtol=1e-12)
    with pytest.raises(InputError, match="no equilibrium"):
        stp.linearise(chain, chain.q_home, tau_motor=[0.0], wrenches=aside)


def test_a_linear_system_under_wrenches_is_the_change_of_acceleration(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    wrenches = {"platform": 200 * rng.normal(size=6), "leg2_lower": 50 * rng.normal(size=6)}
    system = stp.linearise(chain, q, wrenches=wrenches)
    n, rest, h = system.motions.shape[1], np.zeros(chain.nv), 1e-4

    def motors(step: np.ndarray) -> np.ndarray:
        moved = stp.close_loops(chain, pin.integrate(chain.model, q, system.motions @ step)).q
        return stp.forward_dynamics(chain, moved, rest, system.tau_motor, wrenches=wrenches).a[
            chain.motor_index
        ]

    slopes = [(motors(h * unit) - motors(-h * unit)) / (2 * h) for unit in np.eye(n)]
    close(system.A[n:, :n], np.transpose(slopes), 1e-6)
    assert np.abs(system.A - stp.linearise(chain, q).A).max() > 0.1 * np.abs(system.A[n:, :n]).max()


def test_a_moment_about_fixed_axes_has_no_frequencies(rng: np.random.Generator) -> None:
    """Its work depends on the way, so that its stiffness is not symmetric: said, not made so."""
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    for verb in (stp.natural_frequencies, stp.dynamics.platform_stiffness):
        with pytest.raises(InputError, match="wrenches have no potential here"):
            verb(chain, q, motor_stiffness=1e4, wrenches={"platform": [0, 0, 0, 300, 200, 100]})
        verb(chain, q, motor_stiffness=1e4, wrenches={"platform": [300, 200, 100, 0, 0, 0]})


# Closed form: K = Jᵀ k J for light legs without preload (Merlet).
def test_platform_stiffness_without_preload(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    springs = rng.uniform(1e6, 2e6, 6)
    pose = stp.platform_pose(chain, q)
    jacobian = stp.leg_jacobian(stp.Hexapod.from_chain(chain), pose.translation, pose.rotation)
    found = stp.dynamics.platform_stiffness(chain, q, motor_stiffness=springs, preload=False)
    close(found, jacobian.T @ np.diag(springs) @ jacobian, 1e-11)
    spinning = stp.dynamics.platform_stiffness(
        robot("stewart_sps"), robot("stewart_sps").q_home, motor_stiffness=1e6
    )
    assert spinning.shape == (6, 6)


def test_platform_stiffness_with_preload_is_the_change_of_force(rng: np.random.Generator) -> None:
    """Displace the platform against springs about the equilibrium: the wrench that it takes, by differences.

    Light legs and a point platform: the wrench is Jᵀ f with f the springs' forces, less gravity, all in closed form.
    """
    chain = stp.massless_legs(robot("stewart"), point_platform=True)
    hexapod = stp.Hexapod.from_chain(chain)
    q = random_configuration(chain, rng, 0.1)
    pose, k, mass = stp.platform_pose(chain, q), 5e3, 20.0
    weight = np.array([0, 0, -mass * g, 0, 0, 0])
    jacobian = stp.leg_jacobian(hexapod, pose.translation, pose.rotation)
    lengths = stp.leg_lengths(hexapod, pose.translation, pose.rotation)
    preload = np.linalg.solve(jacobian.T, -weight)

    def wrench(step: np.ndarray) -> np.ndarray:
        position, rotation = pose.translation + step[:3], pin.exp3(step[3:]) @ pose.rotation
        stretch = stp.leg_lengths(hexapod, position, rotation) - lengths
        force = preload - k * stretch
        return -(stp.leg_jacobian(hexapod, position, rotation).T @ force + weight)

    h = 1e-5
    slope = np.array([(wrench(h * e) - wrench(-h * e)) / (2 * h) for e in np.eye(6)]).T
    found = stp.dynamics.platform_stiffness(chain, q, motor_stiffness=k)
    close(found, (slope + slope.T) / 2, 1e-8)
    assert np.abs(found - jacobian.T @ jacobian * k).max() > 50  # preload counts


@pytest.mark.parametrize("make", [lambda: robot("stewart"), lambda: robot("stewart_sps"), four_bar, five_bar])
def test_linear_system_and_vibrations_agree(make) -> None:
    """Closing the loop with δτ = -k S T ξ gives eigenvalues ±i 2π f."""
    chain = make()
    k = 3e4
    system = stp.linearise(chain, chain.q_home)
    vibration = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=k)
    n = system.motions.shape[1]
    feedback = np.hstack([system.motions[chain.motor_index], np.zeros((chain.nu, n))])
    poles = np.linalg.eigvals(system.A - k * system.B @ feedback)
    rates = np.sort(np.abs(poles.imag))[::2] / (2 * np.pi)
    # Zero frequencies of idle freedoms are roots of round-off.
    np.testing.assert_allclose(np.sort(rates), np.sort(vibration.frequency), rtol=1e-8, atol=1e-3)
    assert vibration.stable


def test_the_simulated_robot_swings_at_its_frequency() -> None:
    """A small displacement along the lowest shape comes back after one period, under the springs' controller."""
    chain = four_bar()
    k = 40.0
    vibration = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=k)
    hold = stp.linearise(chain, chain.q_home).tau_motor
    rest, period = stp.motor_positions(chain, chain.q_home), 1 / vibration.frequency[0]
    start = stp.forward_kinematics(chain, rest + 1e-4).q

    def springs(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return hold - k * (stp.motor_positions(chain, q) - rest)

    run = stp.simulate(chain, start, np.zeros(chain.nv), springs, duration=period, dt=period / 400)
    end = stp.motor_positions(chain, run.q[-1]) - rest
    # One robot-size of amplitude 1e-4 changes the period by some 1e-4 of itself, the cosine by the square of that.
    np.testing.assert_allclose(end, 1e-4, rtol=1e-3)


def test_idle_rods_have_no_stiffness() -> None:
    chain = rotary_hexapod()
    vibration = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=1e3)
    assert vibration.names[6:] == tuple(f"idle {k}" for k in range(1, 7))
    np.testing.assert_allclose(vibration.stiffness[6:], 0, atol=1e-9)
    assert (np.abs(vibration.frequency) < 1e-3).sum() == 6 and (vibration.frequency > 1).sum() == 6


def test_bad_input_is_refused() -> None:
    chain = robot("stewart")
    with pytest.raises(InputError, match="no equilibrium"):
        stp.linearise(chain, chain.q_home, tau_motor=np.zeros(6))
    with pytest.raises(InputError, match="motor_stiffness must be 0 or more"):
        stp.natural_frequencies(chain, chain.q_home, motor_stiffness=-1.0)
    planar = four_bar()
    stiffness = stp.dynamics.platform_stiffness(planar, planar.q_home, motor_stiffness=1.0)
    assert np.linalg.matrix_rank(stiffness) == 1
