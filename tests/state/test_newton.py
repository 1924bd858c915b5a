"""Closing loops: from how far, to how near, to which of the many closed configurations."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ClosureError, InputError, StewartPinError
from stewart_pin.model.description import JointKind
from stewart_pin.tolerances import CLOSED as TOLERANCE
from tests.closed_states import random_configuration, robot
from tests.mechanisms import five_bar, four_bar
from tests.zoo.table import ROBOTS


def guesses(chain: stp.ClosedChain, rng: np.random.Generator, n: int):
    """Draw valid poses, and guesses within 0.3 m (small robots: their size) and 30° of them in every joint."""
    far = min(0.3 * max(1.0, chain.length_scale), chain.length_scale)
    reach = np.where(chain.tangent_scale == 1.0, np.deg2rad(30), far)
    for _ in range(n):
        q = random_configuration(chain, rng, 0.2)
        yield q, pin.integrate(chain.model, q, reach * rng.uniform(-1, 1, chain.nv))


@pytest.mark.parametrize("name", ROBOTS)
def test_closes_from_afar(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    farther = []
    for q, guess in guesses(chain, rng, 60):
        closure = stp.close_loops(chain, guess)
        assert closure.gap <= 1e-12 * max(1.0, chain.length_scale)
        here = pin.difference(chain.model, guess, closure.q) / chain.tangent_scale
        known = pin.difference(chain.model, guess, q) / chain.tangent_scale
        farther.append(np.linalg.norm(here) / np.linalg.norm(known))
    # The nearest closed configuration is no farther than the one the guess came from. The path is not straight, least
    # so for a Delta, whose platform cannot turn at all: 2.6 times as far in the worst of 300 guesses, others 1.4.
    assert max(farther) <= 3.0 and np.median(farther) <= 1.0


@pytest.mark.slow  # 5 s each on an idle core
@pytest.mark.parametrize("name", ROBOTS)
def test_closes_from_all_of_500_guesses(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    worst = max(stp.close_loops(chain, guess).gap for _, guess in guesses(chain, rng, 500))
    assert worst <= 1e-12 * max(1.0, chain.length_scale)


def test_moves_no_more_than_it_has_to(rng: np.random.Generator) -> None:
    """To first order the step is the least-norm one: orthogonal to the motions that keep the loops closed."""
    chain = robot("stewart_sps")
    q = random_configuration(chain, rng, 0.1)
    guess = pin.integrate(chain.model, q, 1e-6 * rng.normal(size=chain.nv) * chain.tangent_scale)
    step = pin.difference(chain.model, guess, stp.close_loops(chain, guess).q) / chain.tangent_scale
    motions = stp.loop_jacobian(chain, q) * chain.tangent_scale
    inside = step - np.linalg.pinv(motions) @ (motions @ step)
    # Second order: the square of the displacement.
    assert np.linalg.norm(inside) <= 1e-4 * np.linalg.norm(step)


def test_idle_spins_do_not_drift() -> None:
    """Follow a closed path of 200 poses: each leg comes home with the spin that it left with."""
    chain = robot("stewart_sps")
    spins = [k for k, name in enumerate(chain.tangent_names) if name.endswith("_z")]
    assert len(spins) == 6
    index = [chain.model.joints[chain.model.getJointId(chain.tangent_names[k])].idx_q for k in spins]
    home, q = stp.platform_pose(chain, chain.q_home), chain.q_home
    for t in np.linspace(0, 2 * np.pi, 201)[1:]:
        turn = pin.exp3(0.25 * np.array([np.sin(t), 1 - np.cos(t), np.sin(2 * t)]))
        move = 0.15 * np.array([1 - np.cos(t), np.sin(t), np.sin(2 * t)])
        q = stp.inverse_kinematics(chain, pin.SE3(turn @ home.rotation, home.translation + move), q_guess=q).q
    assert np.abs(q[index] - chain.q_home[index]).max() <= 1e-12
    assert np.abs(pin.difference(chain.model, chain.q_home, q)).max() <= 1e-11


def test_redundant_rows_make_no_difference() -> None:
    for chain in (four_bar(JointKind.SPHERICAL), four_bar(JointKind.REVOLUTE), five_bar()):
        guess = pin.integrate(chain.model, chain.q_home, np.full(chain.nv, 0.1))
        closure = stp.close_loops(chain, guess)
        assert closure.success and np.isfinite(closure.q).all() and closure.gap <= 1e-13


def test_what_cannot_close_says_how_near_it_came() -> None:
    chain = four_bar()
    far = chain.q_home.copy()
    closure = stp.close_loops(chain, far + 0.3, max_iterations=1, throw=False)
    assert not closure.success and closure.iterations == 1 and closure.gap > 1e-6
    assert closure.gap == pytest.approx(np.abs(stp.loop_gap(chain, closure.q)).max())
    with pytest.raises(ClosureError, match="after 1 steps") as caught:
        stp.close_loops(chain, far + 0.3, max_iterations=1)
    assert isinstance(caught.value, StewartPinError)
    assert caught.value.residual == closure.gap and caught.value.iterations == 1
    np.testing.assert_array_equal(caught.value.q, closure.q)


def test_a_mechanism_that_never_closes() -> None:
    """A rod too short by 0.1 m: the solver stops at the nearest approach instead of running on."""
    from dataclasses import replace

    chain = four_bar()
    short = pin.SE3(np.eye(3), np.array([-2.0, 0.0, 0.0]))
    mechanism = replace(chain.mechanism, loops=(replace(chain.loops[0], placement1=short),))
    broken = stp.ClosedChain(mechanism, chain.model, chain.motors, chain.platform, chain.q_home)
    with pytest.raises(ClosureError) as caught:
        stp.close_loops(broken, chain.q_home)
    # Farthest reach: 0.9 + 0.6 + 0.3 < 2.0.
    assert caught.value.residual > 0.1


def test_no_iterations() -> None:
    chain = robot("stewart")
    closure = stp.close_loops(chain, chain.q_home, max_iterations=0)
    assert closure.success and closure.iterations == 0
    np.testing.assert_array_equal(closure.q, chain.q_home)
    moved = pin.integrate(chain.model, chain.q_home, np.full(chain.nv, 0.01))
    assert not stp.close_loops(chain, moved, max_iterations=0, throw=False).success


def test_tolerance_is_what_success_means() -> None:
    chain = robot("stewart")
    moved = pin.integrate(chain.model, chain.q_home, np.full(chain.nv, 0.05))
    rough = stp.close_loops(chain, moved, tolerance=1e-3)
    fine = stp.close_loops(chain, moved)
    assert rough.iterations < fine.iterations
    assert rough.gap <= 1e-3 * chain.length_scale and fine.gap <= TOLERANCE * chain.length_scale


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_iterations": -1}, "max_iterations must be 0 or more, got -1"),
        ({"tolerance": 0.0}, "tolerance must be a finite number above zero"),
        ({"tolerance": np.nan}, "tolerance must be a finite number above zero"),
    ],
)
def test_bad_options(options: dict, message: str) -> None:
    chain = robot("stewart")
    with pytest.raises(InputError, match=message):
        stp.close_loops(chain, chain.q_home, **options)


def test_bad_guesses() -> None:
    chain = robot("stewart")
    doubled = chain.q_home.copy()
    index = chain.model.joints[chain.model.getJointId("platform_pose")].idx_q
    doubled[index + 3 : index + 7] *= 2
    for guess, message in (
        (doubled, "q_guess holds a quaternion that is not of unit length"),
        (np.zeros(3), r"q_guess must have shape \(25,\)"),
        (np.full(chain.nq, np.inf), "q_guess must be finite, got inf"),
        (["a"] * chain.nq, "q_guess must be an array of real numbers"),
    ):
        with pytest.raises(InputError, match=message):
            stp.close_loops(chain, guess)
