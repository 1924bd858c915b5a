"""Efforts: at singular poses, with too few, too many and bounded motors, with idle freedoms, from wrong input."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ActuationError, ConvergenceError, InputError, SingularityError
from stewart_pin.model.description import JointKind
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.mechanisms import five_bar, four_bar

pytestmark = pytest.mark.filterwarnings("error")

METHODS = ("pinocchio", "constraint_matrix")


@pytest.fixture(scope="module")
def singular() -> tuple[stp.ClosedChain, np.ndarray]:
    """Return the hexapod turned by 90° about z, where six legs cannot hold it."""
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(pin.exp3(np.array([0, 0, np.pi / 2])) @ home.rotation, home.translation)
    return chain, stp.inverse_kinematics(chain, pose, limits=False).q


@pytest.mark.parametrize("method", METHODS)
def test_singular_pose(method: str, singular) -> None:
    chain, q = singular
    rest = np.zeros(chain.nv)
    with pytest.raises(ActuationError, match="the motors cannot hold the robot here") as caught:
        stp.inverse_dynamics(chain, q, rest, rest, method=method)
    error = caught.value
    assert isinstance(error, SingularityError)
    # Round-off of the pose itself, 1e-16, is all that keeps it off the singularity.
    assert 0 <= error.smallest_singular_value <= 1e-12
    assert error.direction.shape == (len(error.names),) and np.isfinite(error.direction).all()
    if method == "pinocchio":
        assert error.names[int(np.argmax(np.abs(error.direction)))] in str(error)


def test_the_freedom_left_over_moves_the_platform_and_no_motor(singular) -> None:
    chain, q = singular
    rest = np.zeros(chain.nv)
    with pytest.raises(ActuationError) as caught:
        stp.inverse_dynamics(chain, q, rest, rest)
    direction = caught.value.direction
    assert caught.value.names == chain.tangent_names
    assert np.abs(direction[chain.motor_index]).max() <= 1e-12
    assert np.abs(stp.loop_jacobian(chain, q) @ direction).max() <= 1e-12
    assert np.abs(direction).max() == pytest.approx(1.0)


def test_both_methods_name_the_same_motion(singular) -> None:
    """What is singular is a property of the state: it is found once, and told by every method."""
    chain, q = singular
    rest, motions = np.zeros(chain.nv), []
    for method in METHODS:
        with pytest.raises(ActuationError) as caught:
            stp.inverse_dynamics(chain, q, rest, rest, method=method)
        motions.append(caught.value.direction)
    assert np.array_equal(*motions)
    # With the motors at rest the loops stay closed, and the platform moves.
    assert np.abs(motions[0][chain.motor_index]).max() < 1e-9
    assert np.abs(stp.loop_jacobian(chain, q) @ motions[0]).max() < 1e-9
    assert np.abs(chain.at(q, motions[0]).twist).max() > 0.1


def test_least_squares_at_a_singular_pose(singular) -> None:
    """Turned by 90°, the platform sinks as it turns: nothing carries part of its weight, and each method says so."""
    chain, q = singular
    rest = np.zeros(chain.nv)
    with pytest.raises(ActuationError) as caught:
        stp.inverse_dynamics(chain, q, rest, rest)
    lost = caught.value.direction
    # What the lost freedom would need is what the efforts leave over, and all of it.
    effort = stp.inverse_dynamics(chain, q, rest, rest, throw=False)
    needed = pin.rnea(chain.model, pin.Data(chain.model), q, rest, rest)
    supplied = stp.loop_jacobian(chain, q).T @ effort.lambda_c
    supplied[chain.motor_index] += effort.tau_motor
    assert abs(lost @ needed) > 1
    assert abs(lost @ supplied) <= 1e-10
    assert effort.residual == pytest.approx(np.abs(needed - supplied).max())
    # In maximal coordinates the motors do what they must, and the platform sinks: no residual, but another motion.
    other = stp.inverse_dynamics(chain, q, rest, rest, method="constraint_matrix", throw=False)
    assert not effort.unique and not other.unique
    assert other.residual <= 1e-9
    assert np.abs(other.a).max() > 0.1 and np.abs(other.a[chain.motor_index]).max() <= 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_too_few_motors(method: str) -> None:
    chain = five_bar(("left_hip",))
    rest = np.zeros(chain.nv)
    with pytest.raises(ActuationError, match="cannot hold"):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, method=method)
    assert np.isfinite(
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, method=method, throw=False).tau_motor
    ).all()


@pytest.mark.parametrize("kind", [JointKind.SPHERICAL, JointKind.REVOLUTE])
@pytest.mark.parametrize("method", METHODS)
def test_redundant_rows_leave_the_reactions_open(
    kind: JointKind, method: str, rng: np.random.Generator
) -> None:
    """What a planar linkage passes across its plane nobody knows; the motor's effort everybody does."""
    chain = four_bar(kind)
    q = random_configuration(chain, rng, 0.3)
    v, a = random_motion(chain, rng, q)
    effort = stp.inverse_dynamics(chain, q, v, a, method=method)
    assert effort.unique and not effort.reactions_unique
    assert np.isfinite(effort.lambda_c).all() and effort.residual <= 1e-12
    assert np.abs(effort.lambda_c[2:]).max() <= 1e-12  # least norm: nothing across the plane
    close(stp.forward_dynamics(chain, q, v, effort.tau_motor).a, effort.a, 1e-11)


