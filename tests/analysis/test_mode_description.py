"""Properties of assembly modes against brute force and symmetry."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import stewart_pin as stp
from stewart_pin.analysis.assembly_modes.description import segment_distance
from stewart_pin.errors import InputError
from tests.analysis.platforms import draw


def _slow_distance(a: np.ndarray, u: np.ndarray, b: np.ndarray, v: np.ndarray) -> float:
    starts = [(s, t) for s in (0.0, 0.5, 1.0) for t in (0.0, 0.5, 1.0)]
    return min(
        np.sqrt(
            minimize(
                lambda x: float(((a + x[0] * u - b - x[1] * v) ** 2).sum()),
                start,
                bounds=[(0, 1), (0, 1)],
                tol=1e-14,
            ).fun
        )
        for start in starts
    )


def test_segment_distance_is_the_least(rng: np.random.Generator) -> None:
    a, u, b, v = rng.normal(size=(4, 15, 3))
    v[:5] = 2.0 * u[:5]
    b[5:10], v[5:10] = a[5:10] + 0.3 * u[5:10] - 0.5 * v[5:10], v[5:10]  # crossing
    slow = [_slow_distance(*args) for args in zip(a, u, b, v, strict=True)]
    # The minimiser stops at differences of the squared distance near 1e-14.
    np.testing.assert_allclose(segment_distance(a, u, b, v), slow, atol=2e-7)


def test_description_of_modes(forty_real) -> None:
    hexapod, lengths = forty_real
    modes = stp.assembly_modes(hexapod, lengths)
    facts = stp.hexapods.describe_modes(hexapod, modes, stroke=(0.6, 1.6), leg_radius=0.01)
    jacobian = stp.leg_jacobian(hexapod, modes.position, modes.rotation)
    np.testing.assert_array_equal(facts.side, np.sign(np.linalg.det(jacobian)))
    # The degree of the map from poses to lengths is zero: as many modes on either side.
    assert facts.side.sum() == 0
    assert facts.in_stroke.all() and (facts.condition >= 1.0).all()
    np.testing.assert_array_equal(facts.legs_clear, facts.clearance > 0.02)
    assert not facts.legs_clear.all() and facts.legs_clear.any()
    i, j = facts.closest_legs[0]
    tops = modes.position[0] + hexapod.platform_points @ modes.rotation[0].T
    ends = hexapod.base_points
    near = _slow_distance(ends[i], tops[i] - ends[i], ends[j], tops[j] - ends[j])
    assert facts.clearance[0] == pytest.approx(near, abs=2e-7)
    assert not stp.hexapods.describe_modes(hexapod, modes, stroke=(0.6, 1.5)).in_stroke.any()


def test_legs_that_share_a_joint_do_not_count(rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw("3-3", rng)
    modes = stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, position, rotation))
    facts = stp.hexapods.describe_modes(hexapod, modes)
    # 15 pairs, six of which share a corner of the octahedron.
    assert (facts.clearance > 1e-6).all()


def test_bad_stroke_is_named(forty_real) -> None:
    hexapod, lengths = forty_real
    modes = stp.assembly_modes(hexapod, lengths)
    with pytest.raises(InputError, match="least length first"):
        stp.hexapods.describe_modes(hexapod, modes, stroke=(2.0, 1.0))
    with pytest.raises(InputError, match="leg_radius"):
        stp.hexapods.describe_modes(hexapod, modes, leg_radius=-1.0)
