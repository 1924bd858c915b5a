"""The Delta robot in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError, UnreachableError

LEGS = stp.rotary.delta_legs(base_radius=0.132, platform_radius=0.033, crank=0.112, rod=0.232)


def test_forward_and_inverse_undo_each_other(rng: np.random.Generator) -> None:
    angle = rng.uniform(-0.4, 1.2, (50, 3))
    found = stp.rotary.delta_positions(LEGS, angle)
    assert found.position.shape == (50, 2, 3) and found.success.all()
    below, above = found.position[:, 0], found.position[:, 1]
    assert (below[:, 2] < above[:, 2]).all()
    for position in (below, above):
        back = stp.rotary.crank_angles(LEGS, position, np.eye(3)).angle
        # One of the two branches of every leg, the pushing one below the knees.
        assert np.abs(back - angle[..., None]).min(axis=-1).max() < 1e-12
    back = stp.rotary.crank_angles(LEGS, below, np.eye(3)).angle[..., 0]
    np.testing.assert_allclose(back, angle, atol=1e-12)


def test_legs_may_differ(rng: np.random.Generator) -> None:
    legs = stp.rotary.RotaryLegs(
        LEGS.base_points * [[1.1], [1.0], [0.9]], LEGS.axes, LEGS.zeros, LEGS.platform_points,
        cranks=[0.10, 0.11, 0.12], rods=[0.22, 0.24, 0.25],
    )  # fmt: skip
    angle = rng.uniform(0.2, 0.9, (20, 3))
    below = stp.rotary.delta_positions(legs, angle).position[:, 0]
    np.testing.assert_allclose(
        stp.rotary.crank_angles(legs, below, np.eye(3)).angle[..., 0], angle, atol=1e-12
    )


def test_the_published_formula(rng: np.random.Generator) -> None:
    """The usual formula of one arm, in its own plane: elbow from two circles, the rod's offset across taken out."""
    position = np.array([0.0, 0.0, -0.2]) + rng.uniform(-0.04, 0.04, (20, 3))
    angle = stp.rotary.crank_angles(LEGS, position, np.eye(3)).angle[..., 0]
    for leg, direction in enumerate((0.0, 2 * np.pi / 3, 4 * np.pi / 3)):
        x = position[:, 0] * np.cos(direction) + position[:, 1] * np.sin(direction) + 0.033 - 0.132
        y = -position[:, 0] * np.sin(direction) + position[:, 1] * np.cos(direction)
        z = position[:, 2]
        # Half-angle substitution t = tan(θ/2) of x cos θ - z sin θ = k, with rod² = y² + ...
        k = (x**2 + y**2 + z**2 + 0.112**2 - 0.232**2) / (2 * 0.112)
        t = (-z - np.sqrt(z**2 + x**2 - k**2)) / (k + x)
        np.testing.assert_allclose(angle[:, leg], 2 * np.arctan(t), atol=1e-12)


def test_equal_angles_give_a_height() -> None:
    theta = 0.5
    out = 0.132 + 0.112 * np.cos(theta) - 0.033
    expected = -0.112 * np.sin(theta) - np.sqrt(0.232**2 - out**2)
    np.testing.assert_allclose(
        stp.rotary.delta_positions(LEGS, [theta] * 3).position[0], [0, 0, expected], atol=1e-15
    )


def test_errors_say_what_to_do() -> None:
    wide = stp.rotary.delta_legs(base_radius=0.132, platform_radius=0.033, crank=0.112, rod=0.2)
    with pytest.raises(
        UnreachableError, match=r"do not meet at index \(1,\): .* 0.211 m .* 0.2 m long"
    ) as caught:
        stp.rotary.delta_positions(wide, [[0.5] * 3, [0.0] * 3])
    assert caught.value.residual == pytest.approx(0.011)
    found = stp.rotary.delta_positions(wide, [[0.5] * 3, [0.0] * 3], throw=False)
    assert found.success.tolist() == [True, False] and np.isfinite(found.position).all()
    narrow = stp.rotary.delta_legs(base_radius=0.033, platform_radius=0.033, crank=0.1, rod=0.2)
    with pytest.raises(SingularityError, match="stand in line"):
        stp.rotary.delta_positions(narrow, [np.pi / 2] * 3)
    with pytest.raises(InputError, match="three of a Delta, got 1"):
        stp.rotary.delta_positions(
            stp.rotary.RotaryLegs([[0, 0, 0]], [[0, 1, 0]], [[1, 0, 0]], [[0, 0, 0]], [1], [1]), [0.0]
        )
    with pytest.raises(InputError, match="rod must be a finite number above zero, got 0"):
        stp.rotary.delta_legs(base_radius=1, platform_radius=1, crank=1, rod=0)
