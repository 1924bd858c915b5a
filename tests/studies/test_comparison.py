"""The comparison of methods: they agree, and the shares add up."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.studies.comparison import spread
from tests.motion.turning import turning
from tests.zoo.table import zoo_chain


@pytest.fixture(scope="module")
def comparison() -> stp.sweeps.Comparison:
    chain = stp.load("stewart")
    motion = stp.motions.sinusoidal_motion(
        stp.motions.sample_times(1.0, 30.0), home=stp.platform_pose(chain, chain.q_home)
    )
    return stp.compare_methods(chain, motion)


def test_all_methods_agree(comparison: stp.sweeps.Comparison) -> None:
    # S0.9, S0.10: with masses three methods, without legs' masses and with a point platform four.
    assert set(comparison.forces) == {"pinocchio", "constraint_matrix", "closed_form"}
    assert set(comparison.simplified) == {*comparison.forces, "point_mass"}
    # Round-off: condition number of the 168 equations (about 1e3) times eps.
    assert max(comparison.agreement.values()) < 1e-12


def test_the_legs_masses_explain_the_error_of_the_point_mass(comparison: stp.sweeps.Comparison) -> None:
    # S0.10: the source blames the legs' masses; they are responsible for a third of the force.
    error = comparison.reference - comparison.simplified["point_mass"]
    shares = comparison.contributions
    total = sum(shares.values())
    np.testing.assert_allclose(total, comparison.reference, atol=1e-10)
    np.testing.assert_allclose(
        error, shares["platform inertia"] + shares["leg masses"] + shares["leg inertia"], atol=1e-10
    )

    def rms(x) -> float:
        return float(np.sqrt(np.mean(x**2)))

    assert 0.3 < rms(error) / rms(shares["platform mass"]) < 0.45
    assert rms(shares["platform inertia"]) < 1e-10  # the platform does not turn
    assert 0.0 < rms(shares["leg inertia"]) < 0.05 * rms(error)


@pytest.mark.parametrize("name", ["stewart", pytest.param("delta", marks=pytest.mark.slow)])
def test_kernels_are_a_method_of_their_own(name: str) -> None:
    chain = stp.load(name)
    size = 0.05 * chain.length_scale
    home = stp.platform_pose(chain, chain.q_home)
    motion = stp.motions.sinusoidal_motion(
        stp.motions.sample_times(1.0, 10.0), amplitude=(size, size, size), home=home
    )
    plain = stp.compare_methods(chain, motion, kernels=False)
    fast = stp.compare_methods(chain, motion, kernels=True)
    assert set(fast.forces) == {*plain.forces, "kernels"} and "kernels" in fast.simplified
    assert max(fast.agreement.values()) < 1e-11
    largest = np.abs(plain.reference).max()
    for part, share in fast.contributions.items():
        np.testing.assert_allclose(share, plain.contributions[part], atol=1e-10 * largest)


def test_progress_is_told(comparison: stp.sweeps.Comparison) -> None:
    chain = stp.load("stewart_cad")
    motion = stp.motions.sinusoidal_motion([0.0, 0.1], home=stp.platform_pose(chain, chain.q_home))
    told: list[tuple[str, int, int]] = []
    result = stp.compare_methods(chain, motion, progress=lambda *report: told.append(report))
    assert ("kinematics", 2, 2) in told and ("constraint_matrix", 1, 2) in told
    assert result.agreement["agreement"] < 1e-12


def test_spread_is_relative_to_the_largest_force() -> None:
    one, other = np.array([[1.0, -4.0]]), np.array([[1.5, -4.0]])
    assert spread({"a": one, "b": other}) == pytest.approx(0.5 / 4.0)
    assert spread({"a": 0 * one}) == 0.0
    assert np.isnan(spread({"a": one, "b": np.nan * one}))


@pytest.mark.parametrize(
    ("chain", "turns", "why"),
    [
        pytest.param(stp.load("four_bar"), 1.0, "no answer at", marks=pytest.mark.slow),
        (zoo_chain("planetary_gear"), 2.34, "counts whole turns"),
    ],
)
def test_kernels_that_lose_the_motion_are_no_method(chain: stp.ClosedChain, turns: float, why: str) -> None:
    """They start at home: behind a dead centre, or after a turn of a gear, they have none or another state."""
    samples = turning(chain, turns, 60)[0]
    plain = stp.compare_methods(chain, samples, kernels=False)
    found = stp.compare_methods(chain, samples, kernels=True)
    assert set(found.forces) == set(plain.forces) and any(why in note for note in found.notes)
    assert found.agreement == plain.agreement
    for part, share in plain.contributions.items():
        np.testing.assert_array_equal(found.contributions[part], share)


def test_what_joints_do_is_a_share_of_its_own() -> None:
    chain = stp.load("stewart")
    own = {"armature": 2.0, "damping": 30.0, "friction": 5.0, "stiffness": 200.0, "rest": 0.9}
    real = stp.with_joint_physics(chain, dict.fromkeys(chain.motors, own))
    motion = stp.motions.sinusoidal_motion(
        np.array([0.02, 0.3]), home=stp.platform_pose(chain, chain.q_home), amplitude=(0.05, 0.0, 0.02)
    )
    push = {"platform": [20.0, 0.0, -50.0, 0.0, 0.0, 0.0]}
    bare, found = (stp.compare_methods(each, motion, wrenches=push) for each in (chain, real))
    assert max(found.agreement.values()) < 1e-12 and "closed_form" not in found.forces
    for part, share in bare.contributions.items():
        np.testing.assert_allclose(found.contributions[part], share, atol=1e-9)
    joints = found.contributions["joints"]
    np.testing.assert_allclose(joints, found.reference - bare.reference, atol=1e-9)
    assert np.abs(joints).max() > 10.0
    np.testing.assert_allclose(sum(found.contributions.values()), found.reference, atol=1e-9)
