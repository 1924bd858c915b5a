"""The sampled workspace against exact columns, against every leg, and against its own bounds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy import ndimage

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError, StewartPinError
from stewart_pin.geometry.rotations import rotation_from_rpy
from tests.closed_states import robot

# S0.4: actuator output 0.7 to 1.2 m, plus 1.50147 m.
STROKE = (2.20147, 2.70147)
LEVEL = np.eye(3)


def column_volume(hexapod: stp.Hexapod, rotation: np.ndarray, bounds: np.ndarray, count: int) -> float:
    """Integrate exact vertical extents above the highest centre: along a column every shell is an interval."""
    centres = hexapod.base_points - hexapod.platform_points @ rotation.T
    side = (bounds[1, :2] - bounds[0, :2]) / count
    x, y = (bounds[0, k] + side[k] * (np.arange(count) + 0.5) for k in (0, 1))
    across = (x[:, None, None] - centres[:, 0]) ** 2 + (y[None, :, None] - centres[:, 1]) ** 2
    top = centres[:, 2] + np.sqrt(np.maximum(STROKE[1] ** 2 - across, 0.0))
    bottom = centres[:, 2] + np.sqrt(np.maximum(STROKE[0] ** 2 - across, 0.0))
    reached = (across < STROKE[1] ** 2).all(axis=-1)
    height = np.maximum(top.min(axis=-1) - np.maximum(bottom.max(axis=-1), centres[:, 2].max()), 0.0)
    return float((height * reached).sum() * side.prod())


def test_volume_is_within_its_stated_error(report_cad: stp.Hexapod) -> None:
    bounds = stp.workspaces.sample_workspace(report_cad, LEVEL, stroke=STROKE, spacing=0.2).bounds
    # Two resolutions of the exact columns agree to six digits.
    exact = column_volume(report_cad, LEVEL, bounds, 600)
    assert exact == pytest.approx(2.600231, abs=5e-6)
    ratios = []
    for spacing in (0.15, 0.12, 0.1, 0.09, 0.08, 0.07, 0.06):
        samples = stp.workspaces.sample_workspace(report_cad, LEVEL, stroke=STROKE, spacing=spacing)
        ratios.append((samples.volume - exact) / samples.volume_error)
        assert samples.volume_bounds[0] <= exact <= samples.volume_bounds[1]
    assert np.abs(ratios).max() < 3.0
    # Neither too proud nor too humble.
    assert 0.2 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_tilted_platform_too(report_cad: stp.Hexapod) -> None:
    rotation = rotation_from_rpy(0.1, -0.15, 0.3)
    samples = stp.workspaces.sample_workspace(report_cad, rotation, stroke=STROKE, spacing=0.07)
    exact = column_volume(report_cad, rotation, samples.bounds, 400)
    # Turned, the centres differ in height; the workspace ends far above them, where a column is one interval.
    centres = report_cad.base_points - report_cad.platform_points @ rotation.T
    assert samples.position[samples.inside][:, 2].min() > centres[:, 2].max() + 0.1
    assert abs(samples.volume - exact) < 3 * samples.volume_error


def test_every_point_is_judged_by_its_legs(report_cad: stp.Hexapod) -> None:
    samples = stp.workspaces.sample_workspace(report_cad, LEVEL, stroke=STROKE, spacing=0.1)
    lengths = stp.leg_lengths(report_cad, samples.position, LEVEL)
    within = ((lengths >= STROKE[0]) & (lengths <= STROKE[1])).all(axis=-1)
    np.testing.assert_array_equal(samples.inside, within)
    limit = np.where(samples.limiting_end < 0, STROKE[0], STROKE[1])
    own = np.take_along_axis(lengths, samples.limiting_leg[:, None], axis=1)[:, 0]
    np.testing.assert_allclose(samples.clearance, samples.limiting_end * (limit - own), atol=1e-14)
    others = np.minimum(lengths - STROKE[0], STROKE[1] - lengths).min(axis=-1)
    np.testing.assert_array_equal(samples.clearance, others)
    # All twelve patches of the boundary are met.
    patches = np.c_[samples.limiting_leg, samples.limiting_end][samples.boundary]
    assert len(np.unique(patches, axis=0)) == 12
    # Stepping outwards along the limiting leg by a little more than the clearance leaves the workspace.
    legs = (
        samples.position[samples.boundary]
        - (report_cad.base_points - report_cad.platform_points)[patches[:, 0]]
    )
    out = patches[:, 1:] * legs / np.linalg.norm(legs, axis=1, keepdims=True)
    step = samples.clearance[samples.boundary, None] + 1e-9
    beyond = stp.leg_lengths(report_cad, samples.position[samples.boundary] + step * out, LEVEL)
    assert ((beyond < STROKE[0]) | (beyond > STROKE[1])).any(axis=-1).all()


def test_no_point_is_missed(report_cad: stp.Hexapod, rng: np.random.Generator) -> None:
    samples = stp.workspaces.sample_workspace(report_cad, LEVEL, stroke=STROKE, spacing=0.1)
    # Random points of a wider box: those in the workspace lie in the bounds, in a cell that was kept.
    points = rng.uniform([-3, -3, 0.1], [3, 3, 3], (20_000, 3))
    lengths = stp.leg_lengths(report_cad, points, LEVEL)
    reached = points[((lengths >= STROKE[0]) & (lengths <= STROKE[1])).all(axis=-1)]
    assert len(reached) > 400
    assert (reached >= samples.bounds[0]).all() and (reached <= samples.bounds[1]).all()
    kept = {tuple(cell) for cell in samples.index}
    start = samples.position[0] - (samples.index[0] + 0.5) * samples.spacing
    assert {tuple(cell) for cell in np.floor((reached - start) / samples.spacing).astype(int)} <= kept


def test_sheets_mirror_each_other(report_cad: stp.Hexapod) -> None:
    upper, lower, both = (
        stp.workspaces.sample_workspace(report_cad, LEVEL, stroke=STROKE, spacing=0.1, sheet=sheet)
        for sheet in ("upper", "lower", "both")
    )
    # All centres at one height, 49.49 + 46.39 mm: the sheets are mirror images.
    np.testing.assert_allclose(upper.bounds[:, 2] + lower.bounds[::-1, 2], 2 * 0.09588, atol=1e-12)
    assert lower.volume == pytest.approx(upper.volume, abs=1e-12)
    assert abs(both.volume - 2 * upper.volume) < 3 * both.volume_error
    assert (upper.pieces, lower.pieces, both.pieces) == (1, 1, 2)
    # A flat platform between them is singular: the determinant changes its sign.
    assert both.crosses_singularity and not upper.crosses_singularity and not lower.crosses_singularity


def test_condition_is_that_of_the_normalised_jacobian(report_cad: stp.Hexapod) -> None:
    samples = stp.workspaces.sample_workspace(report_cad, LEVEL, stroke=STROKE, spacing=0.2, length=0.3)
    for k in range(0, len(samples.position), 50):
        jacobian = stp.leg_jacobian(report_cad, samples.position[k], LEVEL) / [1, 1, 1, 0.3, 0.3, 0.3]
        assert samples.condition[k] == pytest.approx(np.linalg.cond(jacobian), rel=1e-10)
        assert samples.determinant_sign[k] == np.sign(np.linalg.det(jacobian))
        assert samples.dexterity[k] * samples.condition[k] == pytest.approx(1.0)
    assert samples.length == 0.3


def test_all_of_it_may_be_singular(report_ideal: stp.Hexapod) -> None:
    # Turned by 90° about the vertical this platform is singular wherever it stands.
    yaw = rotation_from_rpy(0, 0, np.pi / 2)
    samples = stp.workspaces.sample_workspace(report_ideal, yaw, stroke=(0.9, 1.3), spacing=0.05)
    assert samples.inside.any() and samples.crosses_singularity
    assert (samples.determinant_sign[samples.inside] == 0).all()
    assert samples.dexterity[samples.inside].max() < 1e-12


def test_legs_that_never_meet_leave_nothing(report_ideal: stp.Hexapod) -> None:
    apart = stp.Hexapod(report_ideal.base_points * 20, report_ideal.platform_points)
    samples = stp.workspaces.sample_workspace(apart, LEVEL, stroke=(0.5, 1.0))
    assert samples.volume == 0.0 and samples.volume_bounds == (0.0, 0.0) and not len(samples.position)
    assert samples.pieces == 0 and not samples.crosses_singularity


def test_leg_without_length_is_singular_not_an_error() -> None:
    # Base and platform alike: at the origin all legs vanish, and a grid point lies there.
    points = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 1, 0], [-1, 1, 0]])
    same = stp.Hexapod(points, points)
    # Five cells of half a metre: exact in binary.
    samples = stp.workspaces.sample_workspace(same, LEVEL, stroke=(0.0, 1.25), sheet="both", spacing=0.5)
    (middle,) = np.flatnonzero(~samples.position.any(axis=1))
    assert np.isinf(samples.condition[middle]) and samples.inside[middle]
    # Parallel legs: a ball.
    fine = stp.workspaces.sample_workspace(same, LEVEL, stroke=(0.0, 1.25), sheet="both", spacing=0.07)
    assert abs(fine.volume - 4 / 3 * np.pi * 1.25**3) < 3 * fine.volume_error


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stroke": (1.0, 1.0)}, "least < greatest"),
        ({"stroke": (-1.0, 1.0)}, "least < greatest"),
        ({"stroke": (1.0, np.inf)}, "stroke must be finite"),
        ({"stroke": 1.0}, "stroke must have shape"),
        ({"stroke": STROKE, "sheet": "top"}, "sheet must be"),
        ({"stroke": STROKE, "spacing": 0.0}, "spacing must be"),
        ({"stroke": STROKE, "spacing": 1e-3}, "choose at least"),
        ({"stroke": STROKE, "length": -1.0}, "length must be"),
    ],
)
def test_bad_input_is_named(report_cad: stp.Hexapod, options, words) -> None:
    with pytest.raises(InputError, match=words):
        stp.workspaces.sample_workspace(report_cad, LEVEL, **options)


def test_bad_rotation_is_named(report_cad: stp.Hexapod) -> None:
    with pytest.raises(InputError, match="rotation must have shape"):
        stp.workspaces.sample_workspace(report_cad, np.stack([LEVEL, LEVEL]), stroke=STROKE)


def test_kernels_change_nothing(report_cad: stp.Hexapod) -> None:
    """Distances by compiled code: the same cells, clearances to round-off."""
    turned = rotation_from_rpy(0.1, -0.05, 0.2)
    runs = [
        stp.workspaces.sample_workspace(
            report_cad, turned, stroke=(2.20147, 2.70147), spacing=0.1, kernels=choice
        )
        for choice in (True, False)
    ]
    np.testing.assert_array_equal(runs[0].index, runs[1].index)
    np.testing.assert_allclose(runs[0].clearance, runs[1].clearance, atol=1e-14)
    np.testing.assert_array_equal(runs[0].limiting_leg, runs[1].limiting_leg)
    with pytest.raises(InputError, match="kernels must be True, False or None"):
        stp.workspaces.sample_workspace(report_cad, turned, stroke=(2.2, 2.7), kernels="yes")  # type: ignore[arg-type]


def around_home(inside: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Cells that are connected with one by their faces."""
    labels = ndimage.label(inside)[0]
    return labels == labels[tuple(cell)]


