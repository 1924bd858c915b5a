"""Laws of the explicit maps: loops stay closed, the bias is a derivative, the equation of motion is the tree's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import along, close, derivative
from tests.laws.conftest import Case, round_off, round_off_of_accelerations


@pytest.fixture(params=["motor", "platform"])
def coordinates(request: pytest.FixtureRequest) -> str:
    """Return each kind of coordinates that every robot has."""
    return request.param


def closed_along(case: Case, a: np.ndarray) -> Callable[[float], np.ndarray]:
    curve = along(case.chain, case.q, case.v, a)
    return lambda t: stp.close_loops(case.chain, curve(t)).q


def moderate(case: Case) -> None:
    """Skip where differences say nothing: maps into a singularity bend on the scale of its distance."""
    values = np.linalg.svd(case.chain.at(case.q).P, compute_uv=False)
    if case.pose == "near_singular" or values[values > 1e-9 * values[0]][-1] < 0.05 * values[0]:
        pytest.skip("next to a singularity")


def test_the_map_keeps_loops_closed_and_gives_the_rates(held: Case, coordinates: str) -> None:
    chain = held.chain
    found = stp.dynamics.motion_map(chain, held.q, held.v, coordinates=coordinates)
    size = np.abs(found.G).max()
    assert np.abs(stp.loop_jacobian(chain, held.q) @ found.G).max(initial=0.0) <= 1e-12 * size
    # The rates are the motors' and the platform's own.
    tolerance = round_off(held, 1e-11)
    if coordinates == "motor":
        close(found.G[chain.motor_index], np.eye(chain.nu), tolerance)
        close(found.rate, held.v[chain.motor_index], 1e-12)
    else:
        twist = chain.at(held.q).P
        # The product has the round-off of its parts: next to a singularity of the platform rates are large.
        parts = float(np.abs(found.G / chain.tangent_scale[:, None]).max())
        close(twist @ found.G, found.coordinates.basis, tolerance * max(1.0, parts))
        close(found.coordinates.basis @ found.rate, twist @ held.v, tolerance)


def test_motors_and_platform_tell_one_motion(held: Case) -> None:
    """The bias of both coordinates belongs to one acceleration, and so do their efforts."""
    chain = held.chain
    by_motor = stp.dynamics.motion_map(chain, held.q, held.v)
    acceleration = np.linspace(1.0, 2.0, len(by_motor.rate)) * chain.tangent_scale[chain.motor_index]
    a = by_motor.G @ acceleration + by_motor.gamma
    bias = chain.at(held.q).J_c @ a + stp.loop_bias(chain, held.q, held.v)
    assert np.abs(bias).max(initial=0.0) <= 1e-11 * np.abs(a).max()
    close(a[chain.motor_index], acceleration, 1e-10)


def test_bias_is_the_change_of_the_map(held: Case, coordinates: str) -> None:
    """Follow a closed motion: a = G x_acceleration + gamma, with x_acceleration by differences of the rates."""
    moderate(held)
    chain, q, v, a = held.chain, held.q, held.v, held.a
    here = stp.dynamics.motion_map(chain, q, v, coordinates=coordinates)
    if here.rest.shape[1]:
        pytest.skip("motions at rest follow their inertia, not this curve")
    basis = here.coordinates.basis if coordinates == "platform" else coordinates
    curve = closed_along(held, a)

    def velocity(t: float) -> np.ndarray:
        # The velocity with the rates of the start, as G carries it along.
        return stp.dynamics.motion_map(chain, curve(t), coordinates=basis).G @ here.rate

    error = (derivative(velocity, 2e-3) - here.gamma) / chain.tangent_scale
    # The bias is quadratic in the velocity; where it cancels, the parts have the size of the squares.
    size = max(np.abs(here.gamma / chain.tangent_scale).max(), np.abs(v / chain.tangent_scale).max() ** 2)
    assert np.abs(error).max() <= 1e-6 * size


def test_equation_of_motion_is_that_of_inverse_dynamics(held: Case, coordinates: str) -> None:
    chain, rng = held.chain, np.random.default_rng(3)
    found = stp.operational_dynamics(chain, held.q, held.v, coordinates=coordinates)
    acceleration = rng.normal(size=len(found.M)) * found.motion.coordinates.sizes
    a = found.motion.G @ acceleration + found.motion.gamma
    effort = stp.inverse_dynamics(chain, held.q, held.v, a)
    terms = (found.M @ acceleration, found.c, found.g)
    scale = sum(np.abs(term).max() for term in terms)
    error = sum(terms) - found.motion.share.T @ effort.tau_motor
    assert np.abs(error).max() <= round_off(held, 1e-10) * scale
    # Idle freedoms do what inverse and forward dynamics say they do.
    tolerance = round_off_of_accelerations(held, 1e-10, effort)
    if effort.unique and np.abs(found.motion.rest[chain.motor_index]).max(initial=0.0) < 1e-8:
        close(effort.a / chain.tangent_scale, a / chain.tangent_scale, tolerance)
    motion = stp.forward_dynamics(chain, held.q, held.v, effort.tau_motor)
    close(motion.a / chain.tangent_scale, effort.a / chain.tangent_scale, tolerance)


def test_inertia_is_symmetric_positive_and_counts_the_energy(held: Case, coordinates: str) -> None:
    chain = held.chain
    found = stp.operational_dynamics(chain, held.q, held.v, coordinates=coordinates)
    sizes = found.motion.coordinates.sizes
    scaled = found.M * np.outer(sizes, sizes)
    assert np.array_equal(found.M, found.M.T)
    assert np.linalg.eigvalsh(scaled)[0] > 0
    # What moves as the map says has the kinetic energy of the tree.
    v = found.motion.G @ found.motion.rate
    energy = pin.computeKineticEnergy(chain.model, pin.Data(chain.model), held.q, v)
    assert found.motion.rate @ found.M @ found.motion.rate / 2 == pytest.approx(energy, rel=1e-10)


def test_change_of_inertia_less_twice_coriolis_is_skew(held: Case, coordinates: str) -> None:
    moderate(held)
    chain = held.chain
    found = stp.operational_dynamics(chain, held.q, held.v, coordinates=coordinates)
    basis = found.motion.coordinates.basis if coordinates == "platform" else coordinates
    curve = closed_along(held, held.a)
    sizes = found.motion.coordinates.sizes
    rate = derivative(lambda t: stp.operational_dynamics(chain, curve(t), coordinates=basis).M, 2e-3)
    left = (rate - found.C - found.C.T) * np.outer(sizes, sizes)
    # h⁴/30 = 5e-13 times a fifth derivative, which is large where a mechanism turns sharply; measured 2e-8 at worst.
    assert np.abs(left).max() <= 1e-6 * np.abs(found.M * np.outer(sizes, sizes)).max()


def test_coriolis_matrix_gives_the_coriolis_efforts(held: Case, coordinates: str) -> None:
    """Without motion of their own, idle freedoms add nothing: the two ways to the efforts agree."""
    chain = held.chain
    rate = stp.dynamics.motion_map(chain, held.q, held.v, coordinates=coordinates)
    v = rate.G @ rate.rate
    found = stp.operational_dynamics(chain, held.q, v, coordinates=coordinates)
    # Both come from one motion map, whose parts are of the size of M times the square of the rates.
    rate = np.abs(found.motion.rate).max()
    size = max(np.abs(found.C).max() * rate, np.abs(found.M).max() * rate**2)
    assert np.abs(found.c - found.C @ found.motion.rate).max() <= 1e-9 * max(size, 1e-300)


def test_motor_and_platform_efforts_do_the_same_work(held: Case) -> None:
    """(S G)ᵀ takes motor efforts to the platform: power is power."""
    chain, rng = held.chain, np.random.default_rng(5)
    found = stp.dynamics.motion_map(chain, held.q, held.v, coordinates="platform")
    if found.rest.shape[1] and np.abs(found.rest[chain.motor_index]).max() > 1e-8:
        pytest.skip("a redundant arm's motors also move it within itself")
    tau_motor = rng.normal(size=chain.nu) / chain.tangent_scale[chain.motor_index]
    power = tau_motor @ held.v[chain.motor_index]
    size = np.abs(tau_motor * held.v[chain.motor_index]).sum()
    assert abs((found.share.T @ tau_motor) @ found.rate - power) <= round_off(held, 1e-10) * size
