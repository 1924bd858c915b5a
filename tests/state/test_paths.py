"""Paths to a demand keep the branch of their beginning, of few freedoms and with rows that repeat each other too."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ClosureError
from stewart_pin.state.newton import displaced
from stewart_pin.state.paths import pose_path
from tests.closed_states import robot
from tests.zoo.table import zoo_chain

STEPS = 300
"""Small steps of the continuation that judges: a tenth of the reach of Newton's method where the path is steepest."""


def followed(chain: stp.ClosedChain, target: pin.SE3) -> tuple[np.ndarray, float]:
    """Keep nearest to poses on the way, in many small steps; and the smallest singular value on that way."""
    state, rank, least = chain.home_state(), chain.generic.rank, np.inf
    path = pose_path(state, target)
    for k in range(1, STEPS + 1):
        for _ in range(8):
            residual = path.residuals(state, k / STEPS)
            u, s, vt = np.linalg.svd(state.rows)
            across = -vt[:rank].T @ (u[:, :rank].T @ residual[: chain.nc] / s[:rank])
            free, rows = vt[rank:].T, path.rows(state)
            left, own, right = np.linalg.svd(rows @ free, full_matrices=False)
            wanted = left[:, : path.rank].T @ (residual[chain.nc :] + rows @ across)
            along = -right[: path.rank].T @ (wanted / own[: path.rank])
            state = displaced(state, across + free @ along)
            least = min(least, float(s[rank - 1]), float(own[path.rank - 1]))
    assert np.abs(path.residuals(state, 1.0)).max() < 1e-12
    return state.q, least


@pytest.mark.parametrize(
    "tube", [(-1.16793097, -2.22915251, -0.04417915), (-1.29501635, 0.76712152, -0.18059435)]
)
def test_poses_on_the_way_need_not_be_within_reach(tube: tuple[float, float, float]) -> None:
    """A Tricept follows no screw: so far beside poses on the way, steps shrink by less than a quarter."""
    chain = robot("tricept")
    q = chain.q_home.copy()
    q[-3:] = tube  # which carries the platform
    pose = stp.platform_pose(chain, q)
    expected, least = followed(chain, pose)
    assert least > 0.01  # no singularity on the way
    found = stp.inverse_kinematics(chain, pose, limits=False)
    assert np.abs(pin.difference(chain.model, found.q, expected)).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "angles", "told"),
    [("screw_jack", (-1, 2, 1, 0, 0, 1, -2), True), ("scissor_lift", (0, 1, -2, -1, 2, -1, 0), False)],
)
def test_where_branches_cross_the_demand_tells_them_apart_or_none_is_kept(
    name: str, angles: tuple[int, ...], told: bool
) -> None:
    """Bars in one line may fold in another way from there: the jack's platform turns then, the lift's stays."""
    chain = robot(name)

    def pose_at(turn: float) -> pin.SE3:
        return stp.platform_pose(stp.close_loops(chain, chain.q_home + turn * np.array(angles)).state)

    flat = np.arctan(2 / 3 if name == "screw_jack" else 3 / 4)  # what the bars rise by at home
    for turn in (0.3, flat - 0.05, flat + 0.03, flat + 0.1, flat + 0.4):
        if turn < flat or told:
            assert stp.inverse_kinematics(chain, pose_at(turn), limits=False).success
        else:
            with pytest.raises(ClosureError, match="singularity"):
                stp.inverse_kinematics(chain, pose_at(turn), limits=False)


def test_demands_just_before_a_fold_are_met() -> None:
    """Two branches of a tripod meet at these motor positions; up to there the one of home answers."""
    chain = robot("three_rps")
    home = stp.motor_positions(chain, chain.q_home)
    fold = np.array([-0.3093840364, -0.0841668544, -0.3407438813])

    def side(q: np.ndarray) -> tuple[float, float]:
        here = chain.at(q)
        matrix = np.concatenate([here.rows, chain.motor_rows])
        return float(np.sign(np.linalg.det(matrix))), float(np.linalg.svd(matrix, compute_uv=False)[-1])

    for short in (1e-2, 1e-4, 1e-5, 3e-6, 1e-6, 5e-7):
        found = stp.forward_kinematics(chain, home + (1 - short) * fold, limits=False)
        sign, smallest = side(found.q)
        assert sign == side(chain.q_home)[0]
        # As the root of the distance to the fold: 0.2 of it, 0.04 of that farther away.
        assert 0.15 < smallest / np.sqrt(short) < 0.35, (short, smallest)
    for beyond in (1e-5, 1e-4, 1e-2):
        with pytest.raises(ClosureError, match="ends"):
            stp.forward_kinematics(chain, home + (1 + beyond) * fold, limits=False)


@pytest.mark.parametrize("name", ["four_bar", "crank_rocker", "bennett"])
def test_turns_cost_digits_and_no_answers(name: str) -> None:
    """After 100 000 turns an angle is known to 1e-10: the same configurations are closed, and reached from there."""
    chain = stp.load(name) if name == "four_bar" else zoo_chain(name)
    motor = chain.motor_q_index
    for more in (0.3, 0.7, 1.1, 1.6):
        far = stp.forward_kinematics(chain, chain.q_home[motor] + more, limits=False).q.copy()
        far[motor] += 2e5 * np.pi
        assert stp.close_loops(chain, far).iterations <= 2
        there = stp.forward_kinematics(chain, far[motor] + 0.2, q_guess=far, limits=False)
        back = stp.inverse_kinematics(chain, stp.platform_pose(chain, far), q_guess=there.q, limits=False)
        np.testing.assert_allclose(back.q, far, rtol=0, atol=1e-7)
