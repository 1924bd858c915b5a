"""Singularities over a plane, against closed forms evaluated on the same grid."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.closed_states import robot

PLANAR = stp.PlanarRPR(np.array([[0, 0], [5, 0], [0, 6.0]]), np.array([[0, 0], [3, 0], [3, 3.0]]))
HIP, LINK = 0.059, 0.09


def test_planar_platform_changes_sign_where_its_determinant_does() -> None:
    chain = robot("rpr_planar")
    turn = stp.platform_pose(chain, chain.q_home).rotation
    angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
    x, y = np.linspace(-1.5, 5.5, 25), np.linspace(-4.8, 3.2, 29)
    found = stp.singularities.singularity_map(chain, x, y, axes=("vx", "vy", "wz"))
    # All but cells beside a leg without length, whose hinge turns at once.
    assert (~found.reached).sum() <= 3
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    det = np.linalg.det(stp.planar.planar_leg_jacobian(PLANAR, grid, np.full(grid.shape[:-1], angle)))
    assert np.nanmin(found.measures["motor"]) > 1e-5
    lengths = stp.planar.planar_leg_lengths(PLANAR, grid, np.full(grid.shape[:-1], angle)).min(axis=-1)
    expected, plain = [], []
    for step in ((1, 0), (0, 1)):
        a, b = det[: len(y) - step[0], : len(x) - step[1]], det[step[0] :, step[1] :]
        for row, column in np.argwhere(a * b < 0):
            there = row + step[0], column + step[1]
            share = a[row, column] / (a[row, column] - b[row, column])
            expected.append(grid[row, column] + share * (grid[there] - grid[row, column]))
            # A leg shorter than twice the grid's width turns too far from one point to the next.
            plain.append(min(lengths[row, column], lengths[there]) > 0.7)
    # The same edges of the grid, and on them points that differ by the bend of the functions.
    away = np.linalg.norm(found.crossings["motor"][:, None] - np.array(expected), axis=2)
    assert sum(plain) > 30
    assert away.min(axis=1).max() < 0.1
    assert away.min(axis=0)[plain].max() < 0.1


def test_five_bar_is_reached_where_both_legs_reach() -> None:
    chain = robot("five_bar")
    x, y = np.linspace(-0.15, 0.15, 21), np.linspace(0.012, 0.18, 15)
    found = stp.singularities.singularity_map(chain, x, y, axes=("vx", "vy"))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    reach = [np.linalg.norm(grid - [side * HIP, 0], axis=-1) for side in (-1, 1)]
    within = np.maximum(*reach) < 2 * LINK
    # What is missing lies where a step of the grid turns a nearly straight knee by more than a branch allows.
    missing = within & ~found.reached
    assert not (found.reached & ~within).any()
    assert (np.maximum(*reach)[missing] > 0.94 * 2 * LINK).all() and missing.sum() < 0.1 * within.sum()
    # Type I is a straight knee: the measure falls to the edge.
    values = found.measures["platform"]
    edge = np.maximum(*reach) > 0.97 * 2 * LINK
    assert np.nanmax(values[within & edge]) < np.nanmedian(values[within & ~edge])
    # Type II are distal links in line. Their angles, knees outward, by the law of cosines.
    for at in found.crossings["motor"]:
        angles = []
        for side in (-1, 1):
            way = at - [side * HIP, 0]
            bend = np.arccos(np.linalg.norm(way) / 2 / LINK)
            angles.append(np.arctan2(way[1], way[0]) + side * bend)
        assert abs(np.sin(angles[0] - angles[1])) < 0.1  # a grid's width squared
    assert len(found.crossings["motor"]) > 10
    # The rods' own equations never depend on each other here, however fast they turn near the edge.
    assert np.nanmin(found.measures["loop"]) > 0.5 and not len(found.crossings["loop"])


def test_nothing_is_marked_on_the_cut_between_two_sheets() -> None:
    """Round a hip, where a leg folds, the five-bar comes back otherwise: marks are changes of the closed form alone."""
    chain = robot("five_bar")
    x, y = np.linspace(0.0, 0.12, 16), np.linspace(-0.06, 0.06, 16)
    above = stp.singularities.singularity_map(
        chain, np.linspace(0, 0.045, 4), np.linspace(0.048, 0.156, 10), axes=("vx", "vy")
    ).q[0, 3]
    found = stp.singularities.singularity_map(chain, x, y, axes=("vx", "vy"), q_guess=above)
    left_hip, left_knee, right_hip, right_knee = (
        found.q[..., chain.tangent_names.index(name)]
        for name in ("left_hip", "left_knee", "right_hip", "right_knee")
    )
    in_line = np.sin(left_hip + left_knee - right_hip - right_knee)
    near = 0.0
    for axis in (0, 1):
        ends = [np.take(in_line, range(i, 15 + i), axis) for i in (0, 1)]
        turns = [np.take(found.q, range(i, 15 + i), axis) for i in (0, 1)]
        same_sheet = np.abs(np.sin((turns[0] - turns[1]) / 2)).max(axis=-1) < np.sin(0.25)
        near += np.count_nonzero((ends[0] * ends[1] < 0) & same_sheet)
    assert len(found.crossings["motor"]) == near > 10
    for at in found.crossings["motor"]:
        column, row = (at[0] - x[0]) / (x[1] - x[0]), (at[1] - y[0]) / (y[1] - y[0])
        a, b = (tuple(int(f(round(k, 9))) for k in (row, column)) for f in (np.floor, np.ceil))
        assert in_line[a] * in_line[b] < 0
        assert np.abs(np.sin((found.q[a] - found.q[b]) / 2)).max() < np.sin(0.25)


def test_where_the_platform_may_turn_is_up_to_the_axes() -> None:
    """With the angle free the 3-RPR is no longer held at its own: it stays as the solver finds it."""
    chain = robot("rpr_planar")
    free = stp.singularities.singularity_map(chain, [4.0, 4.5, 5.0], [2.0, 2.5], axes=("vx", "vy"))
    held = stp.singularities.singularity_map(chain, [4.0, 4.5, 5.0], [2.0, 2.5], axes=("vx", "vy", "wz"))
    turns = [
        [stp.platform_pose(chain, q).rotation[1, 0] for q in found.q.reshape(-1, chain.nq)]
        for found in (free, held)
    ]
    assert np.ptp(turns[1]) < 1e-9 < np.ptp(turns[0])


def test_bad_arguments_are_refused() -> None:
    chain = robot("five_bar")
    with pytest.raises(InputError, match="x must hold two or more rising numbers"):
        stp.singularities.singularity_map(chain, [0.1, 0.0], [0.1, 0.2], axes=("vx", "vy"))
    with pytest.raises(InputError, match="plane must be two of vx, vy, vz"):
        stp.singularities.singularity_map(chain, [0.0, 0.1], [0.1, 0.2], plane=("vx", "wz"))
    with pytest.raises(InputError, match="does not reach the cell next to its start"):
        stp.singularities.singularity_map(chain, [1.0, 1.1], [0.1, 0.2], axes=("vx", "vy"))
    with pytest.raises(InputError, match="axes must be some of"):
        stp.singularities.singularity_map(chain, [0.0, 0.1], [0.1, 0.2], axes=("vx", "vy", "w"))
