"""A robot without shapes is written with simple ones, which viewers show, and which are not read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.building.drawn_shapes import body_points
from stewart_pin.model.formats.reading import read_mechanism
from tests.building.test_shapes import dressed
from tests.closed_states import slow_but_for_few

FORMATS = {"urdf+": "a.urdf", "drake": "a.urdf", "sdf": "a.sdf", "mjcf": "a.xml"}
TAG = {"mjcf": "<geom class"}


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("name", ["stewart_sps", "arm_7r"])
def test_every_body_is_seen_and_nothing_is_read_back(name: str, format: str, tmp_path: Path) -> None:
    chain, path = stp.load(name), tmp_path / FORMATS[format]
    stp.export(chain, path, format=format)
    bodies = [link.name for link in chain.mechanism.links if link.inertia is not None]
    text = path.read_text()
    assert all(f'name="stewart_pin_drawn_{body}_1"' in text for body in bodies)
    other = stp.load(path)
    assert not any(link.visuals or link.collisions for link in other.mechanism.links)
    assert _masses(other) == pytest.approx(_masses(chain), rel=1e-14)
    stp.export(chain, path, format=format, simple_shapes=False)
    assert "stewart_pin_drawn" not in path.read_text()


@pytest.mark.parametrize("name", slow_but_for_few(stp.robots(), ("delta", "four_bar", "slider_crank")))
def test_mujoco_shows_every_robot_and_masses_and_contacts_are_as_without(name: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    chain = stp.load(name)
    stp.export(chain, tmp_path / "a.xml", format="mjcf")
    stp.export(chain, tmp_path / "b.xml", format="mjcf", simple_shapes=False)
    drawn, bare = (mujoco.MjModel.from_xml_path(str(tmp_path / file)) for file in ("a.xml", "b.xml"))
    own = sum(len(link.visuals) for link in chain.mechanism.links)
    assert bare.ngeom == own and (drawn.ngeom == own or not own)
    assert len(set(drawn.geom_bodyid)) >= np.count_nonzero(drawn.body_mass), "a body is not seen"
    assert not drawn.geom_contype.any() and not drawn.geom_conaffinity.any()
    assert (drawn.geom_group <= 2).all(), "the viewer shows groups 0 to 2"
    np.testing.assert_array_equal(drawn.body_mass, bare.body_mass)
    np.testing.assert_array_equal(drawn.body_inertia, bare.body_inertia)
    data = mujoco.MjData(drawn)
    mujoco.mj_resetDataKeyframe(drawn, data, 0)
    mujoco.mj_forward(drawn, data)
    assert data.ncon == 0


def _masses(chain: stp.ClosedChain) -> dict[str, float]:
    return {link.name: link.inertia.mass for link in chain.mechanism.links if link.inertia is not None}


def test_a_bar_is_drawn_from_joint_to_joint(tmp_path: Path) -> None:
    chain = stp.load("four_bar")
    stp.write_urdf(chain, tmp_path / "a.urdf")
    (bar,) = read_mechanism(tmp_path / "a.urdf").link("coupler").visuals
    half = bar.placement.rotation[:, 2] * bar.sizes[1] / 2
    ends = bar.placement.translation + np.outer([-1, 1], half)
    points = body_points(chain)["coupler"]
    assert len(points) == 2
    np.testing.assert_allclose(np.sort(ends, axis=0), np.sort(points, axis=0), atol=1e-14)


def test_who_has_shapes_keeps_them_alone(tmp_path: Path) -> None:
    chain = dressed(tmp_path)
    stp.write_urdf(chain, tmp_path / "out.urdf")
    assert "stewart_pin_drawn" not in (tmp_path / "out.urdf").read_text()
