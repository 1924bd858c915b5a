"""Scenes of robots: visuals of the file where the chain puts its links, simple shapes elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, FileMissingError
from tests.closed_states import NAMES, random_configuration, robot
from tests.mechanisms import arm, two_bodies
from tests.small_urdf import write

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("yourdfpy")

BOX = """<visual><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.1 0.1"/></geometry>
<material name="red"><color rgba="1 0 0 1"/></material></visual>"""
MESH = '<visual><geometry><mesh filename="{}" scale="0.001 0.001 0.001"/></geometry></visual>'


def slider(visual: str) -> str:
    """Carry a ball-jointed bar with a visual on a slide."""
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    return f"""<robot name="slider"><link name="ground"/><link name="cart">{inertial}</link>
    <link name="platform">{inertial}{visual}</link>
    <joint name="rail" type="prismatic" independent="true"><parent link="ground"/><child link="cart"/>
      <axis xyz="0 0 1"/></joint>
    <joint name="ball" type="spherical"><parent link="cart"/><child link="platform"/></joint></robot>"""


def world_bounds(scene, node: str) -> np.ndarray:
    placement, name = scene.graph[node]
    corners = scene.geometry[name].vertices @ placement[:3, :3].T + placement[:3, 3]
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def test_every_link_stands_where_the_chain_puts_it(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    scene = stp.viz.build_scene(chain, q)
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    for link in chain.mechanism.links:
        expected = data.oMf[chain.model.getFrameId(link.name, pin.FrameType.BODY)].homogeneous
        np.testing.assert_allclose(scene.graph[link.name][0], expected, atol=1e-14)
    # The rods of both ends of a leg touch its points: base and platform lie within half a thickness.
    base, platform = chain.leg_points()
    pose = stp.platform_pose(chain, q)
    ends = np.vstack([base, [pose.act(point) for point in platform]])
    assert (ends >= scene.bounds[0] - 1e-9).all() and (ends <= scene.bounds[1] + 1e-9).all()


def test_a_slide_reaches_back_to_its_parent() -> None:
    chain = robot("stewart")
    scene = stp.viz.build_scene(chain)
    base, _ = chain.leg_points()
    nodes = [n for n in scene.graph.nodes_geometry if scene.graph.transforms.parents[n] == "leg1_upper"]
    vertices = []
    for node in nodes:
        placement, name = scene.graph[node]
        vertices.append(scene.geometry[name].vertices @ placement[:3, :3].T + placement[:3, 3])
    # One end of the thin rod stands on the base point: its rim is a fifth of the thickness away.
    nearest = np.linalg.norm(np.vstack(vertices) - base[0], axis=1).min()
    assert nearest < 0.01 * chain.length_scale


def test_visuals_of_the_file_move_with_a_ball_joint(tmp_path: Path) -> None:
    """Yourdfpy alone knows no ball joint: the box turns by a quarter about z and rises with the slide."""
    chain = stp.load(write(tmp_path, slider(BOX)))
    q = chain.q_home.copy()
    at = {name: joint for name, joint in zip(chain.model.names, chain.model.joints, strict=True)}
    q[at["rail"].idx_q] = 0.5
    q[at["ball"].idx_q : at["ball"].idx_q + 4] = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
    scene = stp.viz.build_scene(chain, q)
    nodes = [
        node for node in scene.graph.nodes_geometry if scene.graph.transforms.parents[node] == "platform"
    ]
    assert len(nodes) == 1
    np.testing.assert_allclose(
        world_bounds(scene, nodes[0]), [[-0.05, 0.0, 0.45], [0.05, 0.2, 0.55]], atol=1e-12
    )
    colour = scene.geometry[scene.graph[nodes[0]][1]].visual.face_colors[0]
    np.testing.assert_array_equal(colour, [255, 0, 0, 255])


def test_meshes_beside_the_file_are_scaled(tmp_path: Path) -> None:
    trimesh.creation.box(extents=[100.0, 200.0, 300.0]).export(tmp_path / "bar.stl")
    chain = stp.load(write(tmp_path, slider(MESH.format("bar.stl"))))
    scene = stp.viz.build_scene(chain)
    (node,) = [n for n in scene.graph.nodes_geometry if scene.graph.transforms.parents[n] == "platform"]
    np.testing.assert_allclose(np.diff(world_bounds(scene, node), axis=0), [[0.1, 0.2, 0.3]], atol=1e-9)


def test_a_missing_mesh_is_named(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, slider(MESH.format("gone.stl"))))
    with pytest.raises(FileMissingError, match=r"gone\.stl"):
        stp.viz.build_scene(chain)


def test_a_broken_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.obj").write_text("v 0 0\nf 1 2 3\n")
    chain = stp.load(write(tmp_path, slider(MESH.format("bad.obj"))))
    with pytest.raises(FileFormatError, match="visual"):
        stp.viz.build_scene(chain)


def test_a_scene_can_be_exported(tmp_path: Path) -> None:
    scene = stp.viz.build_scene(robot("delta"))
    scene.export(tmp_path / "delta.glb")
    again = trimesh.load(tmp_path / "delta.glb")
    np.testing.assert_allclose(again.bounds, scene.bounds, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_has_a_picture(name: str) -> None:
    figure = stp.viz.plot_scene(robot(name))
    (axis,) = figure.axes
    (faces,) = axis.collections
    assert len(faces.get_facecolor()) > 20


def test_chains_from_code_have_scenes(rng: np.random.Generator) -> None:
    for chain in (arm(rng), two_bodies("distance", rng)):
        assert stp.viz.build_scene(chain).geometry
