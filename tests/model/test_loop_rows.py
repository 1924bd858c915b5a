"""Rows of a loop: they vanish exactly on the motions that the kind leaves free, near and far."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from stewart_pin.model.description import LOOP_KINDS, JointKind, Loop
from stewart_pin.model.loop_rows import AngleRow, LengthRow, NormalRow, closure_rows, orthonormal_triad

ROWS = {
    JointKind.FIXED: 6,
    JointKind.REVOLUTE: 5,
    JointKind.PRISMATIC: 5,
    JointKind.SPHERICAL: 3,
    JointKind.UNIVERSAL: 4,
    JointKind.CYLINDRICAL: 4,
    JointKind.PLANAR: 3,
    JointKind.POINT_ON_LINE: 2,
    JointKind.DISTANCE: 1,
    JointKind.CABLE: 1,
}
LENGTH = 0.7
TURNS = (JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.PLANAR)
HOLDS = (JointKind.FIXED, JointKind.PRISMATIC)


def a_loop(kind: JointKind, rng: np.random.Generator) -> Loop:
    axis, axis2 = (x / np.linalg.norm(x) for x in rng.normal(size=(2, 3)))
    one = pin.SE3.Identity()
    return Loop("loop", kind, "a", "b", one, one, axis=axis, axis2=axis2, length=LENGTH)


def gap(loop: Loop, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Evaluate the rows from their definition."""
    values = []
    for row in closure_rows(loop):
        match row:
            case NormalRow(normal):
                values.append(normal @ translation)
            case AngleRow(u1, u2):
                values.append(u1 @ rotation @ u2)
            case LengthRow(length):
                values.append(np.linalg.norm(translation) - length)
    return np.array(values)


def allowed_motion(loop: Loop, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw rotation and translation that the kind leaves free, from its name and nothing else."""
    a, b, c = orthonormal_triad(loop.axis)
    about = Rotation.from_rotvec(rng.uniform(-3, 3) * a).as_matrix()
    any_turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    x, y, z = rng.normal(size=3)
    here, one = np.zeros(3), np.eye(3)
    direction = rng.normal(size=3)
    # A universal joint: turn about the axis of frame 1, after a turn that lays axis2 across it, after one about axis2.
    across = Rotation.align_vectors([b], [loop.axis2])[0].as_matrix()
    about2 = Rotation.from_rotvec(rng.uniform(-3, 3) * loop.axis2).as_matrix()
    return {
        JointKind.FIXED: (one, here),
        JointKind.REVOLUTE: (about, here),
        JointKind.PRISMATIC: (one, x * a),
        JointKind.SPHERICAL: (any_turn, here),
        JointKind.UNIVERSAL: (about @ across @ about2, here),
        JointKind.CYLINDRICAL: (about, x * a),
        JointKind.PLANAR: (about, y * b + z * c),
        JointKind.POINT_ON_LINE: (any_turn, x * a),
        JointKind.DISTANCE: (any_turn, LENGTH * direction / np.linalg.norm(direction)),
        JointKind.CABLE: (any_turn, LENGTH * direction / np.linalg.norm(direction)),
    }[loop.kind]


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_rows_vanish_on_the_motions_left_free(kind: JointKind, rng: np.random.Generator) -> None:
    for _ in range(10):
        loop = a_loop(kind, rng)
        residual = gap(loop, *allowed_motion(loop, rng))
        assert residual.shape == (ROWS[kind],)
        assert np.abs(residual).max() < 1e-14


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_rows_hold_all_other_motions(kind: JointKind, rng: np.random.Generator) -> None:
    # The rank of the rows' derivative at an allowed placement is the number of freedoms taken.
    loop = a_loop(kind, rng)
    rotation, translation = allowed_motion(loop, rng)
    h, columns = 1e-6, []
    for e in np.eye(6) * h:
        plus, minus = (
            gap(loop, Rotation.from_rotvec(s * e[3:]).as_matrix() @ rotation, translation + s * e[:3])
            for s in (1, -1)
        )
        columns.append((plus - minus) / (2 * h))
    assert np.linalg.matrix_rank(np.array(columns), tol=1e-6) == ROWS[kind]


@pytest.mark.parametrize("kind", [*TURNS, *HOLDS])
def test_closed_rows_mean_aligned_axes(kind: JointKind, rng: np.random.Generator) -> None:
    """Rows that are right near the closure only have other roots far away: search for them."""
    loop = a_loop(kind, rng)

    def angles(vector: np.ndarray) -> np.ndarray:
        return gap(loop, Rotation.from_rotvec(vector).as_matrix(), np.zeros(3))

    found = 0
    for start in rng.uniform(-3, 3, (15, 3)):
        result = least_squares(angles, start, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        if np.abs(result.fun).max() > 1e-12:
            continue
        found += 1
        turned = Rotation.from_rotvec(result.x).as_matrix()
        # Aligned, or turned by half a turn; `settle_home` refuses the latter.
        assert abs(abs(loop.axis @ turned @ loop.axis) - 1) < 1e-9
        if kind in HOLDS:
            assert min(abs(np.trace(turned) - 3), abs(np.trace(turned) + 1)) < 1e-9
    assert found > 8


def test_triad_is_right_handed(rng: np.random.Generator) -> None:
    for axis in [*np.eye(3), *-np.eye(3), *(x / np.linalg.norm(x) for x in rng.normal(size=(20, 3)))]:
        triad = np.array(orthonormal_triad(axis))
        np.testing.assert_allclose(triad @ triad.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(triad) > 0
