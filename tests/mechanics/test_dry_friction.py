"""Dry friction of coordinates at rest: two solvers, against what the law of friction says of each coordinate."""

from __future__ import annotations

import numpy as np
import pytest

from stewart_pin.mechanics.constraint_matrix.joint_efforts import friction_at_rest
from stewart_pin.state.joint_effects import held_by

LEFT = 1e-9
"""Acceleration against friction, relative to the largest; a few round-offs through twelve digits of responses."""


def problem(rng: np.random.Generator, count: int, freedoms: int, spread: float) -> tuple[np.ndarray, ...]:
    """Draw responses of coordinates that share freedoms, of sizes apart by some powers of ten."""
    sizes = 10 ** rng.uniform(-spread, spread, count)
    response = rng.normal(size=(count, freedoms)) * sizes[:, None]
    if count > 2:
        response[1] = -2 * response[0]  # a hinge told twice
    pull = response @ rng.normal(size=freedoms)
    # Some hold with ease, some with effort, some not at all.
    limits = 10 ** rng.uniform(-1.5, 1.0, count) / np.linalg.norm(response, axis=1)
    return response, pull, limits


@pytest.mark.parametrize("spread", [0.0, 2.0])
@pytest.mark.parametrize(("count", "freedoms"), [(1, 1), (3, 3), (3, 1), (6, 4), (12, 5), (8, 8)])
def test_each_coordinate_stays_or_slips_against_its_friction(
    count: int, freedoms: int, spread: float, rng: np.random.Generator
) -> None:
    for _ in range(20):
        response, pull, limits = problem(rng, count, freedoms, spread)
        one = held_by(response, pull, limits)
        two = friction_at_rest(response @ response.T, pull, limits)
        sizes = np.linalg.norm(response, axis=1)
        for friction in (one, two):
            assert (np.abs(friction) <= limits * (1 + 1e-12)).all()
            left = (response @ (response.T @ friction) + pull) / sizes
            left /= np.abs(pull / sizes).max() + np.abs(sizes * limits).max()
            stays = np.abs(left) < LEFT
            slips = np.isclose(np.abs(friction), limits, rtol=1e-9) & (left * friction < 0)
            assert (stays | slips).all()
        scale = np.abs(response.T @ one).max()
        assert response.T @ two == pytest.approx(response.T @ one, rel=1e-6, abs=1e-7 * scale)


def test_a_joint_holds_beside_one_that_slips() -> None:
    # The second slips, and its friction takes the third back to where it holds.
    response = np.array([[0.0, 0.0, 0.46], [-0.40, -0.63, 0.0], [1.70, -0.15, 0.0]])
    pull, limits = np.array([-0.1, -15.2, 3.2]), np.array([1.6, 1.1, 1.45])
    matrix = response @ response.T
    third = -(pull[2] + matrix[2, 1] * limits[1]) / matrix[2, 2]
    expected = [0.1 / 0.46**2, limits[1], third]
    assert held_by(response, pull, limits) == pytest.approx(expected, rel=1e-12)
    assert friction_at_rest(matrix, pull, limits) == pytest.approx(expected, rel=1e-9)
