"""Speeds and loads of six-legged platforms against the report's figures S0.5 and S0.8, and another solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

import stewart_pin as stp
from stewart_pin.errors import ConvergenceError, InputError, SingularityError
from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.mechanics.capability import enumeration
from stewart_pin.mechanics.capability.enumeration import greatest, interior_point, maximise

LEVEL = np.eye(3)
# S0.5: the pose of the report, and one that its stroke of 0.5 m reaches.
REPORT, REACHABLE = [0.0, 0.0, 0.8], [0.0, 0.0, 2.4]


def test_speeds_of_the_report(report_cad: stp.Hexapod) -> None:
    free = stp.velocity_limits(report_cad, REPORT, LEVEL, rate_limit=0.5)
    zero = stp.velocity_limits(report_cad, REPORT, LEVEL, rate_limit=0.5, others="zero")
    # Five printed digits.
    np.testing.assert_allclose(free, [1.27268, 1.39477, 0.54273], atol=0.5e-5)
    np.testing.assert_allclose(zero, [1.20454, 1.24080, 0.54255], atol=0.5e-5)


def test_speeds_of_the_report_s_wrong_matrix(report_cad: stp.Hexapod) -> None:
    # S0.5 prints inequalities whose y entries all have one sign, and 0.3851 for 0.3581.
    wrong = np.round(stp.leg_jacobian(report_cad, REPORT, LEVEL)[:, :3], 4)
    wrong[:, 1] = np.abs(wrong[:, 1])
    wrong[2, 1] = 0.3851
    np.testing.assert_allclose(
        stp.limits.velocity_limits_of_jacobian(wrong, rate_limit=0.5), [1.2727, 2.9060, 0.7629], atol=0.6e-4
    )
    # A whole column of the other sign mirrors the set, and changes nothing.
    mirrored = stp.leg_jacobian(report_cad, REPORT, LEVEL)[:, :3] * [1, -1, 1]
    np.testing.assert_allclose(
        stp.limits.velocity_limits_of_jacobian(mirrored, rate_limit=0.5),
        stp.velocity_limits(report_cad, REPORT, LEVEL, rate_limit=0.5), rtol=1e-12,
    )  # fmt: skip


def test_speeds_within_reach_of_the_stroke(report_cad: stp.Hexapod) -> None:
    lengths = stp.leg_lengths(report_cad, REACHABLE, LEVEL)
    assert lengths.min() > 2.20147 and lengths.max() < 2.70147
    free = stp.velocity_limits(report_cad, REACHABLE, LEVEL, rate_limit=0.5)
    # Recomputed with another solver; long steep legs: fast sideways, slow upwards.
    np.testing.assert_allclose(free, [3.83536, 4.18491, 0.50414], atol=0.5e-5)


def test_loads_of_the_report(report_ideal: stp.Hexapod) -> None:
    assert stp.load_limit(report_ideal, REPORT, LEVEL, force_limit=1e4) == pytest.approx(55_518.233, abs=1e-3)
    aside = [1.0, 1.0, 1.0]
    assert stp.load_limit(report_ideal, aside, LEVEL, force_limit=1e4) == pytest.approx(4_184.660, abs=1e-3)
    # S0.8 prints 4580.9 N: leg 6 was left out.
    limit = [1e4] * 5 + [1e12]
    assert stp.load_limit(report_ideal, aside, LEVEL, force_limit=limit) == pytest.approx(4_580.9, abs=0.05)


def test_load_is_what_the_first_leg_to_give_in_allows(report_ideal: stp.Hexapod, rng) -> None:
    position, rotation = [0.1, -0.05, 0.9], rotation_from_rpy(0.1, -0.2, 0.15)
    limit = rng.uniform(1e3, 1e4, 6)
    direction = rng.standard_normal(3)
    load = stp.load_limit(report_ideal, position, rotation, force_limit=limit, direction=direction)
    # Independent: maximise the force over leg forces within limits, in balance.
    jacobian = stp.leg_jacobian(report_ideal, position, rotation)
    unit = np.append(direction / np.linalg.norm(direction), np.zeros(3))
    best = linprog(
        [-1, 0, 0, 0, 0, 0, 0], A_eq=np.c_[-unit, jacobian.T], b_eq=np.zeros(6),
        bounds=[(None, None), *zip(-limit, limit, strict=True)],
    )  # fmt: skip
    assert load == pytest.approx(-best.fun, rel=1e-9)


@pytest.fixture
def proxqp_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forbid the second solver, which would hide that the first one fails."""

    def unused(*_: np.ndarray) -> np.ndarray:
        raise AssertionError("ProxQP was given up")

    monkeypatch.setattr(enumeration, "greatest", unused)


