"""How redundant motors share a load within limits: against enumeration, HiGHS and closed forms."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import stewart_pin as stp
from stewart_pin.errors import ConvergenceError, EffortLimitError, InputError, UnsupportedError
from stewart_pin.mechanics.sharing import Sharing
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.mechanisms import five_bar
from tests.pulled import boxed, planar

SQUARE = [(-1.0, -0.8), (1.0, -0.9), (1.1, 1.0), (-0.9, 0.8)]
CORNERS = [(-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)]
CROSSED = [CORNERS[k] for k in (1, 0, 3, 2)]


def crossed(efforts: tuple[float, float] = (1.0, 60.0)) -> stp.ClosedChain:
    """Four cables for the three freedoms of a plate in a plane."""
    return planar(SQUARE, CROSSED, at_rest=(0.1, 0.05, 0.1), efforts=efforts)


def all_efforts(
    chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Efforts that make the motion, and those that move nothing, found by trying: x + Z y."""
    none = stp.forward_dynamics(chain, q, v, np.zeros(chain.nu)).a
    effect = np.array([stp.forward_dynamics(chain, q, v, unit).a - none for unit in np.eye(chain.nu)]).T
    effect /= chain.tangent_scale[:, None]
    _, s, vt = np.linalg.svd(effect)
    return stp.inverse_dynamics(chain, q, v, a).tau_motor, vt[np.count_nonzero(s > 1e-9 * s[0]) :].T


