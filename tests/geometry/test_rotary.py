"""Rotary legs in closed form: both branches, their reach and limits, and the Jacobian."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError, UnreachableError


@pytest.fixture
def legs(rng: np.random.Generator) -> stp.rotary.RotaryLegs:
    """Return six legs without any symmetry."""
    axes, helpers = rng.normal(size=(2, 6, 3))
    return stp.rotary.RotaryLegs(
        base_points=np.array([1.0, 1.0, 0.1]) * rng.uniform(-0.4, 0.4, (6, 3)),
        axes=axes,
        zeros=np.cross(axes, helpers),
        platform_points=np.array([1.0, 1.0, 0.1]) * rng.uniform(-0.2, 0.2, (6, 3)),
        cranks=rng.uniform(0.25, 0.35, 6),
        rods=rng.uniform(0.6, 0.8, 6),
    )


def poses(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses about 0.6 m above the base."""
    position = np.array([0.0, 0.0, 0.6]) + 0.1 * rng.uniform(-1, 1, (n, 3))
    return position, Rotation.from_rotvec(0.3 * rng.uniform(-1, 1, (n, 3))).as_matrix()


def rods(
    legs: stp.rotary.RotaryLegs, position: np.ndarray, rotation: np.ndarray, angle: np.ndarray
) -> np.ndarray:
    """Rod vectors by turning each crank with Rodrigues' formula: (n, 3)."""
    turn = Rotation.from_rotvec(np.reshape(angle, (-1, 1)) * legs.axes)
    tips = legs.base_points + legs.cranks[:, None] * turn.apply(np.array(legs.zeros))
    return position + legs.platform_points @ rotation.T - tips


def test_both_branches_close_every_rod(legs: stp.rotary.RotaryLegs, rng: np.random.Generator) -> None:
    position, rotation = poses(rng, 200)
    found = stp.rotary.crank_angles(legs, position, rotation, throw=False)
    assert found.angle.shape == (200, 6, 2) and found.success.shape == (200,)
    assert 20 < found.success.sum() < 200  # the random legs reach some of the poses
    assert (np.abs(found.angle) <= np.pi).all() and np.isfinite(found.angle).all()
    for p, r, theta, ok in zip(position, rotation, found.angle, found.success, strict=True):
        if ok:
            for branch in (0, 1):
                lengths = np.linalg.norm(rods(legs, p, r, theta[:, branch]), axis=1)
                np.testing.assert_allclose(lengths, legs.rods, rtol=1e-13)


def test_there_is_no_third_branch(legs: stp.rotary.RotaryLegs, rng: np.random.Generator) -> None:
    """Scan the whole circle for sign changes of the rod's misfit."""
    position, rotation = poses(rng, 5)
    found = stp.rotary.crank_angles(legs, position, rotation, throw=False)
    grid = np.linspace(-np.pi, np.pi, 361)
    for k in range(5):

        def misfit(theta: float, leg: int, k: int = k) -> float:
            length = np.linalg.norm(rods(legs, position[k], rotation[k], np.full(6, theta))[leg])
            return float(length - legs.rods[leg])

        for leg in range(6):
            values = [misfit(theta, leg) for theta in grid]
            at = [
                brentq(misfit, grid[i], grid[i + 1], (leg,), xtol=1e-14)
                for i in range(360)
                if values[i] * values[i + 1] < 0
            ]
            expected = np.sort(found.angle[k, leg]) if found.shortage[k, leg] == 0 else []
            np.testing.assert_allclose(at, expected, atol=1e-10)
            if found.shortage[k, leg] > 0:
                np.testing.assert_allclose(min(values), found.shortage[k, leg], rtol=1e-3)
            if found.shortage[k, leg] < 0:
                np.testing.assert_allclose(max(values), found.shortage[k, leg], rtol=1e-3)


def test_jacobian_is_the_derivative_of_the_angles(
    legs: stp.rotary.RotaryLegs, rng: np.random.Generator
) -> None:
    position, rotation = poses(rng, 200)
    reached = np.flatnonzero(stp.rotary.crank_angles(legs, position, rotation, throw=False).success)[:5]
    h = 1e-5
    for k in reached:
        twist = rng.normal(size=6)
        moved = [
            stp.rotary.crank_angles(
                legs,
                position[k] + t * twist[:3],
                Rotation.from_rotvec(t * twist[3:]).as_matrix() @ rotation[k],
            ).angle
            for t in (-h, 0.0, h)
        ]
        for branch, push in ((0, 1.0), (1, -1.0)):
            jacobian = stp.rotary.crank_jacobian(legs, position[k], rotation[k], moved[1][:, branch])
            rates = (moved[2] - moved[0])[:, branch] / (2 * h)
            np.testing.assert_allclose(jacobian @ twist, rates, rtol=1e-6, atol=1e-6)
            # First the branch on which a positive rate pushes along the rod.
            u = rods(legs, position[k], rotation[k], moved[1][:, branch])
            assert (push * np.einsum("ij,ij->i", jacobian[:, :3], u) > 0).all()


def test_any_batch_shape(legs: stp.rotary.RotaryLegs, rng: np.random.Generator) -> None:
    position, rotation = poses(rng, 12)
    flat = stp.rotary.crank_angles(legs, position, rotation, throw=False)
    shaped = stp.rotary.crank_angles(
        legs, position.reshape(3, 4, 3), rotation.reshape(3, 4, 3, 3), throw=False
    )
    np.testing.assert_array_equal(shaped.angle, flat.angle.reshape(3, 4, 6, 2))
    one = stp.rotary.crank_angles(legs, position[0], rotation[0], throw=False)
    np.testing.assert_array_equal(one.angle, flat.angle[0])
    assert one.success.shape == ()


