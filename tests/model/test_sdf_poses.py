"""Where links, joints, axes and frames of SDFormat stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stewart_pin.errors import FileFormatError, StewartPinError
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.sdf import read_sdf
from tests.model.sdf_reading import position, read, standing
from tests.small_sdf import BODY, HOLD, TWO, frame, joint, link, sdf, write


def test_links_stand_in_the_model_and_the_model_in_the_world(tmp_path: Path) -> None:
    quarter = f"0 0 0 0 0 {np.pi / 2!r}"
    mechanism = read(tmp_path, f"<pose>10{quarter[1:]}</pose>", link("a", "1 2 3 0 0 0"))
    np.testing.assert_array_equal(position(mechanism, "a"), [8, 1, 3])
    (free,) = mechanism.joints
    assert (free.kind, free.parent, free.child) == (JointKind.FLOATING, "world", "a")


def test_a_joint_stands_in_its_child_link(tmp_path: Path) -> None:
    """The hinge is 1 m to the left of the link: a quarter turn brings the link from x = 3 to (2, 1)."""
    mechanism = read(
        tmp_path,
        link("a"),
        link("b", "3 0 0 0 0 0"),
        HOLD,
        joint("j", "a", "b", pose="-1 0 0 0 0 0"),
    )
    np.testing.assert_array_equal(position(mechanism, "b"), [3, 0, 0])
    np.testing.assert_array_equal(position(mechanism, "b", j=np.pi / 2), [2, 1, 0])


def test_a_pose_relative_to_another_frame(tmp_path: Path) -> None:
    """The hinge stands 1 m above the parent link: half a turn about y brings (3, 0, 0) to (-3, 0, 2)."""
    mechanism = read(
        tmp_path,
        link("a"),
        link("b", "3 0 0 0 0 0"),
        HOLD,
        joint("j", "a", "b", pose="0 0 1 0 0 0", relative_to="a", xyz="0 1 0"),
    )
    np.testing.assert_array_equal(position(mechanism, "b", j=np.pi), [-3, 0, 2])


@pytest.mark.parametrize(
    ("version", "axis", "expressed_in", "expected"),
    [
        # The child is turned by a quarter turn about z: its x axis is the model's y axis.
        ("1.4", "", "", [1, 0, 0]),
        ("1.6", "", "", [0, 1, 0]),
        ("1.6", "<use_parent_model_frame>true</use_parent_model_frame>", "", [1, 0, 0]),
        ("1.6", "<use_parent_model_frame>0</use_parent_model_frame>", "", [0, 1, 0]),
        ("1.7", "", "", [0, 1, 0]),
        ("1.7", "", "__model__", [1, 0, 0]),
        ("1.7", "", "a", [0, 0, 1]),
    ],
)
def test_where_an_axis_points(
    tmp_path: Path, version: str, axis: str, expressed_in: str, expected: list
) -> None:
    mechanism = read(
        tmp_path,
        link("a", f"0 0 0 0 {-np.pi / 2!r} 0"),  # its x axis is the model's z axis
        link("b", f"0 0 0 0 0 {np.pi / 2!r}"),
        HOLD,
        joint("j", "a", "b", "prismatic", xyz="1 0 0", axis=axis, expressed_in=expressed_in),
        version=version,
    )
    np.testing.assert_array_equal(position(mechanism, "b", j=1.0), expected)


def test_a_hinge_turned_in_its_link_has_another_axis(tmp_path: Path) -> None:
    """The hinge's z axis, turned by a quarter turn about x, is the link's -y axis; a slide may stand anywhere."""
    turned = f"0 0 0 {np.pi / 2!r} 0 0"
    mechanism = read(
        tmp_path,
        link("a"),
        link("b", "0 0 1 0 0 0"),
        link("c", "0 0 2 0 0 0"),
        HOLD,
        joint("j", "a", "b", pose=turned),
        joint("k", "a", "c", "prismatic", pose="5 6 7" + turned[5:]),
    )
    np.testing.assert_allclose(mechanism.joint("j").axis, [0, -1, 0], atol=1e-15)
    np.testing.assert_array_equal(position(mechanism, "c", k=0.5), [0, -0.5, 2])
    assert len(mechanism.links) == 4


def test_angles_in_degrees_and_quaternions(tmp_path: Path) -> None:
    """A third of a turn about (1, 1, 1) takes x to y; 90 degrees about z does as well."""
    poses = {
        "a": '<pose rotation_format="quat_xyzw">0 0 0 2 2 2 2</pose>',
        "b": '<pose degrees="true">0 0 0 0 0 90</pose>',
    }
    here = standing(read(tmp_path, *(f'<link name="{name}">{pose}</link>' for name, pose in poses.items())))
    for name in poses:
        np.testing.assert_allclose(here[name].rotation[:, 0], [0, 1, 0], atol=1e-15)


def test_quaternions_that_joints_read_are_scaled_where_their_digits_explain_their_length(
    tmp_path: Path,
) -> None:
    def joints(value: str, free: str) -> tuple[str, ...]:
        ball = joint("j", "a", "b", "ball", xyz="")
        ball = ball.replace(' type="ball"', f' type="ball" stewart_pin:position="{value}"')
        floating = link("c").replace('name="c"', f'name="c" stewart_pin:position="{free}"')
        return (*TWO, HOLD, ball, floating)

    names = 'xmlns:stewart_pin="urn:stewart_pin"'
    mechanism = read(tmp_path, *joints("0 0.48 0.52 0.71", "1 2 3 0 0 0.7 0.7"), attributes=names)
    told = [note.subject for note in mechanism.notes if "scaled to length one, as its digits" in note.text]
    assert told == ["link 'c'", "joint 'j'"]
    size = float(np.linalg.norm([0.48, 0.52, 0.71]))
    np.testing.assert_allclose(mechanism.home["j"], [0, 0.48 / size, 0.52 / size, 0.71 / size], atol=1e-15)
    for values, owner in ((("0 0 3 4", "0 0 0 0 0 0 1"), "joint 'j'"), (("0 0 0 1", "0 0 0 0 0 0 0"), "'c'")):
        with pytest.raises(
            FileFormatError, match=rf"{owner}: stewart_pin:position: the quaternion .* length"
        ):
            read(tmp_path, *joints(*values), attributes=names)


def test_the_pose_of_a_model_may_be_that_of_a_frame_in_it(tmp_path: Path) -> None:
    """The tip, 1 m beside the link, is placed at (5, 0, 0), turned half round: the link is at (6, 0, 0)."""
    mechanism = read(
        tmp_path,
        f"<pose>5 0 0 0 0 {np.pi!r}</pose>",
        link("a"),
        frame("tip", "1 0 0 0 0 0", attached_to="a"),
        attributes='placement_frame="tip"',
    )
    np.testing.assert_array_equal(position(mechanism, "a"), [6, 0, 0])
    np.testing.assert_array_equal(position(mechanism, "tip"), [5, 0, 0])


@pytest.mark.parametrize(("attributes", "carrier"), [("", "a"), ('canonical_link="b"', "b")])
def test_the_frame_of_the_model_goes_with_its_canonical_link(
    tmp_path: Path, attributes: str, carrier: str
) -> None:
    mechanism = read(
        tmp_path, link("a"), link("b", "0 0 1 0 0 0"), frame("f", "1 2 3 0 0 0"), attributes=attributes
    )
    assert mechanism.joint("f_frame").parent == carrier
    np.testing.assert_array_equal(position(mechanism, "f"), [1, 2, 3])


def test_an_inertia_may_name_the_entries_below_its_diagonal(tmp_path: Path) -> None:
    below, above = (
        read(tmp_path, link("a", content=text)).link("a").inertia
        for text in (BODY.replace("ixz", "izx"), BODY)
    )
    assert below is not None and above is not None
    np.testing.assert_array_equal(below.inertia, above.inertia)
    with pytest.raises(FileFormatError, match=r"ixy and iyx of <inertia> .* differ"):
        read(tmp_path, link("a", content=BODY.replace("<ixy>", "<iyx>0.3</iyx><ixy>")))


def test_frames_may_be_the_platform(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path,
        link("a", "0 0 1 0 0 0"),
        joint("j", "world", "a"),
        frame("tool", "0.5 0 0 0 0 0", attached_to="a"),
        frame("platform", "0 0 0.25 0 0 0", attached_to="tool"),
    )
    assert mechanism.platform == "platform"
    np.testing.assert_array_equal(position(mechanism, "platform", j=np.pi / 2), [0, 0.5, 1.25])


def test_inertia_is_about_the_centre_of_mass_in_turned_axes(tmp_path: Path) -> None:
    (body,) = [x for x in read(tmp_path, link("a")).links if x.name == "a"]
    assert body.inertia is not None and body.inertia.mass == 2
    np.testing.assert_array_equal(body.inertia.lever, [0.1, -0.2, 0.3])
    turned = pin.rpy.rpyToMatrix(0.2, -0.1, 0.4)
    matrix = np.array([[0.5, 0.01, -0.02], [0.01, 0.6, 0.03], [-0.02, 0.03, 0.7]])
    np.testing.assert_allclose(body.inertia.inertia, turned @ matrix @ turned.T, atol=1e-15)


def test_links_keep_their_frames_by_a_link_without_inertia(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path, link("a"), link("b", "3 0 0 0 0 0"), HOLD, joint("j", "a", "b", pose="-1 0 0 0 0 0")
    )
    assert [x.name for x in mechanism.links] == ["world", "a", "b", "b_at_j"]
    assert mechanism.link("b_at_j").inertia is None
    assert mechanism.joint("j").child == "b_at_j" and mechanism.joint("b_at_j_fixed").child == "b"


def test_long_chains_of_frames_are_followed(tmp_path: Path) -> None:
    """Five thousand frames, each in the one before: no recursion, no quadratic time."""
    frames = [frame(f"f{k}", "0.001 0 0 0 0 0", attached_to=f"f{k - 1}" if k else "a") for k in range(5000)]
    mechanism = read_sdf(write(tmp_path, sdf(link("a"), *frames)))
    mounts = {x.name: x for x in mechanism.joints}
    np.testing.assert_allclose(mounts["f4999_frame"].placement.translation, [5, 0, 0], atol=1e-9)
    assert mounts["f4999_frame"].parent == "a"
    with pytest.raises(StewartPinError, match="circle"):
        read_sdf(write(tmp_path, sdf(link("a"), *frames, frame("f", attached_to="f"))))
