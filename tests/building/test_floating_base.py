"""A chain on a free base: same parts, six more freedoms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ActuationError, InputError
from tests.closed_states import NAMES

BUS = pin.Inertia(50.0, np.array([0.1, 0.0, 0.05]), np.diag([3.0, 4.0, 5.0]))


@pytest.mark.parametrize("name", NAMES)
def test_the_rest_stays_as_it_was(name: str) -> None:
    chain = stp.load(name)
    pose = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([1.0, 2.0, 3.0]))
    free = stp.on_floating_base(chain, BUS, pose=pose, gravity=(0, 0, -1.62))
    assert (free.nq, free.nv, free.nc, free.nu) == (chain.nq + 7, chain.nv + 6, chain.nc, chain.nu)
    assert (free.motors, free.platform) == (chain.motors, chain.platform)
    np.testing.assert_array_equal(free.q_home[7:], chain.q_home)
    np.testing.assert_array_equal(free.gravity, [0, 0, -1.62])
    moved = pose * stp.platform_pose(chain, chain.q_home)
    assert stp.platform_pose(free, free.q_home).isApprox(moved, 1e-12)
    assert free.tangent_names[0] == "floating_base vx"
    # Pinocchio does not count what is fixed to the world.
    before, after = (pin.computeTotalMass(x.model, pin.Data(x.model)) for x in (chain, free))
    assert after == pytest.approx(before + BUS.mass)


def test_the_grounds_own_mass_is_the_default() -> None:
    chain = stp.load("stewart")
    free = stp.on_floating_base(chain)
    assert free.mechanism.link("base").inertia.mass == 40.0
    np.testing.assert_array_equal(free.gravity, chain.gravity)


def test_a_free_fall_is_felt_by_nobody(rng: np.random.Generator) -> None:
    # At rest and without effort everything falls together: joints keep still.
    free = stp.on_floating_base(stp.load("arm_7r"), BUS)
    q = pin.integrate(free.model, free.q_home, rng.normal(size=free.nv))
    motion = stp.forward_dynamics(free, q, np.zeros(free.nv), np.zeros(7))
    rotation = pin.XYZQUATToSE3(q[:7]).rotation
    np.testing.assert_allclose(rotation @ motion.a[:3], [0, 0, -9.81], rtol=0, atol=1e-11)
    np.testing.assert_allclose(motion.a[3:], 0, rtol=0, atol=1e-11)


def test_nothing_holds_a_free_base() -> None:
    free = stp.on_floating_base(stp.load("stewart"))
    rest = np.zeros(free.nv)
    with pytest.raises(ActuationError, match="floating_base"):
        stp.inverse_dynamics(free, free.q_home, rest, rest)
    report = stp.mobility(free)
    assert (report.dof, report.lost, report.motors_sufficient) == (12, 6, False)


def test_a_free_chain_survives_writing(tmp_path) -> None:
    free = stp.on_floating_base(stp.load("arm_3r_spatial"), BUS)
    stp.write_urdf(free, tmp_path / "free.urdf")
    again = stp.load(tmp_path / "free.urdf")
    assert again.model == free.model
    np.testing.assert_array_equal(again.q_home, free.q_home)


def test_bad_requests_are_named() -> None:
    arm = stp.load("arm_7r")
    with pytest.raises(InputError, match="base_inertia is needed: the ground link 'base' has no mass"):
        stp.on_floating_base(arm)
    with pytest.raises(InputError, match="base_inertia is needed"):
        stp.on_floating_base(arm, pin.Inertia.Zero())
    with pytest.raises(InputError, match=r"base_inertia must be a pinocchio\.Inertia"):
        stp.on_floating_base(arm, 12.0)
    with pytest.raises(InputError, match="'floating_base' is taken"):
        stp.on_floating_base(stp.on_floating_base(arm, BUS), BUS)