ONE_LEG = stp.rotary.RotaryLegs([[0, 0, 0]], [[0, -1, 0]], [[1, 0, 0]], [[0, 0, 0]], [0.3], [0.5])
"""A crank in the xz plane, positive angles up, and a rod."""


@pytest.mark.parametrize(
    ("x", "angles", "shortage"),
    [
        (0.8, (0.0, 0.0), 0.0),
        (0.2, (-np.pi, np.pi), 0.0),
        (0.9, (0.0, 0.0), 0.1),
        (0.1, (np.pi, np.pi), -0.1),
    ],
)
def test_stretched_folded_and_out_of_reach(x: float, angles: tuple, shortage: float) -> None:
    found = stp.rotary.crank_angles(ONE_LEG, [x, 0, 0], np.eye(3), throw=False)
    # At ±π the two branches are the same angle.
    np.testing.assert_allclose(np.exp(1j * found.angle[0]), np.exp(1j * np.array(angles)), atol=1e-7)
    np.testing.assert_allclose(found.shortage, [shortage], atol=1e-15)
    assert found.within.all() == (shortage == 0)


def test_limits_choose_the_branch_and_the_turn() -> None:
    free = stp.rotary.crank_angles(ONE_LEG, [0.6, 0, 0], np.eye(3)).angle[0]
    opening = np.arccos((0.6**2 + 0.3**2 - 0.5**2) / (2 * 0.3 * 0.6))
    np.testing.assert_allclose(free, [-opening, opening], atol=1e-14)
    found = stp.rotary.crank_angles(ONE_LEG, [0.6, 0, 0], np.eye(3), limits=(0.0, 2.0))
    np.testing.assert_array_equal(found.within, [[False, True]])
    turned = stp.rotary.crank_angles(ONE_LEG, [0.6, 0, 0], np.eye(3), limits=(6.0, 8.0))
    np.testing.assert_allclose(turned.angle[0], free + 2 * np.pi, atol=1e-14)
    np.testing.assert_array_equal(turned.within, [[False, True]])
    with pytest.raises(
        UnreachableError, match=r"leg 1 .* at -0.981765 rad, beyond its limits -0.5 to 0.5"
    ) as caught:
        stp.rotary.crank_angles(ONE_LEG, [0.6, 0, 0], np.eye(3), limits=(-0.5, 0.5))
    assert caught.value.violations["leg 1"][1:] == (-0.5, 0.5)


def test_errors_name_leg_index_and_remedy(legs: stp.rotary.RotaryLegs) -> None:
    position = np.array([[0.6, 0, 0], [0.9, 0, 0]])
    with pytest.raises(
        UnreachableError, match=r"leg 1 .*index \(1,\).* 0.5 m long, .* 0.6 to 1.2 m from"
    ) as caught:
        stp.rotary.crank_angles(ONE_LEG, position, np.eye(3))
    assert caught.value.violations == {"leg 1": pytest.approx((0.5, 0.6, 1.2))}
    assert caught.value.residual == pytest.approx(0.1)
    with pytest.raises(SingularityError, match="leg 1: the platform point is on the axis"):
        stp.rotary.crank_angles(ONE_LEG, [0, 0.4, 0], np.eye(3))
    with pytest.raises(SingularityError, match="leg 1 is at a dead centre"):
        stp.rotary.crank_jacobian(ONE_LEG, [0.8, 0, 0], np.eye(3), [0.0])
    with pytest.raises(InputError, match=r"rod of leg 1 would be 0.6 m long, it is 0.5 m; see crank_angles"):
        stp.rotary.crank_jacobian(ONE_LEG, [0.9, 0, 0], np.eye(3), [0.0])
    with pytest.raises(InputError, match="limits: those of leg 2"):
        stp.rotary.crank_angles(legs, [0, 0, 1], np.eye(3), limits=[(0, 1), (1, 0), *[(0, 1)] * 4])
    with pytest.raises(InputError, match=r"limits must have shape \(6, 2\) or \(2,\), got \(3,\)"):
        stp.rotary.crank_angles(legs, [0, 0, 1], np.eye(3), limits=[0, 1, 2])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"axes": [[0, 0, 0]]}, "axes: leg 1 has a vector of length zero"),
        (
            {"zeros": [[1, 1, 0]]},
            "zeros: that of leg 1 is not square to its axis, the cosine between them is 0.707",
        ),
        ({"cranks": [-0.3]}, r"cranks\[0\] must be a finite number above zero, got -0.3"),
        ({"platform_points": [[0, 0, 0]] * 2}, r"platform_points must have shape \(1, 3\), got \(2, 3\)"),
        ({"rods": [0.5, 0.5]}, r"rods must have shape \(1,\) or be one number, got \(2,\)"),
    ],
)
def test_bad_geometry_is_named(changes: dict, words: str) -> None:
    names = ("base_points", "axes", "zeros", "platform_points", "cranks", "rods")
    with pytest.raises(InputError, match=words):
        stp.rotary.RotaryLegs(**({name: getattr(ONE_LEG, name) for name in names} | changes))