@pytest.mark.usefixtures("proxqp_alone")
@pytest.mark.parametrize("others", ["free", "zero"])
def test_speeds_equal_those_of_another_solver(report_ideal: stp.Hexapod, others: str, rng) -> None:
    for _ in range(30):
        position = [0, 0, 1] + rng.uniform(-0.2, 0.2, 3)
        rotation = rotation_from_rpy(*rng.uniform(-0.3, 0.3, 3))
        limit = rng.uniform(0.1, 2.0, 6)
        found = stp.velocity_limits(report_ideal, position, rotation, rate_limit=limit, others=others)
        rows = stp.leg_jacobian(report_ideal, position, rotation)[:, :3]
        for k in range(3):
            bounds = [(None, None) if others == "free" or j == k else (0, 0) for j in range(3)]
            best = linprog(
                -np.eye(3)[k], A_ub=np.vstack([rows, -rows]), b_ub=np.tile(limit, 2), bounds=bounds
            )
            assert found[k] == pytest.approx(-best.fun, rel=1e-10)


@pytest.mark.usefixtures("proxqp_alone")
def test_linear_programmes_of_any_size(rng) -> None:
    for _ in range(200):
        n = int(rng.integers(1, 8))
        m = int(rng.integers(n, 25))
        # Sizes from microns to kilometres.
        size = 10.0 ** rng.uniform(-6, 3)
        rows, cost, upper = rng.standard_normal((m, n)), rng.standard_normal(n), size * rng.uniform(0.1, 2, m)
        best = linprog(
            -cost, A_ub=np.vstack([rows, -rows]), b_ub=np.tile(upper, 2) / size, bounds=(None, None)
        )
        assert cost @ maximise(cost, rows, -upper, upper) == pytest.approx(-best.fun * size, rel=1e-9)


def test_linear_programmes_without_answer_are_errors() -> None:
    with pytest.raises(ConvergenceError, match="was not solved"):
        maximise(np.array([1.0]), np.array([[1.0], [1.0]]), np.array([1.0, -3.0]), np.array([2.0, -2.0]))
    with pytest.raises(ConvergenceError, match="was not solved"):
        greatest(np.array([1.0, 0.0]), np.array([[0.0, 1.0]]), np.array([1.0]))


def test_inner_ball_is_found_flat_or_empty() -> None:
    square = np.vstack([np.eye(2), -np.eye(2)])
    none = np.full(4, -np.inf)
    for upper, radius in (([2.0, 1, 0, 1], 1.0), ([1.0, 0, 1, 0], 0.0), ([-1.0, 1, 0, 1], -0.5)):
        assert interior_point(square, none, np.array(upper))[1] == pytest.approx(radius, abs=1e-12)


