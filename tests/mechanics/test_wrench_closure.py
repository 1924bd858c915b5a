"""Wrench closure and feasibility: against convex hulls, null vectors, and linear programmes by HiGHS."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import Delaunay

import stewart_pin as stp
from stewart_pin.errors import ActuationError, InputError
from tests.cable_robots import cables_4, cables_8
from tests.closed_states import robot
from tests.mechanics.test_sharing import crossed
from tests.pulled import boxed, planar

closure, feasible = stp.polytopes.wrench_closure, stp.polytopes.wrench_feasible


def exerts(chain: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
    """Wrenches of unit efforts (6, nu), from the motor Jacobian: virtual work."""
    return stp.motor_jacobian(chain, q).T


@pytest.mark.parametrize(
    "anchors", [[(-1, -1), (1, -1), (0, 1)], [(-1, -0.7), (1, -0.7), (1.1, 0.8), (-1, 0.8)]]
)
def test_a_point_on_cables_has_closure_within_their_hull(anchors, rng: np.random.Generator) -> None:
    hull = Delaunay(np.array(anchors))
    inside = 0
    for place in rng.uniform(-1.3, 1.3, (20, 2)):
        chain = planar(anchors, at_rest=(*place, 0.0))
        found = closure(chain, chain.q_home)
        assert found.holds == bool(hull.find_simplex(place) >= 0)
        inside += found.holds
        if found.holds:
            assert found.wrench is None and 0 < found.margin <= 1
            assert np.abs(exerts(chain, chain.q_home)[:2] @ found.tension).max() < 1e-12
            assert (found.tension > 0).all()
        else:
            assert found.margin == 0 and found.wrench is not None
            # All that cables exert does not push against it.
            assert (found.wrench @ exerts(chain, chain.q_home) >= -1e-9).all()
    assert 3 < inside < 17


def test_a_point_on_the_edge_has_none_and_beside_it_a_small_margin() -> None:
    anchors = [(-1, -1), (1, -1), (0, 1)]
    on, beside = (planar(anchors, at_rest=(0.1, y, 0)) for y in (-1.0, -1.0 + 1e-6))
    found = closure(on, on.q_home)
    assert not found.holds and found.wrench is not None
    np.testing.assert_allclose(found.wrench, [0, 1, 0, 0, 0, 0], atol=1e-9)
    assert closure(beside, beside.q_home).holds
    assert 1e-7 < closure(beside, beside.q_home).margin < 1e-5


def test_two_cables_on_a_line_hold_the_line_alone() -> None:
    chain = planar([(-1, 0), (1, 0)], at_rest=(0.2, 0.0, 0.0))
    found = closure(chain, chain.q_home)
    assert not found.holds and found.wrench is not None
    np.testing.assert_allclose(np.abs(found.wrench), [0, 1, 0, 0, 0, 0], atol=1e-9)


def test_one_more_cable_than_freedoms_by_its_null_vector() -> None:
    for turn in (0.1, 0.9, 1.5):
        chain = planar(
            [(-1.0, -0.8), (1.0, -0.9), (1.1, 1.0), (-0.9, 0.8)],
            [(0.2, -0.1), (-0.2, -0.1), (-0.2, 0.1), (0.2, 0.1)],
            at_rest=(0.1, 0.05, turn),
        )
        found = closure(chain, chain.q_home)
        null = np.linalg.svd(exerts(chain, chain.q_home)[[0, 1, 5]])[2][-1]
        assert found.holds == bool((null > 0).all() or (null < 0).all())
        if found.holds:
            assert found.margin == pytest.approx(np.abs(null).min() / np.abs(null).max(), rel=1e-9)
            np.testing.assert_allclose(
                found.tension / found.tension.max(), np.abs(null) / np.abs(null).max(), rtol=1e-9
            )


def test_eight_cables_and_fewer(rng: np.random.Generator) -> None:
    chain = boxed()
    found = closure(chain, chain.q_home)
    A = exerts(chain, chain.q_home)
    assert found.holds and (found.tension > 0).all()
    assert np.abs(A @ found.tension).max() < 1e-12
    sample = rng.normal(size=(20, 6))
    assert all(linprog(np.ones(8), A_eq=A, b_eq=w, method="highs-ds").status == 0 for w in sample)
    one_less = boxed(7)
    found = closure(one_less, one_less.q_home)
    A = exerts(one_less, one_less.q_home)
    assert not found.holds and found.wrench is not None
    # HiGHS finds no efforts for a load along the named wrench.
    assert linprog(np.ones(7), A_eq=A, b_eq=-found.wrench, method="highs-ds").status == 2


def test_motors_of_both_signs_count_twice() -> None:
    chain = boxed(7)
    both = stp.with_limits(chain, {motor: {"effort": (-10, 10)} for motor in chain.motors})
    found = closure(both, chain.q_home)
    assert found.holds and found.margin == np.inf
    # One that pushes as well stands for two cables; pushing ones are pulling ones turned round.
    some = stp.with_limits(chain, {"winch0": {"effort": (-10, 10)}})
    pushing = stp.with_limits(chain, {motor: {"effort": (-500, -1)} for motor in chain.motors})
    expected = {
        k: all(
            linprog(
                np.zeros(7), A_eq=exerts(chain, chain.q_home), b_eq=w, method="highs-ds",
                bounds=[(-np.inf if j < k else 0, None) for j in range(7)],
            ).status == 0
            for w in np.vstack([np.eye(6), -np.eye(6)])
        )
        for k in (0, 1)
    }  # fmt: skip
    assert closure(some, chain.q_home).holds == expected[1]
    assert closure(pushing, chain.q_home).holds == expected[0]
    assert not closure(
        stp.with_limits(robot("stewart"), {"leg1": {"effort": (0, 9)}}), robot("stewart").q_home
    ).holds


# --- sets of wrenches ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("build", [boxed, crossed], ids=["eight", "four in a plane"])
def test_margins_are_those_of_a_linear_programme(build, rng: np.random.Generator) -> None:
    chain = build()
    q = chain.q_home
    corners = stp.polytopes.wrench_box([-5, -5, -5, -0.5, -0.5, -0.5], [5, 6, 5, 0.5, 0.5, 0.5])
    assert corners.shape == (64, 6)
    found = feasible(chain, q, wrenches=corners)
    A = exerts(chain, q)
    rows = [0, 1, 5] if chain.nu == 4 else list(range(6))
    n = chain.nu
    low, high = chain.limits.bounds("effort", chain.motor_index).T
    weight = np.zeros(6)
    mass = chain.model.inertias[-1] if chain.nu == 4 else None
    rest = np.zeros(chain.nv)
    weight = A @ stp.inverse_dynamics(chain, q, rest, rest).tau_motor
    assert mass is not None or weight[2] == pytest.approx(98.1)
    one = np.ones((n, 1))
    for k in rng.integers(64, size=8):
        best = linprog(
            [*np.zeros(n), -1], A_ub=np.block([[-np.eye(n), one], [np.eye(n), one]]), b_ub=np.r_[-low, high],
            A_eq=np.c_[A[rows], np.zeros(len(rows))], b_eq=(weight - corners[k])[rows],
            bounds=(None, None), method="highs-ds",
        )  # fmt: skip
        assert found.margins[k] == pytest.approx(-best.fun, rel=1e-9, abs=1e-9)
    assert found.margin == found.margins.min() and found.holds == (found.margin >= 0)
    np.testing.assert_array_equal(found.wrench, corners[found.margins.argmin()])
    np.testing.assert_allclose((A @ found.efforts)[rows], (weight - found.wrench)[rows], atol=1e-9)
    room = np.minimum(found.efforts - low, high - found.efforts)
    assert room.min() == pytest.approx(found.margin, abs=1e-9)
    np.testing.assert_allclose([room[chain.motors.index(m)] for m in found.motors], found.margin, atol=1e-6)


def test_the_margin_is_where_the_shared_efforts_end() -> None:
    """What is feasible is shared, what is not is refused: by the margin to both sides."""
    chain = crossed()
    rest = np.zeros(chain.nv)
    low, high = chain.limits.bounds("effort", chain.motor_index).T
    margin = feasible(chain, chain.q_home, wrenches=np.zeros(6)).margin
    for share in (1 - 1e-6, 1 + 1e-6):
        limits = np.c_[low + share * margin, high - share * margin]
        if share < 1:
            stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=limits)
            continue
        with pytest.raises(stp.errors.EffortLimitError):
            stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=limits)
        assert feasible(chain, chain.q_home, wrenches=np.zeros(6), effort_limit=limits).margin < 0


def test_along_a_path_the_worst_state_is_named() -> None:
    chain = planar([(-1, -0.7), (1, -0.7), (1, 0.8), (-1, 0.8)], efforts=(1.0, 200.0))
    states = [
        stp.platform_motion(chain, [x, 0.1, 0, 0, 0, 0, 1], np.zeros(6), np.zeros(6))
        for x in (-0.5, 0.0, 0.5, 0.97)
    ]
    found = stp.polytopes.wrench_path(states, wrenches=[[0, -20, 0, 0, 0, 0], [0, 20, 0, 0, 0, 0]])
    assert found.holds and found.worst == 3 and found.detail is not None and found.feasible is not None
    assert found.detail.margin == found.feasible.min() > 0
    assert (np.diff(found.closure[1:]) < 0).all()
    alone = stp.polytopes.wrench_path(states)
    assert alone.feasible is None and alone.detail is None and alone.worst == 3
    np.testing.assert_array_equal(alone.closure, found.closure)
    assert len(repr(found)) < 600


def test_as_many_motors_as_freedoms_are_judged() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    tau = stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor
    found = feasible(chain, chain.q_home, wrenches=np.zeros(6), effort_limit=60.0)
    assert found.margin == pytest.approx(60 - tau.max(), rel=1e-9)
    assert feasible(chain, chain.q_home, wrenches=np.zeros(6), effort_limit=np.inf).margin == np.inf


def test_wrong_arguments() -> None:
    chain = crossed()
    with pytest.raises(InputError, match="least must nowhere be above most"):
        stp.polytopes.wrench_box(np.ones(6), np.zeros(6))
    with pytest.raises(InputError, match="wrenches must have shape"):
        feasible(chain, chain.q_home, wrenches=np.zeros((2, 3)))
    with pytest.raises(InputError, match="wrenches must hold a wrench"):
        feasible(chain, chain.q_home, wrenches=np.zeros((0, 6)))
    with pytest.raises(InputError, match="states must hold a state"):
        stp.polytopes.wrench_path([])
    line = planar([(-1, 0), (1, 0)], at_rest=(0.2, 0.0, 0.0))
    with pytest.raises(ActuationError):
        feasible(line, line.q_home, wrenches=np.zeros(6))


@pytest.mark.parametrize("build", [lambda: boxed(efforts=(5.0, 300.0)), lambda: crossed((5.0, 60.0))])
def test_wrenches_of_cables_that_never_go_slack_are_those_of_a_linear_programme(build, rng) -> None:
    """A polytope around a least tension above zero: in any direction its support is a maximum by HiGHS."""
    chain = build()
    found = stp.polytopes.wrench_polytope(chain, chain.q_home, gravity=True)
    A = exerts(chain, chain.q_home)[
        [["fx", "fy", "fz", "mx", "my", "mz"].index(name) for name in found.names]
    ]
    rest = np.zeros(chain.nv)
    weight = A @ stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor
    ends = chain.limits.bounds("effort", chain.motor_index)
    for direction in rng.normal(size=(5, len(A))):
        best = linprog(-direction @ A, bounds=ends.tolist(), method="highs-ds")
        expected = -best.fun - direction @ weight
        assert stp.polytopes.polytope_support(found, direction) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("build", [cables_4, cables_8])
def test_robots_on_cables_have_closure_and_carry_their_weight(build) -> None:
    chain = build()
    found = closure(chain, chain.q_home)
    assert found.holds and (found.tension > 0).all()
    A = exerts(chain, chain.q_home)
    assert np.abs(A @ found.tension).max() < 1e-9
    rest = np.zeros(chain.nv)
    held = feasible(chain, chain.q_home, wrenches=np.zeros(6))
    low, high = chain.limits.bounds("effort", chain.motor_index).T
    assert 0 < held.margin < (high - low).max() / 2
    tensions = stp.inverse_dynamics(chain, chain.q_home, rest, rest, effort_limit=chain.limits).tau_motor
    assert (tensions >= low).all() and (tensions <= high).all()
    np.testing.assert_allclose(A @ tensions, A @ held.efforts, atol=1e-8 * np.abs(tensions).max())