def nearest(x: np.ndarray, Z: np.ndarray, goal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Try every choice of limits that hold, and take the nearest to the goal that keeps all of them."""
    best, least = None, np.inf
    slack = 1e-9 * np.abs(bounds[np.isfinite(bounds)]).max()
    ends = [(k, end) for k in range(len(x)) for end in bounds[k] if np.isfinite(end)]
    for count in range(Z.shape[1] + 1):
        for chosen in combinations(ends, count):
            rows = np.array([k for k, _ in chosen], dtype=int)
            y = Z.T @ (goal - x)
            if count:
                gap = np.array([end for _, end in chosen]) - x[rows] - Z[rows] @ y
                if np.linalg.matrix_rank(Z[rows], tol=1e-9) < count:
                    continue
                y = y + np.linalg.lstsq(Z[rows], gap, rcond=1e-12)[0]
            found = x + Z @ y
            if (found < bounds[:, 0] - slack).any() or (found > bounds[:, 1] + slack).any():
                continue
            if np.linalg.norm(found - goal) < least - 1e-13:
                best, least = found, np.linalg.norm(found - goal)
    assert best is not None
    return best


def peak_of(x: np.ndarray, Z: np.ndarray, bounds: np.ndarray) -> float:
    """Least of the largest absolute efforts."""
    n, r = Z.shape
    rows = np.block(
        [[Z, -np.ones((n, 1))], [-Z, -np.ones((n, 1))], [Z, np.zeros((n, 1))], [-Z, np.zeros((n, 1))]]
    )
    right = np.concatenate([-x, x, bounds[:, 1] - x, x - bounds[:, 0]])
    kept = np.isfinite(right)
    found = linprog(
        np.eye(r + 1)[-1], A_ub=rows[kept], b_ub=right[kept], bounds=(None, None), method="highs-ds"
    )
    assert found.status == 0
    return float(found.fun)


def loaded(chain: stp.ClosedChain, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    v, a = random_motion(chain, rng, chain.q_home)
    return chain.q_home, v, a


CHAINS = {"eight": boxed, "seven": lambda: boxed(7), "crossed": crossed}


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("limits", ["loose", "tight", "one without"])
def test_shares_are_the_best_there_are(name: str, limits: str, rng: np.random.Generator) -> None:
    chain = CHAINS[name]()
    for _ in range(3):
        motion = loaded(chain, rng)
        x, Z = all_efforts(chain, *motion)
        inside = x + Z @ (3 * np.linalg.norm(x) * rng.normal(size=Z.shape[1]))
        room = (
            np.abs(inside).max() * (3.0 if limits == "loose" else 0.3) * rng.uniform(0.1, 1.0, (chain.nu, 2))
        )
        bounds = inside[:, None] + room * [-1.0, 1.0]
        if limits == "one without":
            bounds[rng.integers(chain.nu)] = -np.inf, np.inf
        finite = np.isfinite(bounds).all(axis=1)
        middle = np.where(finite, np.where(finite[:, None], bounds, 0.0).mean(axis=1), 0.0)
        peak = peak_of(x, Z, bounds)
        narrow = np.clip(bounds, -peak * (1 + 1e-11), peak * (1 + 1e-11))
        rules: tuple[tuple[Sharing, np.ndarray], ...] = (
            ("least_norm", nearest(x, Z, np.zeros(chain.nu), bounds)),
            ("mid_range", nearest(x, Z, middle, bounds)),
            ("least_peak", nearest(x, Z, np.zeros(chain.nu), narrow)),
        )
        for sharing, expected in rules:
            found = stp.inverse_dynamics(chain, *motion, effort_limit=bounds, sharing=sharing)
            size = np.abs(expected).max()
            np.testing.assert_allclose(found.tau_motor, expected, rtol=0, atol=1e-9 * size, err_msg=sharing)
            assert (found.tau_motor >= bounds[:, 0]).all() and (found.tau_motor <= bounds[:, 1]).all()
            assert found.residual < 1e-9 * size
            if sharing == "least_peak":
                assert np.abs(found.tau_motor).max() == pytest.approx(peak, rel=1e-9)


def test_one_line_of_efforts_in_closed_form() -> None:
    """Four cables, three freedoms: tension t0 + n s with s from the ends of each cable."""
    chain = crossed((2.0, 300.0))
    rest = np.zeros(chain.nv)
    x, Z = all_efforts(chain, chain.q_home, rest, rest)
    n = Z[:, 0] * np.sign(Z[0, 0])
    assert (n > 0).all()  # they pull against each other
    lowest = float(((2.0 - x) / n).max())
    found = stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=chain.limits)
    close(found.tau_motor, x + lowest * n, 1e-10)
    assert found.tau_motor.min() == 2.0
    middle = stp.inverse_dynamics(
        chain, chain.q_home, rest, rest, effort_limit=chain.limits, sharing="mid_range"
    ).tau_motor
    # Pott: f = f_m - A⁺ (w + A f_m), with the null vector: f = x + n n.(f_m - x).
    close(middle, x + n * (n @ (151.0 - x)), 1e-10)


def test_of_efforts_of_one_peak_the_least_are_taken() -> None:
    """A weight hangs on one cable; two others across may pull as hard without changing the peak."""
    chain = planar([(0, 1), (-1, 0), (1, 0)])
    rest = np.zeros(chain.nv)
    for limit, across in ((chain.limits, 0.0), ([[0, 100], [3, 100], [0, 100]], 3.0)):
        found = stp.inverse_dynamics(
            chain, chain.q_home, rest, rest, effort_limit=limit, sharing="least_peak"
        ).tau_motor
        np.testing.assert_allclose(found, [19.62, across, across], atol=1e-11)


def test_without_limits_the_peak_is_least_all_the_same(rng: np.random.Generator) -> None:
    chain = five_bar()
    q = random_configuration(chain, rng, 0.2)
    v, a = random_motion(chain, rng, q)
    x, Z = all_efforts(chain, q, v, a)
    found = stp.inverse_dynamics(chain, q, v, a, sharing="least_peak").tau_motor
    size = chain.tangent_scale[chain.motor_index]
    assert np.ptp(size) == 0  # all are angles
    assert np.abs(found).max() == pytest.approx(peak_of(x, Z, np.tile([-np.inf, np.inf], (3, 1))), rel=1e-9)
    assert np.abs(found).max() < np.abs(x).max()


@pytest.mark.parametrize("sharing", ["least_norm", "least_peak", "mid_range"])
def test_who_is_in_the_way_and_by_how_much(sharing) -> None:
    chain = boxed(efforts=(0.0, 60.0))
    rest = np.zeros(chain.nv)
    x, Z = all_efforts(chain, chain.q_home, rest, rest)
    one = np.ones((8, 1))
    answer = linprog(
        [0, 0, 1],
        A_ub=np.block([[Z, -one], [-Z, -one]]),
        b_ub=np.concatenate([60 - x, x]),
        bounds=(None, None),
    )
    with pytest.raises(EffortLimitError, match="limits are passed of 'winch2' by") as caught:
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=chain.limits, sharing=sharing)
    assert isinstance(caught.value, ConvergenceError)
    assert sorted(caught.value.violations) == ["winch2", "winch3", "winch6"]
    for value, least, most in caught.value.violations.values():
        assert (least, most) == (0, 60)
        assert max(value - most, least - value) == pytest.approx(answer.fun, rel=1e-9)


@pytest.mark.parametrize("sharing", ["least_norm", "least_peak", "mid_range"])
def test_motors_that_have_no_choice_are_judged(sharing) -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    plain = stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor
    limits = np.tile([0.0, 400.0], (6, 1))
    found = stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=limits, sharing=sharing)
    close(found.tau_motor, plain, 1e-10)
    limits[3] = 60.0, 400.0
    with pytest.raises(EffortLimitError, match=r"passed of 'leg4' by 10\.01 N \(at 49") as caught:
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=limits, sharing=sharing)
    assert caught.value.violations == {"leg4": (pytest.approx(plain[3]), 60.0, 400.0)}


def test_friction_and_wrenches_count(rng: np.random.Generator) -> None:
    chain = crossed()
    rubbing = stp.with_joint_physics(chain, {motor: {"friction": 1.5} for motor in chain.motors})
    rest, push = np.zeros(chain.nv), {"platform": [5.0, 8.0, 0, 0, 0, 0.3]}
    for sharing in ("least_norm", "least_peak", "mid_range"):
        given: dict[str, Any] = {"effort_limit": chain.limits, "sharing": sharing, "wrenches": push}
        plain = stp.inverse_dynamics(chain, chain.q_home, rest, rest, **given)
        held = stp.inverse_dynamics(rubbing, chain.q_home, rest, rest, **given)
        np.testing.assert_allclose(held.tau_motor, plain.tau_motor, atol=1e-9)
        assert plain.band is None and held.band is not None
        assert (held.band[:, 0] < held.tau_motor).all() and (held.band[:, 1] > held.tau_motor).all()
        # What wrenches ask for is what a motor would give: it moves nothing.
        assert (
            np.abs(stp.forward_dynamics(chain, chain.q_home, rest, plain.tau_motor, wrenches=push).a).max()
            < 1e-9
        )
        q, v, a = loaded(rubbing, rng)
        moved = stp.inverse_dynamics(rubbing, q, v, a, **{**given, "effort_limit": [[0, 500]] * 4})
        close(stp.forward_dynamics(rubbing, q, v, moved.tau_motor, wrenches=push).a, a, 1e-9)


def test_wrong_options() -> None:
    chain = crossed()
    rest = np.zeros(chain.nv)
    with pytest.raises(
        InputError, match="sharing must be one of least_norm, least_peak, mid_range, got 'fair'"
    ):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, sharing="fair")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="'mid_range' needs effort_limit"):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, sharing="mid_range")
    with pytest.raises(InputError, match="and so is sharing"):
        stp.inverse_dynamics(
            chain, chain.q_home, rest, rest, sharing="least_peak", method="constraint_matrix"
        )


# --- along motions -------------------------------------------------------------------------------------------


def swing(chain: stp.ClosedChain, samples: int = 30) -> stp.motions.PlatformSamples:
    return stp.motions.sinusoidal_motion(
        np.linspace(0, 1, samples),
        home=stp.platform_pose(chain, chain.q_home),
        amplitude=[0.3, 0.2, 0.2],
        frequency=[0.5, 0.5, 0.5],
    )


@pytest.mark.parametrize("sharing", ["least_norm", "least_peak", "mid_range"])
def test_a_motion_from_limits_to_limits_is_what_its_states_are(sharing) -> None:
    chain = boxed()
    samples = swing(chain)
    demand = stp.motor_demand(chain, samples, effort_limit=chain.limits, sharing=sharing)
    assert not demand.check()
    for k in range(0, len(samples), 7):
        state = stp.platform_motion(chain, samples.pose(k), samples.twist[k], samples.acceleration[k])
        alone = stp.inverse_dynamics(state, effort_limit=chain.limits, sharing=sharing).tau_motor
        np.testing.assert_allclose(demand.efforts[k], alone, rtol=0, atol=1e-9 * np.abs(alone).max())


@pytest.mark.slow
def test_kernels_and_sweeps_share_a_motion_alike() -> None:
    chain = boxed()
    samples = swing(chain, 100)
    for sharing in ("least_norm", "mid_range"):
        found = {
            kernels: stp.motor_demand(
                chain, samples, effort_limit=chain.limits, sharing=sharing, kernels=kernels
            )
            for kernels in (False, True)
        }
        assert (found[False].method, found[True].method) == ("one_state", "kernels")
        close(found[True].efforts, found[False].efforts, 1e-9)

    def longer(amplitude: float) -> stp.motions.PlatformSamples:
        home = stp.platform_pose(chain, chain.q_home)
        along = {"amplitude": [amplitude, 0, 0], "frequency": [1.5, 0, 0]}
        return stp.motions.sinusoidal_motion(np.linspace(0, 1, 40), home=home, **along)

    ways: tuple[tuple[Sharing | None, bool | None], ...] = (
        ("least_norm", True),
        ("least_peak", None),
        (None, None),
    )
    swept = {
        sharing: stp.sweep_demand(
            chain, longer, {"amplitude": [0.1, 0.3, 1.3]}, sharing=sharing, kernels=kernels
        )
        for sharing, kernels in ways
    }
    assert np.isnan(swept["least_norm"]["peak_effort"][2]).all()
    assert np.isfinite(swept[None]["peak_effort"]).all()
    low, peak = (swept[name]["peak_effort"][:2].max(axis=-1) for name in ("least_norm", "least_peak"))
    assert (peak <= low * (1 + 1e-9)).all()
    one = stp.motor_demand(chain, longer(0.3), effort_limit=chain.limits, sharing="least_peak")
    np.testing.assert_array_equal(swept["least_peak"]["peak_effort"][1], one.efforts.max(axis=0))
    with pytest.raises(UnsupportedError, match="kernels know of no least peak"):
        stp.motor_demand(chain, samples, sharing="least_peak", kernels=True)
    with pytest.raises(InputError, match="sharing must be one of"):
        stp.sweep_demand(chain, longer, {"amplitude": [0.1]}, sharing="fair")  # pyright: ignore[reportArgumentType]


def test_a_motion_beyond_the_limits_tells_the_instant() -> None:
    chain = boxed(efforts=(1.0, 210.0))
    with pytest.raises(EffortLimitError, match=r"at 0 s, instant 0: no efforts within effort_limit"):
        stp.motor_demand(chain, swing(chain), effort_limit=chain.limits)
