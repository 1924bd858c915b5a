"""Legs whose nut turns with them: length = reading + lead / 2π × spin, by directions of two universal joints alone."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.building.test_hexapod_chain import BODIES

LEAD = 0.02


def spin_of(foot: np.ndarray, head: np.ndarray, home: pin.SE3, pose: pin.SE3) -> tuple[float, float]:
    """Length of a leg, and by how much its rod has turned in its sleeve since home.

    The sleeve keeps its y across the leg and the base's x, the rod an axis across the leg and the platform's x.
    """

    def seen(at: pin.SE3) -> tuple[float, float]:
        leg = at.act(head) - foot
        along = leg / np.linalg.norm(leg)
        sleeve, rod = np.cross(along, [1.0, 0.0, 0.0]), np.cross(along, at.rotation[:, 0])
        angle = np.arctan2(along @ np.cross(sleeve, rod), sleeve @ rod)
        return float(np.linalg.norm(leg)), float(angle)

    (_, start), (length, now) = seen(home), seen(pose)
    return length, float(np.angle(np.exp(1j * (now - start))))


def moving(chain: stp.ClosedChain, rng: np.random.Generator) -> stp.State:
    """Tilt and twist the platform, and let it move."""
    home = stp.platform_pose(chain, chain.q_home)
    pose = home * pin.SE3(pin.exp3(rng.uniform(-0.25, 0.25, 3)), rng.uniform(-0.1, 0.1, 3))
    return stp.platform_motion(chain, pose, rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 6))


@pytest.mark.parametrize("lead", [LEAD, -0.3])
def test_motors_read_the_length_less_what_the_spin_has_made_of_it(
    lead: float, report_ideal: stp.Hexapod, rng: np.random.Generator
) -> None:
    chain = stp.hexapod_chain(report_ideal, **BODIES, lead=lead)
    assert stp.mobility(chain).dof == 6 and stp.mobility(chain).motors_sufficient
    home = stp.platform_pose(chain, chain.q_home)
    for _ in range(3):
        state = moving(chain, rng)
        ends = zip(report_ideal.base_points, report_ideal.platform_points, strict=True)
        expected, spins = [], []
        for foot, head in ends:
            length, spin = spin_of(foot, head, home, state.pose)
            expected.append(length - lead / (2 * np.pi) * spin)
            spins.append(spin)
        np.testing.assert_allclose(stp.motor_positions(chain, state.q), expected, atol=1e-10)
        assert np.abs(spins).max() > 0.05
        back = stp.forward_kinematics(chain, expected)
        np.testing.assert_allclose(
            stp.platform_pose(chain, back.q).homogeneous, state.pose.homogeneous, atol=1e-9
        )


def test_a_thread_of_no_lead_at_all_is_a_cylinder(
    report_ideal: stp.Hexapod, rng: np.random.Generator
) -> None:
    """With a lead of next to nothing motors give what those of plain legs do, whose rods turn as freely."""
    fine, plain = (
        stp.hexapod_chain(report_ideal, **BODIES, lead=1e-12),
        stp.hexapod_chain(report_ideal, **BODIES),
    )
    still = stp.platform_pose(plain, plain.q_home)
    rest = np.zeros(6)
    forces = [
        stp.inverse_dynamics(stp.platform_motion(chain, still, rest, rest)).tau_motor
        for chain in (fine, plain)
    ]
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-9)


def test_power_is_kept_and_every_formulation_agrees(
    report_ideal: stp.Hexapod, rng: np.random.Generator
) -> None:
    chain = stp.hexapod_chain(report_ideal, **BODIES, lead=LEAD)
    rotor = 2e-5 * (2 * np.pi / LEAD) ** 2
    chain = stp.with_joint_physics(chain, {leg: {"armature": rotor, "friction": 4.0} for leg in chain.motors})
    state = moving(chain, rng)
    tau = stp.inverse_dynamics(state).tau_motor
    by_bodies = stp.inverse_dynamics(state, method="constraint_matrix").tau_motor
    np.testing.assert_allclose(by_bodies, tau, atol=1e-8 * np.abs(tau).max())
    forth = stp.forward_dynamics(state, tau_motor=tau).a
    np.testing.assert_allclose(forth, state.a, atol=1e-7 * np.abs(state.a).max())

    def energy(t: float) -> float:
        q = stp.close_loops(chain, pin.integrate(chain.model, state.q, t * state.v + t * t / 2 * state.a)).q
        v = state.v + t * state.a
        data = chain.model.createData()
        kinetic = v @ chain.at(q).M @ v / 2
        return float(kinetic + pin.computePotentialEnergy(chain.model, data, q))

    step = 1e-5
    power = (energy(step) - energy(-step)) / (2 * step)
    rates = state.v[chain.motor_index]
    assert tau @ rates - 4.0 * np.abs(rates).sum() == pytest.approx(power, rel=1e-5)


def test_what_is_no_screw_is_refused(report_ideal: stp.Hexapod) -> None:
    for given, says in (
        ({"lead": 0.0}, "lead must be the travel per turn"),
        ({"lead": LEAD, "lower_joint": "spherical"}, "nothing holds its nut"),
        ({"lead": LEAD, "ball_swing": 0.5}, "universal joints, not on balls"),
    ):
        with pytest.raises(InputError, match=says):
            stp.hexapod_chain(report_ideal, **BODIES, **given)
