"""Certificates: true where they are given, refused where there is no solution, checked in multiprecision."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.analysis.assembly_modes.certificates import certify, proven_radius
from stewart_pin.analysis.assembly_modes.study import Scaling
from tests.analysis.platforms import draw


def _study_points(scaling: Scaling, modes: stp.hexapods.AssemblyModes) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(modes.rotation).as_quat(scalar_first=True)
    p = modes.position - scaling.base_centre + modes.rotation @ scaling.platform_centre
    p = p / scaling.size
    w, v = quaternion[:, :1], quaternion[:, 1:]
    # h = p e with p a pure quaternion.
    return np.hstack([quaternion, -(p * v).sum(axis=1, keepdims=True), w * p + np.cross(p, v)])


def _exact_solution(hexapod: stp.Hexapod, lengths: np.ndarray, scaling: Scaling, point: np.ndarray):
    """Solve the seven equations with 60 digits from the doubles of the geometry, in the chart of `point`."""
    mp = pytest.importorskip("mpmath")
    with mp.workdps(60):
        chart = int(np.argmax(np.abs(point[:4])))
        centres = [[mp.mpf(float(c)) for c in v] for v in (scaling.base_centre, scaling.platform_centre)]
        size = mp.mpf(scaling.size)
        base = [
            [(mp.mpf(float(x)) - c) / size for x, c in zip(b, centres[0], strict=True)]
            for b in hexapod.base_points
        ]
        arms = [
            [(mp.mpf(float(x)) - c) / size for x, c in zip(b, centres[1], strict=True)]
            for b in hexapod.platform_points
        ]
        squares = [(mp.mpf(float(x)) / size) ** 2 for x in lengths]

        def product(a, b):
            return [
                a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
                a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
            ]

        def equations(*free):
            x = [*free[:chart], mp.mpf(1), *free[chart:]]
            e, h = x[:4], x[4:]
            values = []
            for b, a, square in zip(base, arms, squares, strict=True):
                ea, be = product(e, [0, *a]), product([0, *b], e)
                d = [h[c] + ea[c] - be[c] for c in range(4)]
                values.append(sum(c * c for c in d) - square * sum(c * c for c in e))
            return [*values, sum(a * b for a, b in zip(e, h, strict=True))]

        start = [mp.mpf(float(v)) for i, v in enumerate(point) if i != chart]
        root = mp.findroot(equations, start, tol=1e-80, maxsteps=30)
        return [float(abs(r - s)) for r, s in zip(root, start, strict=True)]


@pytest.mark.parametrize("name", ["general 6-6", "semi-regular hexagons", "3-3"])
def test_the_true_solution_lies_in_the_proven_ball(name: str, rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw(name, rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    modes, scaling = stp.assembly_modes(hexapod, lengths), Scaling.of(hexapod, lengths)
    proofs = certify(*scaling.points(hexapod), lengths / scaling.size, _study_points(scaling, modes))
    assert proofs.certified.all() and (proofs.radius < 1e-9).all()
    for point, radius in zip(proofs.points, proofs.radius, strict=True):
        assert max(_exact_solution(hexapod, lengths, scaling, point)) <= radius


def test_no_certificate_where_there_is_no_solution(rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw("general 6-6", rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    scaling = Scaling.of(hexapod, lengths)
    # Real points anywhere: where Newton's method leads nowhere there is no certificate, elsewhere a true one.
    points = rng.normal(size=(300, 8))
    proofs = certify(*scaling.points(hexapod), lengths / scaling.size, points)
    assert not proofs.certified.all()
    position, rotation = scaling.pose(proofs.points[proofs.certified])
    assert np.abs(stp.leg_lengths(hexapod, position, rotation) - lengths).max(initial=0.0) < 1e-10


def test_the_ball_about_a_shifted_point_reaches_back_to_the_solution(rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw("general 6-6", rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    modes, scaling = stp.assembly_modes(hexapod, lengths), Scaling.of(hexapod, lengths)
    arguments = *scaling.points(hexapod), lengths / scaling.size
    true = certify(*arguments, _study_points(scaling, modes)).points
    chart = np.argmax(np.abs(true[:, :4]), axis=1)
    proven = 0
    for size in 10.0 ** np.arange(-12, 1):
        shift = size * rng.uniform(-1.0, 1.0, true.shape)
        shift[np.arange(len(true)), chart] = 0.0
        radius = proven_radius(*arguments, true + shift)
        assert (radius >= np.abs(shift).max(axis=1) * (1 - 1e-3)).all()
        proven += np.isfinite(radius).sum()
    # Near points are proven, far ones are not: the ball must fit the curvature of the equations.
    assert len(true) < proven < 10 * len(true)
    assert np.isinf(radius).all()


def test_no_certificate_where_the_gradients_are_dependent(rng: np.random.Generator) -> None:
    # All legs meet in one platform joint: six equations for three coordinates. Then Z₀ > 1 and the radius from
    # η and Z₀ is negative, which no other inequality would refuse.
    base, platform = rng.normal(size=(5, 3)), np.zeros((5, 3))
    radius = proven_radius(base, platform, rng.uniform(1.0, 2.0, 6), rng.normal(size=(50, 8)))
    assert np.isinf(radius).all()


def test_no_certificate_at_a_double_solution() -> None:
    # The singular yaw of a regular robot: two solutions meet, and none of them is the only one nearby.
    angle = np.pi / 3 * np.arange(6) + 0.2 * np.array([1, -1] * 3)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(6)])
    turned = np.column_stack([np.cos(-angle), np.sin(-angle), np.zeros(6)])
    hexapod = stp.Hexapod(ring, 0.5 * turned[[0, 5, 4, 3, 2, 1]])
    rotation = np.eye(3)
    jacobians = []
    for yaw in np.linspace(0.0, np.pi, 721):
        c, s = np.cos(yaw), np.sin(yaw)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        jacobians.append(np.linalg.det(stp.leg_jacobian(hexapod, [0.0, 0.0, 1.0], rotation)))
    assert np.min(np.abs(jacobians)) < 1e-10  # the grid holds the singular quarter turn
    yaw = np.linspace(0.0, np.pi, 721)[int(np.argmin(np.abs(jacobians)))]
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    lengths = stp.leg_lengths(hexapod, [0.0, 0.0, 1.0], rotation)
    modes = stp.assembly_modes(hexapod, lengths)
    gaps = np.abs(modes.position - [0, 0, 1]).max(axis=1) + np.abs(modes.rotation - rotation).max(axis=(1, 2))
    # A double solution is known to half the digits.
    assert gaps.min() < 1e-5
    assert not modes.certified[gaps.argmin()]
