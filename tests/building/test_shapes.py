"""Shapes of links: what is read in one format is written in the others, or the report says what was left out."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Link, Outcome, Report
from stewart_pin.model.formats.dialect import dialects
from stewart_pin.model.shapes import Material, MaterialNames, Shape, ShapeKind, rounded_as_three
from tests.small_sdf import BODY, sdf
from tests.small_sdf import joint as sdf_joint
from tests.small_urdf import ARM, INERTIAL, bundled, joint, link, robot, write

DIALECTS = [dialect.name for dialect in dialects() if dialect.write is not None]
PLACED = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/>'
STL = struct.pack("<80sI", b"", 2) + b"".join(
    struct.pack("<12fH", 0, 0, 1, 0, 0, z, 1, 0, z, 0, 1, z, 0) for z in (0, 1)
)
SHAPES = (
    f'<visual name="front">{PLACED}<geometry><box size="0.1 0.2 0.3"/></geometry>'
    '<material name="steel"/></visual>'
    '<visual><geometry><cylinder radius="0.1" length="0.4"/></geometry>'
    '<material name="steel"/></visual>'
    '<visual><geometry><sphere radius="0.2"/></geometry><material name="red">'
    '<color rgba="1 0 0 0.5"/></material></visual>'
    f'<visual>{PLACED}<geometry><mesh filename="meshes/a.stl" scale="0.001 0.002 0.003"/></geometry></visual>'
    '<collision name="hull"><geometry><box size="1 2 3"/></geometry></collision>'
)
STEEL = '<material name="steel"><color rgba="0.25 0.5 0.75 1"/></material>'


def dressed(folder: Path, shapes: str = SHAPES, *parts: str) -> stp.ClosedChain:
    """Read an arm whose tool has shapes; its mesh lies in a folder of its own."""
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes" / "a.stl").write_bytes(STL)
    tool = (link("tool", INERTIAL + shapes), joint("glue", "arm", "tool", "fixed"))
    return stp.load(write(folder, robot(*ARM, *tool, STEEL, *parts)))


def assert_shapes(theirs: Sequence[Shape], mine: Sequence[Shape]) -> None:
    assert [shape.kind for shape in theirs] == [shape.kind for shape in mine]
    for their, shape in zip(theirs, mine, strict=True):
        np.testing.assert_allclose(their.sizes, shape.sizes, rtol=1e-15)
        # Roll, pitch and yaw, or a quaternion, give the matrix back to round-off.
        np.testing.assert_allclose(their.placement.homogeneous, shape.placement.homogeneous, atol=1e-15)
        assert their.name == shape.name
        if shape.mesh:
            assert Path(their.folder, their.mesh).resolve() == Path(shape.folder, shape.mesh).resolve()
        assert _look(their) == _look(shape)


def _look(shape: Shape) -> tuple:
    rgba = None if shape.material is None else shape.material.rgba
    name = "" if shape.material is None else shape.material.name
    # MuJoCo holds colours with seven digits.
    return name, None if rgba is None else tuple(np.array(rgba, dtype=np.float32))


def test_urdf_is_read_as_it_stands(tmp_path: Path) -> None:
    tool = dressed(tmp_path).mechanism.link("tool")
    box, cylinder, ball, mesh = tool.visuals
    assert (box.kind, box.sizes, box.name) == (ShapeKind.BOX, (0.1, 0.2, 0.3), "front")
    np.testing.assert_array_equal(box.placement.translation, [0.1, -0.2, 0.3])
    assert box.material == cylinder.material == Material("steel", (0.25, 0.5, 0.75, 1.0))
    assert (cylinder.sizes, ball.sizes) == ((0.1, 0.4), (0.2,))
    assert ball.material == Material("red", (1.0, 0.0, 0.0, 0.5))
    assert (mesh.kind, mesh.mesh, mesh.sizes) == (ShapeKind.MESH, "meshes/a.stl", (0.001, 0.002, 0.003))
    assert Path(mesh.folder, mesh.mesh).is_file() and mesh.material is None
    assert [shape.name for shape in tool.collisions] == ["hull"]


@pytest.mark.parametrize("format", DIALECTS)
def test_urdf_there_and_back(format: str, tmp_path: Path) -> None:
    chain = dressed(tmp_path)
    (tmp_path / "out").mkdir()
    path = tmp_path / "out" / "again.urdf"
    report = stp.export(chain, path, format=format)
    assert report.notes == ()
    mine, theirs = chain.mechanism.link("tool"), stp.load(path).mechanism.link("tool")
    assert_shapes(theirs.visuals, mine.visuals)
    assert_shapes(theirs.collisions, mine.collisions)
    assert theirs.visuals[3].mesh == "../meshes/a.stl"
    # Another reader finds the shapes, and the mesh as well.
    text = path.read_text()
    if format != "drake":
        model = pin.buildModelFromXML(text)
        with warnings.catch_warnings(action="ignore"):  # of the library that opens meshes
            seen = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.VISUAL, str(path.parent))
        assert seen.ngeoms == len(mine.visuals)


def test_mjcf_there_and_back(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    chain = dressed(tmp_path)
    (tmp_path / "out").mkdir()
    path = tmp_path / "out" / "again.xml"
    stp.export(chain, path, format="mjcf")
    mine, theirs = chain.mechanism.link("tool"), stp.load(path).mechanism.link("tool")
    assert_shapes(theirs.visuals, mine.visuals)
    assert_shapes(theirs.collisions, mine.collisions)
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.ngeom == 5 and model.nmesh == 1
    # A mechanism has no contacts, so its file must not have any.
    assert not model.geom_contype.any() and not model.geom_conaffinity.any()
    np.testing.assert_allclose(model.body("tool").mass, 1.0)


def test_mjcf_is_read_as_mujoco_means_it(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = """<mujoco><compiler meshdir="meshes" angle="degree"/>
      <asset><material name="paint" rgba="0.1 0.2 0.3 1"/><mesh name="m" file="none.stl" scale="2 2 2"/></asset>
      <default><geom group="1"/></default>
      <worldbody><geom type="plane" size="1 1 1"/><body name="platform"><joint name="j"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <geom type="capsule" size="0.1" fromto="0 0 0 1 0 0" material="paint"/>
        <geom type="ellipsoid" size="0.1 0.2 0.3" group="3" euler="0 0 90"/>
        <geom name="shown" type="mesh" mesh="m" contype="0" conaffinity="0"/>
        <geom size="0.1" group="4" contype="0" conaffinity="0"/>
      </body></worldbody><actuator><motor joint="j"/></actuator></mujoco>"""
    (tmp_path / "a.xml").write_text(text)
    chain = stp.load(tmp_path / "a.xml")
    link = chain.mechanism.link("platform")
    assert [shape.kind for shape in link.visuals] == [ShapeKind.CAPSULE, ShapeKind.MESH]
    assert [shape.kind for shape in link.collisions] == [ShapeKind.CAPSULE, ShapeKind.ELLIPSOID]
    capsule, mesh = link.visuals
    np.testing.assert_allclose(capsule.sizes, (0.1, 1.0), rtol=1e-15)
    np.testing.assert_allclose(np.abs(capsule.placement.rotation[:, 2]), [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(capsule.placement.translation, [0.5, 0, 0], atol=1e-15)
    assert capsule.material is not None and capsule.material.name == "paint"
    assert (mesh.mesh, mesh.name, mesh.sizes) == ("none.stl", "shown", (2.0, 2.0, 2.0))
    assert mesh.folder == str(tmp_path / "meshes")
    report = str(chain.report)
    assert "a plane is no shape of ours" in report and "of group 4: neither seen nor touched" in report
    # What URDF has no word for is said.
    told = str(stp.export(chain, tmp_path / "a.urdf"))
    assert "collision: URDF has no ellipsoids; left out (link 'platform')" in told
    assert "visual: URDF has no capsules; written as a cylinder and two balls (link 'platform')" in told
    again = stp.load(tmp_path / "a.urdf").mechanism.link("platform")
    assert_shapes(again.visuals[:3], rounded_as_three(capsule))
    # The mesh is not there, and MuJoCo would refuse the whole file.
    assert "visual: left out: MuJoCo would refuse the file" in str(
        stp.export(chain, tmp_path / "b.xml", format="mjcf")
    )


def test_meshes_that_mujoco_would_refuse_are_left_out(tmp_path: Path) -> None:
    chain = dressed(tmp_path)
    (tmp_path / "meshes" / "a.stl").write_text("solid s\nendsolid s\n")
    assert "only binary STL" in str(stp.export(chain, tmp_path / "a.xml", format="mjcf"))
    assert len(stp.load(tmp_path / "a.xml").mechanism.link("tool").visuals) == 3
    other = '<visual><geometry><mesh filename="a.dae"/></geometry></visual>'
    (tmp_path / "a.dae").write_text("")
    chain = dressed(tmp_path, other)
    assert "no meshes of type '.dae'" in str(stp.export(chain, tmp_path / "a.xml", format="mjcf"))


def test_three_surfaces_are_a_capsule() -> None:
    stem, low, high = rounded_as_three(
        Shape(ShapeKind.CAPSULE, (0.1, 0.6), pin.SE3(pin.exp3(np.array([0.3, 0, 0])), np.ones(3)), "rod")
    )
    assert (stem.sizes, low.sizes, high.sizes) == ((0.1, 0.6), (0.1,), (0.1,))
    ends = high.placement.translation - low.placement.translation
    np.testing.assert_allclose(ends, 0.6 * stem.placement.rotation[:, 2], atol=1e-15)
    assert (stem.name, low.name) == ("rod_1", "rod_2")


SDF_SHAPES = (
    '<visual name="v"><pose>0.1 0.2 0.3 0.4 0.5 0.6</pose><geometry><box><size>1 2 3</size></box></geometry>'
    "<material><ambient>1 1 1 1</ambient><diffuse>0.1 0.2 0.3 0.4</diffuse></material></visual>"
    '<visual name="w"><geometry><mesh><uri>model://arm/a.dae</uri><scale>2 2 2</scale></mesh></geometry></visual>'
    '<visual name="x"><geometry><ellipsoid><radii>1 2 3</radii></ellipsoid></geometry></visual>'
    '<visual name="y"><geometry><plane><normal>0 0 1</normal></plane></geometry></visual>'
    '<collision name="c"><geometry><cylinder><radius>0.1</radius><length>0.4</length></cylinder></geometry></collision>'
    '<collision name="d"><geometry><capsule><radius>0.1</radius><length>0.4</length></capsule></geometry></collision>'
)


def test_sdf_is_read_and_goes_on(tmp_path: Path) -> None:
    hinge = sdf_joint("j", "world", "platform")
    (tmp_path / "a.sdf").write_text(sdf(f'<link name="platform">{BODY}{SDF_SHAPES}</link>', hinge))
    chain = stp.load(tmp_path / "a.sdf", motors=["j"])
    link = chain.mechanism.link("platform")
    assert [shape.name for shape in link.visuals] == ["v", "w", "x"]
    assert [(shape.kind, shape.sizes) for shape in link.collisions] == [
        (ShapeKind.CYLINDER, (0.1, 0.4)),
        (ShapeKind.CAPSULE, (0.1, 0.4)),
    ]
    assert link.visuals[0].material == Material(rgba=(0.1, 0.2, 0.3, 0.4))
    assert "<visual>: left out, shapes of type <plane> are not understood" in str(chain.report)
    assert "no ellipsoids" in str(stp.write_urdf(chain, tmp_path / "a.urdf"))
    again = stp.load(tmp_path / "a.urdf").mechanism.link("platform")
    assert [shape.name for shape in again.visuals] == ["v", "w"]
    assert again.visuals[1].mesh == "model://arm/a.dae"
    material = again.visuals[0].material
    assert material is not None and material.rgba == (0.1, 0.2, 0.3, 0.4)


BAD = {
    "no shape": ("<geometry/>", "its <geometry> holds 0 shapes"),
    "two shapes": ('<geometry><sphere radius="1"/><sphere radius="1"/></geometry>', "holds 2 shapes"),
    "an unknown one": ("<geometry><torus/></geometry>", "shapes of type <torus> are not understood"),
    "no number": (
        '<geometry><sphere radius="big"/></geometry>',
        "must hold one number, got 'big'|must hold numbers",
    ),
    "no size": ('<geometry><box size="1 0 1"/></geometry>', "a size of its box is not above zero"),
    "no scale": ('<geometry><mesh filename="a" scale="1 1 0"/></geometry>', "a scale is zero"),
    "no file": ("<geometry><mesh/></geometry>", "lacks 'filename'"),
    "a bad colour": (
        '<geometry><sphere radius="1"/></geometry><material name="x"><color rgba="1 1"/></material>',
        "must hold 4 numbers",
    ),
}


@pytest.mark.parametrize(("content", "words"), BAD.values(), ids=BAD)
def test_a_shape_that_cannot_be_read_is_noted(content: str, words: str, tmp_path: Path) -> None:
    chain = dressed(tmp_path, f"<visual>{content}</visual>")
    assert chain.mechanism.link("tool").visuals == ()
    (note,) = [note for note in chain.report.notes if note.subject == "link 'tool'"]
    assert note.outcome is Outcome.IGNORED and str(tmp_path) not in note.text
    assert any(word in note.text for word in words.split("|")), note.text


def test_a_shape_may_not_hide_a_loop(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="could close a loop"):
        dressed(tmp_path, '<visual><geometry><sphere radius="1"/></geometry><constraint/></visual>')


def test_materials_of_one_name_are_told_apart() -> None:
    names = MaterialNames()
    red, blue = Material("paint", (1.0, 0.0, 0.0, 1.0)), Material("paint", (0.0, 0.0, 1.0, 1.0))
    assert [names.name(each) for each in (red, blue, red, Material(rgba=red.rgba))] == [
        "paint", "paint_2", "paint", "material",
    ]  # fmt: skip


def test_links_that_vanish_in_mjcf_are_named(tmp_path: Path) -> None:
    """The crosses of a hexapod's legs have no mass: what they look like cannot be told to MuJoCo."""
    text = bundled("stewart").read_text()
    assert '<link name="leg1_cross"/>' in text
    ball = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    text = text.replace('<link name="leg1_cross"/>', f'<link name="leg1_cross">{ball}</link>')
    report = stp.export(stp.load(write(tmp_path, text)), tmp_path / "a.xml", format="mjcf")
    assert isinstance(report, Report)
    said = [note.text for note in report.notes if note.subject == "link 'leg1_cross'"]
    assert len(said) == 2 and said[1].startswith("visual: left out, for the link has no mass")


def test_shapes_stay_when_a_chain_is_changed(tmp_path: Path) -> None:
    chain = dressed(tmp_path)
    for other in (
        stp.massless_legs(stp.with_platform(chain, "tool")),
        stp.attach_payload(chain, pin.Inertia(1.0, np.zeros(3), np.eye(3))),
        stp.on_floating_base(chain, pin.Inertia(1.0, np.zeros(3), np.eye(3))),
    ):
        assert isinstance(other.mechanism.link("tool"), Link)
        assert len(other.mechanism.link("tool").visuals) == 4