def cells_of(samples: stp.workspaces.WorkspaceSamples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of all cells of the grid, which of them are inside, and the cell of the first sample."""
    index = np.stack(np.meshgrid(*map(np.arange, samples.shape), indexing="ij"), axis=-1)
    position = samples.position[0] + samples.spacing * (index - samples.index[0])
    filled = np.zeros(samples.shape, dtype=bool)
    filled[tuple(samples.index[samples.inside].T)] = True
    return position, filled, samples.index[0]


@pytest.mark.parametrize("kernels", [None, pytest.param(False, marks=pytest.mark.slow)])
def test_the_workspace_of_a_delta_is_that_of_its_cranks(kernels: bool | None) -> None:
    """Judged by the closed form of crank angles, over the whole box."""
    chain = robot("delta")
    found = stp.workspaces.sample_workspace(chain, LEVEL, spacing=0.02, kernels=kernels)
    position, filled, begin = cells_of(found)
    legs, limits = stp.rotary.rotary_legs(chain), chain.limits.bounds("position", chain.motor_index)
    angle = stp.rotary.crank_angles(legs, position, LEVEL, throw=False).angle[..., 0]
    with np.errstate(invalid="ignore"):
        expected = ((angle >= limits[:, 0]) & (angle <= limits[:, 1])).all(axis=-1)
    assert filled.sum() > 500 and (~found.inside).sum() > 100
    np.testing.assert_array_equal(filled, around_home(expected, begin))
    at = found.inside
    read = angle[tuple(found.index.T)]
    ends = np.concatenate([read - limits[:, 0], limits[:, 1] - read], axis=1)
    np.testing.assert_allclose(found.clearance[at], found.length * ends.min(axis=1)[at], atol=1e-12)
    assert found.limits == chain.motors


def test_a_planar_platform_has_one_layer_of_cells() -> None:
    """Judged by the lengths of its legs; rates of the legs per shift and turn are those of finite differences."""
    chain = robot("rpr_planar")
    pose = stp.platform_pose(chain, chain.q_home)
    found = stp.workspaces.sample_workspace(chain, pose.rotation, spacing=0.7)
    position, filled, begin = cells_of(found)
    assert 1 in found.shape
    platform, (sign, offset) = stp.planar.planar_rpr(chain), chain.leg_readings

    def read(x: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        return sign * (stp.planar.planar_leg_lengths(platform, *platform.coordinates(x, rotation)) - offset)

    limits = chain.limits.bounds("position", chain.motor_index)
    lengths = read(position, np.broadcast_to(pose.rotation, (*position.shape, 3)))
    expected = ((lengths >= limits[:, 0]) & (lengths <= limits[:, 1])).all(axis=-1)
    np.testing.assert_array_equal(filled, around_home(expected, begin))
    k, step = int(np.flatnonzero(found.inside)[7]), 1e-6
    normal = int(np.argmin(found.shape))
    columns = []
    for axis in range(3):
        turn = pin.exp3(step * np.eye(3)[normal]) if axis == normal else np.eye(3)
        shift = np.zeros(3) if axis == normal else step * np.eye(3)[axis]
        ends = [
            read(found.position[k] + s * shift, (turn if s > 0 else turn.T) @ pose.rotation) for s in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step) / (found.length if axis == normal else 1.0))
    assert found.condition[k] == pytest.approx(np.linalg.cond(np.column_stack(columns)), rel=1e-7)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("delta", {"stroke": (0.1, 0.2)}, "stroke and sheet are for six legs"),
        ("delta", {"start": (0, 0, 9)}, "cannot be met"),
        pytest.param("delta", {"spacing": 1e-4}, "more than 200000 cells", marks=pytest.mark.slow),
        ("five_bar", {}, "does not shift along an axis of the world without turning"),
        ("stewart", {"start": (0, 0, 1)}, "start is for platforms on anything but six legs"),
    ],
)
def test_bad_input_of_any_chain_is_named(name: str, options: dict[str, Any], words: str) -> None:
    chain = robot(name)
    level = stp.platform_pose(chain, chain.q_home).rotation
    with pytest.raises(StewartPinError, match=words):
        stp.workspaces.sample_workspace(chain, level, **options)


def test_kernels_change_nothing_of_grown_workspaces() -> None:
    """Slides and hinges of a size that is not one: condition numbers are those of motor_jacobian."""
    chain = robot("tripod_3upu")
    found = stp.workspaces.sample_workspace(chain, LEVEL, spacing=0.5 * chain.length_scale, kernels=False)
    k = int(np.argmax(found.condition))
    pose = pin.SE3(LEVEL, found.position[k])
    state = stp.inverse_kinematics(chain, pose, limits=False).state
    jacobian = stp.motor_jacobian(state)[:, :3]
    assert found.condition[k] == pytest.approx(np.linalg.cond(jacobian), rel=1e-9)
    fast = stp.workspaces.sample_workspace(chain, LEVEL, spacing=0.5 * chain.length_scale)
    np.testing.assert_array_equal(fast.inside, found.inside)
    np.testing.assert_allclose(fast.condition, found.condition, rtol=1e-9)


def test_an_arm_keeps_its_elbow() -> None:
    """All cells have the elbow on the side of the first; a stretched home says none."""
    chain = robot("arm_3r_planar")
    begin = chain.at(chain.q_home + [0.3, 0.9, -0.4])
    level = begin.pose.rotation
    with pytest.raises(SingularityError, match=r"begin elsewhere \(start=\)"):
        stp.workspaces.sample_workspace(chain, stp.platform_pose(chain, chain.q_home).rotation, spacing=0.1)
    found = stp.workspaces.sample_workspace(chain, level, spacing=0.1, start=begin.pose.translation)
    signs = np.unique(found.determinant_sign[found.inside])
    assert len(found.position) > 100 and np.count_nonzero(signs) == 1


@pytest.mark.slow
def test_clearances_of_slides_are_lengths(tmp_path: Path) -> None:
    """A gantry whose ranges make its size exactly one metre: a slide's coordinate is no angle."""
    text, parent = '<robot name="gantry"><link name="base"/>', "base"
    for name, axis, reach in (("x", "1 0 0", 1.0), ("y", "0 1 0", 0.5), ("platform", "0 0 1", 0.5)):
        text += (
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" '
            f'iyz="0"/></inertial></link><joint name="{name}_slide" type="prismatic" independent="true">'
            f'<parent link="{parent}"/><child link="{name}"/><axis xyz="{axis}"/>'
            f'<limit lower="-{reach}" upper="{reach}" effort="9" velocity="9"/></joint>'
        )
        parent = name
    path = tmp_path / "gantry.urdf"
    path.write_text(text + "</robot>")
    chain = stp.load(path)
    assert chain.length_scale == 1.0
    found = stp.workspaces.sample_workspace(chain, LEVEL, spacing=0.1, length=0.1)
    assert found.clearance.max() == pytest.approx(0.5) and found.condition.max() == pytest.approx(1.0)
    assert np.count_nonzero(found.inside) == 21 * 11 * 11
