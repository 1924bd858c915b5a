"""Newton's steps among the kernels: their order, what they call closed, and where they must not."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.graph.newton_steps import (
    NewtonEquations,
    any_direction,
    damped_step,
    double_step,
    stretch_step,
)
from stewart_pin.kernels.graph.platform_dynamics import place_platform
from stewart_pin.kernels.graph.platform_kinematics import pose_equations
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.kernels.verbs.newton import NewtonSteps, Plans, Solved, solve_on_branch, straight
from stewart_pin.programs.array_kernel import compile_function
from stewart_pin.programs.status import StateStatus
from stewart_pin.tolerances import CLOSED
from tests.closed_states import robot
from tests.kernels.hexapod_graph import sample_states
from tests.kernels.test_compile import kernels


def square_roots() -> NewtonEquations:
    """x² = target, as the plainest equations with a double root at zero."""
    x, target = ca.SX.sym("x"), ca.SX.sym("target")
    gap = target - x * x
    return NewtonEquations(
        x, target, gap, gap, lambda g: g / (2 * x), lambda x, step: x + step, np.ones(1), x, np.ones(1)
    )


def newton(equations: NewtonEquations) -> NewtonSteps:
    return NewtonSteps(
        compile_function(double_step("double", equations)),
        cache(lambda: compile_function(damped_step("damped", equations))),
        cache(lambda: compile_function(stretch_step("stretch", equations))),
    )


def solve(
    equations: NewtonEquations, met: Callable[[np.ndarray], np.ndarray], start: np.ndarray, target: np.ndarray
) -> Solved:
    """Solve from states that meet other targets."""
    steps = newton(equations)
    return solve_on_branch(
        Plans(lambda: [steps]), start, lambda rows: (start[rows], met(start[rows])), target, straight
    )


def test_a_double_step_is_newton_and_a_chord() -> None:
    x, target = np.array([[1.5]]), np.array([[2.0]])
    middle = x + (target - x**2) / (2 * x)
    end = middle + (target - middle**2) / (2 * x)
    after, gap, largest = newton(square_roots()).double(x, target, np.zeros(1))
    np.testing.assert_allclose(after, end, rtol=1e-15)
    # The contraction, or what so long a first move counts as.
    expected = max((end - middle)[0, 0] / (middle - x)[0, 0], abs(middle - x)[0, 0] / 2.4)
    np.testing.assert_allclose(largest[0, 0], expected, rtol=1e-4)
    np.testing.assert_allclose(gap, middle**2 - target, rtol=1e-12)  # still too large to foretell anything


def test_double_steps_converge_with_order_three() -> None:
    double = newton(square_roots()).double
    offsets = np.array([[1e-2], [1e-3]])
    after = double(1 + offsets, np.ones((2, 1)), np.zeros(1))[0] - 1.0
    # Newton alone would leave offset² / 2.
    np.testing.assert_allclose(
        after / offsets**3, 0.5, rtol=0.03
    )  # and a share of the fourth power, 2.2 offset


def test_what_is_called_closed_is_closed() -> None:
    # From tiny targets, nearly a double root, to ordinary ones; starts from near to far.
    target = np.logspace(-12, 0, 200)[:, None]
    for start in (1e-3, 0.5, 30.0):
        solved = solve(square_roots(), np.square, np.full((200, 1), start), target)
        assert solved.closed.all()
        assert np.abs(solved.states**2 - target).max() < 1e-11


def test_no_root_is_not_called_closed() -> None:
    solved = solve(square_roots(), np.square, np.ones((2, 1)), np.array([[-1e-6], [4.0]]))
    assert solved.closed.tolist() == [False, True]


def arctangents() -> NewtonEquations:
    """Solve atan x = target, where full steps run away from |x| > 1.4, and no target beyond π / 2 is in reach."""
    x, target = ca.SX.sym("x"), ca.SX.sym("target")
    gap = target - ca.atan(x)
    close = lambda g: g * (1 + x * x)  # noqa: E731
    return NewtonEquations(
        x, target, gap, gap, close, lambda x, step: x + step, np.ones(1), ca.SX(1), np.ones(1)
    )


def test_a_trial_is_accepted_or_made_shorter() -> None:
    damped = newton(arctangents()).damped()
    best, old, target = 3.0, -12.0, 0.1
    trials = np.array([[-9.0], [1.0], [-9.0], [np.nan]])
    shares = np.array([[1.0], [0.25], [1e-4], [1.0]])
    least = 1.2
    search = np.hstack([np.full((4, 1), best), trials, np.full((4, 1), old), np.full((4, 1), least), shares])
    after, gap = damped(search, np.full((4, 1), target))
    step = (target - np.arctan(1.0)) * 2
    # The second trial lowers the gap; the third search has become too short to go on.
    expected = [
        [best, best + 0.25 * old, old, least, 0.25],
        [1.0, 1.0 + step, step, np.arctan(1.0) - target, 1.0],
        [best, best + 0.25e-4 * old, old, least, 0.25e-4],
    ]
    np.testing.assert_allclose(after[:3], expected, rtol=1e-14)
    np.testing.assert_allclose(gap[:3, 0], [least, np.arctan(1.0) - target, 0.0], rtol=1e-14)
    assert np.isnan(after[3]).all()


def damped_by_hand(x: float, target: float) -> float | None:
    """Solve the same, with a loop and branches."""
    trial, step, least, share = x, 0.0, np.inf, 1.0
    for _ in range(61):
        size = abs(target - np.arctan(trial))
        if size < least:
            x, least, share = trial, size, 1.0
            step = (target - np.arctan(x)) * (1 + x * x)
        elif share <= 1e-4:
            return None
        else:
            share /= 4
        trial = x + share * step
        if least <= 1e-11:
            return trial
    return None


def test_damped_steps_reach_what_full_ones_run_away_from() -> None:
    start = np.repeat([1.0, 3.0, 30.0, 300.0], 50)[:, None]
    target = np.tile(np.linspace(-2.0, 2.0, 50), 4)[:, None]
    solved = solve(arctangents(), np.arctan, start, target)
    by_hand = [damped_by_hand(x, t) for x, t in zip(start[:, 0], target[:, 0], strict=True)]
    expected = np.array([np.nan if x is None else x for x in by_hand])
    assert 100 < np.isfinite(expected).sum() < 180
    # Full steps, which come first, reach some more that lie near.
    assert solved.closed[np.isfinite(expected)].all()
    assert not solved.closed[np.abs(target[:, 0]) > np.pi / 2].any()
    both = np.isfinite(expected)
    np.testing.assert_allclose(solved.states[both, 0], expected[both], rtol=1e-10, atol=1e-10)


def test_a_gap_that_is_partly_no_number_is_not_closed() -> None:
    x, target = ca.SX.sym("x"), ca.SX.sym("target")
    gap = target - x
    size = ca.vertcat(gap, ca.sqrt(x - 2))  # no number below 2, zero at 2
    equations = NewtonEquations(
        x, target, gap, size, lambda g: g, lambda x, step: x + step, np.ones(1), ca.SX(1), np.ones(1)
    )
    solved = solve(equations, np.positive, np.array([[2.5], [2.5]]), np.array([[1.0], [2.0]]))
    assert solved.closed.tolist() == [False, True]


def test_a_branch_is_kept_or_said_to_be_lost() -> None:
    """Of x³ - 3 x = target, on the branch beyond the fold at x = 1, where the target is -2."""
    x, target = ca.SX.sym("x"), ca.SX.sym("target")
    gap = target - (x * x * x - 3 * x)
    close = lambda g: g / (3 * x * x - 3)  # noqa: E731
    equations = NewtonEquations(
        x, target, gap, gap, close, lambda x, step: x + step, np.ones(1), x * x - 1, np.ones(1)
    )
    wanted = np.linspace(-4.0, 40.0, 400)[:, None]
    solved = solve(equations, lambda x: x**3 - 3 * x, np.full((400, 1), 1.1), wanted)
    roots = np.array([np.real(np.roots([1, 0, -3, -t])).max() for t in wanted[:, 0]])
    beyond = wanted[:, 0] > -2
    np.testing.assert_array_equal(solved.kept, beyond)
    np.testing.assert_allclose(solved.states[beyond, 0], roots[beyond], rtol=1e-9)
    # Another root, beyond the fold, is found by damped steps, and not taken for one of this branch.
    assert solved.closed[~beyond].any()


def test_two_singularities_at_once_end_a_branch() -> None:
    """Of x z = y z = 0, z = target: at z = 0 x and y are both free, and the determinant z² keeps its sign."""
    state, target = ca.SX.sym("state", 3), ca.SX.sym("target")
    x, y, z = ca.vertsplit(state)
    gap = ca.vertcat(-x * z, -y * z, target - z)
    close = lambda g: ca.vertcat((g[0] - x * g[2]) / z, (g[1] - y * g[2]) / z, g[2])  # noqa: E731
    sizes = np.ones(3)
    equations = NewtonEquations(
        state, target, gap, gap, close, lambda x, step: x + step, sizes, z * z, any_direction(sizes)
    )
    wanted = np.array([[0.2], [0.01], [-0.01], [-0.3], [-1.0], [-7.0], [5.0]])
    solved = solve(equations, lambda q: q[:, 2:], np.tile([0.0, 0.0, 1.0], (len(wanted), 1)), wanted)
    np.testing.assert_array_equal(solved.kept, wanted[:, 0] > 0)


def test_motors_that_turn_count_modulo_a_turn() -> None:
    chain = robot("delta")
    equations = pose_equations(place_platform(plan_platform(chain)))
    gap = ca.Function("gap", [equations.state, equations.target], [equations.gap])
    home = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    for off, short in ((1e-6, 1e-6), (-0.3, -2 * np.sin(0.15)), (2 * np.pi + 0.3, 2 * np.sin(0.15))):
        found = np.array(gap(home, stp.motor_positions(chain, chain.q_home) + off)).ravel()
        np.testing.assert_allclose(found, short, rtol=1e-9)
    # Half a turn is as far as a motor can be off, and not to be taken for none.
    for off in (np.pi, np.pi - 1e-8, np.pi + 1e-8):
        found = np.array(gap(home, stp.motor_positions(chain, chain.q_home) + off)).ravel()
        np.testing.assert_allclose(np.abs(found), 2.0, rtol=1e-12)


@pytest.mark.parametrize("name", ["stewart", "delta", "hexapod_rss", "rpr_planar"])
def test_poses_that_come_out_meet_the_motors(name: str, rng: np.random.Generator) -> None:
    """Far guesses, some of them across singularities: whatever pose is given fits, to round-off."""
    chain = robot(name)
    if name == "stewart":
        pose, _, _ = sample_states(rng, 400)
        guess = np.roll(pose, 1, axis=0) + 0.3 * rng.uniform(-1, 1, (400, 1)) * np.eye(7)[:1]
    else:
        home = np.array([[*stp.platform_pose(chain, chain.q_home).translation, 0, 0, 0, 1]])
        pose = home + rng.uniform(-0.1, 0.1, (400, 1)) * chain.length_scale * np.eye(7)[:1]
        guess = home + rng.uniform(-0.3, 0.3, (400, 1)) * chain.length_scale * np.eye(7)[:1]
    q_motor = kernels(name).inverse_kinematics(pose)
    pose, q_motor = pose[np.isfinite(q_motor).all(axis=1)], q_motor[np.isfinite(q_motor).all(axis=1)]
    status = np.empty(len(pose), dtype=np.int8)
    found = kernels(name).forward_kinematics(q_motor, guess[: len(pose)], status=status)
    good = status == StateStatus.OK
    assert good.mean() > 0.5
    np.testing.assert_array_equal(good, np.isfinite(found).all(axis=1))
    off = kernels(name).inverse_kinematics(found[good]) - q_motor[good]
    # Of motor sizes: what counts as closed.
    assert np.abs(off / chain.tangent_scale[list(chain.motor_index)]).max() < CLOSED