def test_singular_pose_is_refused(report_ideal: stp.Hexapod) -> None:
    yaw = rotation_from_rpy(0, 0, np.pi / 2)
    with pytest.raises(SingularityError, match="smallest singular value"):
        stp.velocity_limits(report_ideal, [0, 0, 1.0], yaw, rate_limit=0.5)
    with pytest.raises(SingularityError, match="smallest singular value"):
        stp.load_limit(report_ideal, [0, 0, 1.0], yaw, force_limit=1e4)
    with pytest.raises(SingularityError, match="some velocity has no bound"):
        stp.limits.velocity_limits_of_jacobian(np.ones((2, 3)), rate_limit=0.5)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda h: stp.velocity_limits(h, REPORT, LEVEL, rate_limit=0.0), "rate_limit must be finite and above"),
        (lambda h: stp.velocity_limits(h, REPORT, LEVEL, rate_limit=-1.0), "rate_limit must be finite and above"),
        (lambda h: stp.velocity_limits(h, REPORT, LEVEL, rate_limit=np.inf), "rate_limit must be finite"),
        (lambda h: stp.velocity_limits(h, REPORT, LEVEL, rate_limit="fast"), "rate_limit must be one number"),
        (lambda h: stp.velocity_limits(h, REPORT, LEVEL, rate_limit=np.ones(5)), r"array of shape \(6,\)"),
        (lambda h: stp.velocity_limits(h, REPORT, LEVEL, rate_limit=1.0, others="none"), "others must be"),
        (lambda h: stp.velocity_limits(h, [0, 0], LEVEL, rate_limit=1.0), "position must have shape"),
        (lambda h: stp.velocity_limits(h, REPORT, 2 * LEVEL, rate_limit=1.0), "rotation must hold rotation"),
        (lambda h: stp.velocity_limits(h, REPORT, np.stack([LEVEL] * 2), rate_limit=1.0), "rotation must have"),
        (lambda h: stp.load_limit(h, REPORT, LEVEL, force_limit=np.nan), "force_limit must be finite"),
        (lambda h: stp.load_limit(h, REPORT, LEVEL, force_limit=1.0, direction=[0, 0, 0]), "must not be zero"),
        (lambda h: stp.limits.velocity_limits_of_jacobian(np.ones(3), rate_limit=1.0), "jacobian must have shape"),
    ],
)  # fmt: skip
def test_bad_input_is_named(report_cad: stp.Hexapod, call, words) -> None:
    with pytest.raises(InputError, match=words):
        call(report_cad)


def test_the_load_of_legs_of_one_side_is_that_of_a_linear_programme(rng: np.random.Generator) -> None:
    """Max s, s d exerted by forces within limits: least ones above zero, and legs that only push."""
    hexapod = stp.Hexapod.from_chain(stp.load("stewart"))
    place, turn = np.array([0.05, 0.02, 1.0]), rotation_from_rpy(0.05, 0.1, 0.02)
    A = stp.leg_jacobian(hexapod, place, turn).T
    outcomes = set()
    for _ in range(40):
        direction = rng.normal(size=3) * [0.3, 0.3, 1.0]
        wrench = np.concatenate([direction / np.linalg.norm(direction), np.zeros(3)])
        limits = np.sort(rng.uniform(-1, 3, (6, 2)) * [100, 1000], axis=1)
        best = linprog(
            [-1, *np.zeros(6)], A_eq=np.c_[-wrench, A], b_eq=np.zeros(6), method="highs-ds",
            bounds=[(None, None), *limits],
        )  # fmt: skip
        outcomes.add(best.status)
        if best.status == 2:
            with pytest.raises(InputError, match="no force in this direction keeps force_limit"):
                stp.load_limit(hexapod, place, turn, force_limit=limits, direction=direction)
            continue
        found = stp.load_limit(hexapod, place, turn, force_limit=limits, direction=direction)
        assert found == pytest.approx(-best.fun, rel=1e-9, abs=1e-6)
    assert outcomes == {0, 2}
    only_push = stp.load_limit(hexapod, place, turn, force_limit=[[0, 400]] * 6)
    assert only_push == stp.load_limit(hexapod, place, turn, force_limit=400.0)
    assert stp.load_limit(hexapod, place, turn, force_limit=[[0, 400]] * 6, direction=[0, 0, -1]) == 0
    with pytest.raises(InputError, match="least force first"):
        stp.load_limit(hexapod, place, turn, force_limit=[[4, 0]] * 6)