def test_idle_freedoms_follow_their_own_inertia(rng: np.random.Generator) -> None:
    """No motor spins a leg: a demand to do so changes nothing."""
    chain = robot("stewart_sps")
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    spin = np.zeros(chain.nv)
    spin[[k for k, name in enumerate(chain.tangent_names) if name.endswith("_z")]] = rng.normal(size=6)
    for method in METHODS:
        one = stp.inverse_dynamics(chain, q, v, a, method=method)
        two = stp.inverse_dynamics(chain, q, v, a + 10 * spin, method=method)
        close(two.tau_motor, one.tau_motor, 1e-11)
        close(two.a, one.a, 1e-10)
        assert np.abs(two.a - a - 10 * spin).max() > 1


def test_power_of_the_reactions_is_nothing(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    effort = stp.inverse_dynamics(chain, q, v, a)
    assert abs(effort.lambda_c @ stp.loop_jacobian(chain, q) @ v) <= 1e-11


def test_equation_of_motion(rng: np.random.Generator) -> None:
    """M a + nle = Sᵀ tau_motor + J_cᵀ lambda_c: the signs of the glossary, with Pinocchio's own terms."""
    for chain in (robot("stewart"), robot("stewart_sps"), four_bar()):
        q = random_configuration(chain, rng, 0.1)
        v, a = random_motion(chain, rng, q)
        for method in METHODS:
            effort = stp.inverse_dynamics(chain, q, v, a, method=method)
            left = pin.rnea(chain.model, pin.Data(chain.model), q, v, effort.a)
            right = stp.loop_jacobian(chain, q).T @ effort.lambda_c
            right[chain.motor_index] += effort.tau_motor
            close(right, left, 1e-12)


def test_positive_effort_pushes_the_platform_away() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    assert (stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor > 0).all()


# --- efforts within limits -----------------------------------------------------------------------------------


def freedom_of_efforts(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Efforts that move nothing, found by trying: (nu, k)."""
    none = stp.forward_dynamics(chain, q, v, np.zeros(chain.nu)).a
    effect = np.array([stp.forward_dynamics(chain, q, v, unit).a - none for unit in np.eye(chain.nu)]).T
    _, s, vt = np.linalg.svd(effect)
    return vt[np.count_nonzero(s > 1e-9 * s[0]) :].T


@pytest.mark.parametrize("share", [0.999, 0.9, 0.8])
def test_bounded_efforts_equal_a_search(share: float, rng: np.random.Generator) -> None:
    """Two freedoms, three motors: search the one line of efforts for the least norm within limits."""
    chain = five_bar()
    q = random_configuration(chain, rng, 0.2)
    v, a = random_motion(chain, rng, q)
    free = stp.inverse_dynamics(chain, q, v, a)
    line = freedom_of_efforts(chain, q, v)
    assert line.shape == (3, 1) and not free.unique
    limit = share * np.abs(free.tau_motor).max()
    along = np.linspace(-20, 20, 2_000_001)[:, None]
    candidates = free.tau_motor + along * line[:, 0]
    candidates = candidates[(np.abs(candidates) <= limit).all(axis=1)]
    best = candidates[np.argmin((candidates**2).sum(axis=1))]
    bounded = stp.inverse_dynamics(chain, q, v, a, effort_limit=limit)
    assert np.abs(bounded.tau_motor).max() <= limit * (1 + 1e-12)
    np.testing.assert_allclose(bounded.tau_motor, best, atol=5e-5)  # the search's own grid is 2e-5
    assert bounded.residual <= 1e-12 and not bounded.unique
    close(stp.forward_dynamics(chain, q, v, bounded.tau_motor).a, a, 1e-10)


def test_wide_limits_change_nothing(rng: np.random.Generator) -> None:
    chain = five_bar()
    q = random_configuration(chain, rng, 0.2)
    v, a = random_motion(chain, rng, q)
    free = stp.inverse_dynamics(chain, q, v, a).tau_motor
    for limit in (1e3, np.full(3, 1e6), np.inf, [np.inf, 1e3, np.inf]):
        close(stp.inverse_dynamics(chain, q, v, a, effort_limit=limit).tau_motor, free, 1e-12)


def test_limits_that_cannot_be_kept(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    weight = stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor.max()
    with pytest.raises(ConvergenceError, match="no efforts within effort_limit carry the load") as caught:
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=0.5 * weight)
    assert caught.value.residual > 1
    with pytest.raises(ConvergenceError):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=0.0)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        (-1.0, "effort_limit must be 0 or more"),
        (np.nan, "effort_limit must be 0 or more"),
        ([1.0, 2.0], r"effort_limit must be a number or have shape \(6,\), got \(2,\)"),
        ("strong", "effort_limit must be a number or have shape"),
    ],
)
def test_bad_limits(limit, message: str) -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    with pytest.raises(InputError, match=message):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=limit)


# --- wrong input ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["q", "v", "a"])
def test_bad_arrays_are_named(method: str, name: str) -> None:
    chain = robot("stewart")
    right = {"q": chain.q_home, "v": np.zeros(chain.nv), "a": np.zeros(chain.nv)}
    for wrong, message in (
        (np.zeros(7), f"{name} must have shape"),
        (np.zeros((chain.nv, 1)), f"{name} must have shape"),
        (np.full_like(right[name], np.nan), f"{name} must be finite"),
        (["x"] * right[name].size, f"{name} must be an array of real numbers"),
    ):
        with pytest.raises(InputError, match=message):
            stp.inverse_dynamics(chain, **(right | {name: wrong}), method=method)


@pytest.mark.parametrize("method", METHODS)
def test_states_that_do_not_keep_the_loops_closed(method: str, rng: np.random.Generator) -> None:
    """Dynamics of an open loop would be a wrong answer without a word."""
    chain = robot("stewart")
    rest, some = np.zeros(chain.nv), 1e-3 * rng.normal(size=chain.nv)
    apart = pin.integrate(chain.model, chain.q_home, some)
    with pytest.raises(InputError, match=r"q does not keep .*see close_loops"):
        stp.inverse_dynamics(chain, apart, rest, rest, method=method)
    with pytest.raises(InputError, match=r"v does not keep .*leg.*_ball.*see platform_motion"):
        stp.inverse_dynamics(chain, chain.q_home, some, rest, method=method)
    with pytest.raises(InputError, match=r"a does not keep .*leg.*_ball.*see platform_motion"):
        stp.inverse_dynamics(chain, chain.q_home, rest, some, method=method)
    # Digits that a text file keeps are enough.
    printed = pin.normalize(chain.model, np.round(chain.q_home, 9))
    assert stp.inverse_dynamics(chain, printed, rest, rest, method=method).tau_motor.shape == (6,)


def test_unknown_method() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    with pytest.raises(InputError, match="method must be one of pinocchio, constraint_matrix, got 'magic'"):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, method="magic")
    with pytest.raises(InputError, match="effort_limit is for method 'pinocchio'"):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, method="constraint_matrix", effort_limit=1.0)
