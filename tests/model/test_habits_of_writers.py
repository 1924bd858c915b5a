"""Files as other programs write them: what their own readers take is taken here, and means the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError
from stewart_pin.model.formats.reading import read_urdf
from tests.small_urdf import ARM, MOTOR, robot, write

BODY = '<inertial><mass value="{mass}"/><inertia ixx="{i}" ixy="0" ixz="{xz}" iyy="{i}" iyz="0" izz="{i}"/></inertial>'
LEAF = (
    '<link name="tip">{body}</link><joint name="tip_joint" type="{kind}"><parent link="platform"/>'
    '<child link="tip"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)


def leaf(mass: float, i: float, xz: str = "0", kind: str = "fixed") -> str:
    return LEAF.format(body=BODY.format(mass=mass, i=i, xz=xz), kind=kind)


@pytest.mark.parametrize("note", ["<!-- ----- arm ----- -->", "<!--- arm --->", "<!-- a\n--\nb -->"])
def test_comments_may_hold_dashes_and_lines_keep_their_numbers(tmp_path: Path, note: str) -> None:
    assert stp.load(write(tmp_path, robot(*ARM, note))).nv == 2
    broken = robot(note, "<link/>", *ARM)
    line = broken[: broken.index("<link/>")].count("\n") + 1
    with pytest.raises(FileFormatError, match=f"line {line}"):
        stp.load(write(tmp_path, broken))


def test_a_comment_cannot_hide_a_document_type(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError):
        stp.load(write(tmp_path, "<!DOC<!-- -->TYPE r [<!ENTITY a 'b'>]>" + robot(*ARM)))


def test_inertia_of_round_off_is_none(tmp_path: Path) -> None:
    assert stp.load(write(tmp_path, robot(*ARM, leaf(1, 0, "2.4e-35")))).nv == 2
    with pytest.raises(MechanismError, match="negative principal moment"):
        stp.load(write(tmp_path, robot(*ARM, leaf(1, 0, "1e-9"))))


def test_inertia_without_mass_counts_where_it_is_fixed_to_a_body(tmp_path: Path) -> None:
    chain, bare = (stp.load(write(tmp_path, robot(*ARM, *more))) for more in ((leaf(0, 0.1),), ()))
    rest = np.zeros(2)
    moved = [stp.inverse_dynamics(c, c.q_home, rest, np.ones(2)).tau_motor for c in (chain, bare)]
    assert not np.allclose(*moved)
    path = write(tmp_path, robot(*ARM, leaf(0, 0.1, kind="revolute")))
    with pytest.raises(MechanismError, match=r"inertia but no mass.*odd_inertias=False"):
        stp.load(path, odd_inertias=False)
    # A rotor that turns in place needs no mass: every formulation takes it as it is.
    rotor = stp.load(path, motors=["shoulder", "elbow", "tip_joint"])
    assert "it has inertia but no mass; check its digits" in str(rotor.report)
    v, a = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 4.0])
    effort = stp.inverse_dynamics(rotor, rotor.q_home, v, a).tau_motor
    proof = stp.inverse_dynamics(rotor, rotor.q_home, v, a, method="constraint_matrix").tau_motor
    np.testing.assert_allclose(effort, proof, rtol=1e-12)
    moved = stp.forward_dynamics(rotor, rotor.q_home, v, effort).a
    recursion = stp.articulated_body_acceleration(rotor, rotor.q_home, v, effort)
    np.testing.assert_allclose([moved, recursion], [a, a], rtol=1e-10)


def test_both_halves_of_an_inertia(tmp_path: Path) -> None:
    both = leaf(1, 1).replace('ixy="0"', 'ixy="0.1" iyx="{}"')
    assert stp.load(write(tmp_path, robot(*ARM, both.format("0.1")))).nv == 2
    with pytest.raises(FileFormatError, match=r"ixy and iyx .* differ"):
        stp.load(write(tmp_path, robot(*ARM, both.format("-0.1"))))


def test_an_inertia_may_name_the_entries_below_its_diagonal(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM, leaf(1, 1, "0.2").replace("ixz=", "izx="))))
    body = chain.mechanism.link("tip").inertia
    assert body is not None and body.inertia[0, 2] == body.inertia[2, 0] == 0.2
    assert "izx of <inertia>: read as ixz (link 'tip')" in str(chain.report)
    with pytest.raises(FileFormatError, match="lacks 'ixz'"):
        stp.load(write(tmp_path, robot(*ARM, leaf(1, 1).replace('ixz="0" ', ""))))


def test_words_of_newer_versions_of_urdf(tmp_path: Path) -> None:
    """Of 1.1 quaternions, of 1.2 limits of acceleration and jerk."""
    text = robot(*ARM, attributes='version="1.2"').replace(
        'xyz="1 0 0"/>',
        'xyz="1 0 0" quat_xyzw="0 0 2 2"/><limit acceleration="5" deceleration="4" jerk="7"/>',
    )
    chain = stp.load(write(tmp_path, text))
    (elbow,) = (joint for joint in chain.mechanism.joints if joint.name == "elbow")
    np.testing.assert_allclose(elbow.placement.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    at = chain.limits.names.index("elbow")
    np.testing.assert_array_equal(chain.limits.acceleration[at], [-4, 4])
    np.testing.assert_array_equal(chain.limits.jerk[at], [-7, 7])
    assert "deceleration>: accelerations are limited alike to both sides, to 4" in str(chain.report)
    with pytest.raises(FileFormatError, match=r"quat_xyzw> .* stands beside rpy"):
        stp.load(write(tmp_path, text.replace("quat_xyzw=", 'rpy="0 0 1" quat_xyzw=')))
    with pytest.raises(FileFormatError, match=r"quat_xyzw> .* is of length zero"):
        stp.load(write(tmp_path, text.replace("0 0 2 2", "0 0 0 0")))


@pytest.mark.parametrize("version", ["1.0", "1.1", "1.2"])
def test_an_unknown_version_of_urdf_is_told(tmp_path: Path, version: str) -> None:
    assert "version" not in str(
        stp.load(write(tmp_path, robot(*ARM, attributes=f'version="{version}"'))).report
    )
    other = robot(*ARM, attributes=f'version="{version}.1"')
    assert f"version '{version}.1': read as 1.2, the newest" in str(stp.load(write(tmp_path, other)).report)


@pytest.mark.parametrize("interface", ["PassiveJointInterface", "hardware_interface/PassiveJointInterface"])
def test_a_passive_transmission_drives_nothing(tmp_path: Path, interface: str) -> None:
    kinds = {"shoulder": "EffortJointInterface", "elbow": interface}
    tags = [
        f'<transmission name="t_{n}"><joint name="{n}"><hardwareInterface>{k}</hardwareInterface>'
        "</joint></transmission>"
        for n, k in kinds.items()
    ]
    chain = stp.load(write(tmp_path, robot(*(part.replace(MOTOR, "") for part in ARM), *tags)))
    assert chain.motors == ("shoulder",)
    assert "passive joints, no motors" in str(chain.report)


@pytest.mark.parametrize("where", ["", ' reference="platform"'])
def test_a_detachable_joint_is_not_dropped(tmp_path: Path, where: str) -> None:
    plugin = '<plugin filename="gz-sim-detachable-joint-system" name="gz::sim::systems::DetachableJoint"/>'
    with pytest.raises(FileFormatError, match="DetachableJoint"):
        stp.load(write(tmp_path, robot(*ARM, f"<gazebo{where}>{plugin}</gazebo>")))


def test_constraints_of_the_fork_are_called_joints(tmp_path: Path) -> None:
    closing = (
        '<constraint name="end" type="{}"><parent link="base"/><child link="platform"/><parent_axis xyz="0 0 1"/>'
        '<child_axis xyz="0 0 1"/></constraint>'
    )
    for kind in ("spherical", "revolute", "fixed"):
        one, other = (
            read_urdf(write(tmp_path, robot(*ARM, closing.format(word)))) for word in (kind, f"{kind}_joint")
        )
        assert one.loops[0].kind == other.loops[0].kind


def test_an_axis_in_the_model_frame_is_turned_into_the_joint(tmp_path: Path) -> None:
    turned = (
        '<gazebo><joint name="end" type="revolute"><parent>base</parent><child>platform</child>'
        "<pose>0 0 0 0.3 0.4 0.5</pose><axis><xyz>0 0 1</xyz>"
        "<use_parent_model_frame>{}</use_parent_model_frame></axis></joint></gazebo>"
    )
    model, own = (read_urdf(write(tmp_path, robot(*ARM, turned.format(k)))).loops[0] for k in (1, 0))
    np.testing.assert_allclose(own.axis, [0, 0, 1], atol=1e-15)
    # The parent is the root: its side of the loop turns the axis back into the model's frame.
    np.testing.assert_allclose(model.placement1.rotation @ model.axis, [0, 0, 1], atol=1e-15)


@pytest.mark.parametrize(
    "tags",
    ["<limit><effort/></limit>", "<limit><velocity> </velocity></limit>", "<dynamics><damping/></dynamics>"],
)
def test_an_empty_element_of_sdformat_is_an_absent_one(tmp_path: Path, tags: str) -> None:
    path = tmp_path / "arm.sdf"
    path.write_text(
        '<sdf version="1.9"><model name="arm"><link name="platform"><inertial><mass>1</mass></inertial></link>'
        '<joint name="hinge" type="revolute"><parent>world</parent><child>platform</child>'
        f"<axis><xyz>0 1 0</xyz>{tags}</axis></joint></model></sdf>"
    )
    assert stp.load(path, motors=["hinge"]).nv == 1
