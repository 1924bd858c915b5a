"""What a dialect can say survives being written in it and read back; what it cannot say is refused by name."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import AXIS_FREE_LOOPS, LOOP_KINDS, Coupling, JointKind, Link
from stewart_pin.model.formats.dialect import dialects
from tests.mechanisms import four_bar, gear_train, two_bodies
from tests.small_urdf import bundled, write
from tests.zoo.table import ROBOTS

WRITERS = {dialect.name for dialect in dialects() if dialect.write is not None}
SAYABLE = {
    "urdf+": set(LOOP_KINDS),
    "drake": {JointKind.SPHERICAL},
    "isaac": {JointKind.SPHERICAL},
    "gepetto": {JointKind.SPHERICAL, JointKind.FIXED},
}
"""Kinds of loops that each dialect has a word for."""
# Rotations are printed as roll, pitch and yaw; all else is printed exactly.
TOLERANCE = 1e-12


def again(chain: stp.ClosedChain, format: str, folder: Path) -> stp.ClosedChain:
    path = folder / "again.urdf"
    stp.export(chain, path, format=format)
    return stp.load(path, gravity=chain.gravity)


def linear(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Make the cam of the gear train a gear, which every dialect can say."""
    couplings = tuple(replace(c, polynomial=c.polynomial[:2]) for c in chain.couplings)
    return build_chain(replace(chain.mechanism, couplings=couplings))


def zoo() -> dict[str, stp.ClosedChain]:
    rng = np.random.default_rng(5)
    chains = {name: stp.load(name) for name in ROBOTS}
    chains |= {f"two bodies, {kind}": two_bodies(kind, rng) for kind in LOOP_KINDS}
    return chains | {
        "redundant ball": four_bar(),
        "gears": linear(gear_train(rng)),
        "other platform": stp.load("stewart", platform="leg3_lower"),
        "other motors": stp.load("four_bar", motors=["rocker_hinge"]),
    }


CHAINS = zoo()


def assert_same(mine: stp.ClosedChain, other: stp.ClosedChain, format: str) -> None:
    assert (other.name, other.motors, other.platform) == (mine.name, mine.motors, mine.platform)
    one, two = mine.mechanism, other.mechanism
    added = {link.name for link in two.links} - {link.name for link in one.links}
    frames = {f"{loop.name}_{end}" for loop in one.loops for end in "AB"}
    assert added <= {"drake": {"world"}, "gepetto": frames}.get(format, set())
    for link in one.links:
        theirs = two.link(link.name)
        assert (theirs.inertia is None) == (link.inertia is None)
        if link.inertia is not None:
            np.testing.assert_allclose(
                theirs.inertia.matrix(), link.inertia.matrix(), rtol=TOLERANCE, atol=1e-15
            )
    for joint in one.joints:
        theirs = two.joint(joint.name)
        same = ("kind", "parent", "child", "lower", "upper", "effort", "velocity", "independent")
        mark = replace(joint, independent=joint.name in mine.motors)
        assert [getattr(theirs, key) for key in same] == [getattr(mark, key) for key in same]
        np.testing.assert_allclose(theirs.placement.homogeneous, joint.placement.homogeneous, atol=TOLERANCE)
        np.testing.assert_allclose(theirs.axis, joint.axis, atol=TOLERANCE)
    assert len(two.joints) == len(one.joints) + len(added)
    assert [(p.name, p.kind, p.link1, p.link2) for p in two.loops] == [
        (p.name, p.kind, p.link1, p.link2) for p in one.loops
    ]
    for loop, theirs in zip(one.loops, two.loops, strict=True):
        for place, there in ((loop.placement1, theirs.placement1), (loop.placement2, theirs.placement2)):
            np.testing.assert_allclose(there.translation, place.translation, atol=TOLERANCE)
            if format != "drake":  # its balls have points, not frames
                np.testing.assert_allclose(there.rotation, place.rotation, atol=TOLERANCE)
        if loop.kind not in AXIS_FREE_LOOPS:
            np.testing.assert_allclose(theirs.axis, loop.axis, atol=TOLERANCE)
        if loop.kind is JointKind.UNIVERSAL:
            np.testing.assert_allclose(theirs.axis2, loop.axis2, atol=TOLERANCE)
        assert loop.kind is not JointKind.DISTANCE or theirs.length == loop.length
    assert [(c.name, c.joint1, c.joint2) for c in two.couplings] == [
        (c.name, c.joint1, c.joint2) for c in one.couplings
    ]
    for coupling, theirs in zip(one.couplings, two.couplings, strict=True):
        assert theirs.polynomial == coupling.polynomial
    assert list(other.model.names) == list(mine.model.names)
    np.testing.assert_allclose(other.q_home, mine.q_home, atol=TOLERANCE * max(1, mine.length_scale))


@pytest.mark.parametrize("format", sorted(WRITERS))
@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_there_and_back(chain: stp.ClosedChain, format: str, tmp_path: Path) -> None:
    unsayable = [loop.name for loop in chain.loops if loop.kind not in SAYABLE[format]]
    if unsayable:
        with pytest.raises(UnsupportedError, match=f"loop '{unsayable[0]}' is of type") as caught:
            again(chain, format, tmp_path)
        assert not list(tmp_path.iterdir()), "half a file was written"
        assert format.split("+")[0] in str(caught.value).lower()
        return
    other = again(chain, format, tmp_path)
    assert_same(chain, other, format)
    # What was read is written the same: no frame or world is added twice.
    first = (tmp_path / "again.urdf").read_bytes()
    assert_same(chain, again(other, format, tmp_path), format)
    assert (tmp_path / "again.urdf").read_bytes().count(b"\n") == first.count(b"\n")


@pytest.mark.parametrize("format", sorted(WRITERS))
@pytest.mark.parametrize("gravity", [(0.0, 0.0, -1.62), (0.0, 0.0, 0.0), (0.1, -0.2, -9.81)])
def test_gravity_goes_along(format: str, gravity: tuple, tmp_path: Path) -> None:
    chain = stp.load("four_bar", gravity=gravity)
    path = tmp_path / "a.urdf"
    stp.export(chain, path, format=format)
    np.testing.assert_array_equal(stp.load(path).gravity, gravity)
    np.testing.assert_array_equal(stp.load(path, gravity=(0, 1, 0)).gravity, [0, 1, 0])
    assert list(pin.buildModelFromUrdf(str(path)).names) == list(chain.model.names)
    stp.export(stp.load("four_bar"), path, format=format)
    assert "gravity" not in path.read_text()


def test_every_writer_is_tested() -> None:
    assert set(SAYABLE) == WRITERS


CAM = {
    "a cam": (Coupling("cam", "wheel", "pinion", (0.2, -0.4, 0.1)), "is not linear"),
    "a joint held still": (Coupling("cam", "wheel", None, (0.2,)), "holds a joint still"),
    "the second of a joint": (
        Coupling("cam", "turn", "pinion", (0.0, 1.0)),
        "is the second that joint 'turn'",
    ),
}


@pytest.mark.parametrize(("coupling", "words"), CAM.values(), ids=CAM)
def test_couplings_without_a_word(coupling: Coupling, words: str, tmp_path: Path) -> None:
    mechanism = gear_train(np.random.default_rng(5)).mechanism
    couplings = (*linear(gear_train(np.random.default_rng(5))).couplings[1:], coupling)
    chain = build_chain(replace(mechanism, couplings=couplings), motors=["swing"])
    assert_same(chain, again(chain, "urdf+", tmp_path), "urdf+")
    for format in ("drake", "isaac", "gepetto"):
        with pytest.raises(UnsupportedError, match=f"coupling 'cam' {words}.* format '{format}'"):
            again(chain, format, tmp_path)


@pytest.mark.parametrize("format", ["urdf+", "mjcf"])
def test_a_differential_is_written_and_read(format: str, tmp_path: Path) -> None:
    if format == "mjcf":
        pytest.importorskip("mujoco")
    chain = linear(gear_train(np.random.default_rng(5), differential=True))
    path = tmp_path / ("again.xml" if format == "mjcf" else "again.urdf")
    stp.export(chain, path, format=format)
    ours, read = (loaded.couplings[-1] for loaded in (chain, stp.load(path)))
    assert (
        (read.name, read.joints)
        == (ours.name, ours.joints)
        == (
            "differential",
            ("planet", "pinion", "turn", "slide"),
        )
    )
    np.testing.assert_allclose(read.polynomial, ours.polynomial, rtol=1e-15)
    np.testing.assert_allclose(*([ratio for _, ratio in each.others] for each in (read, ours)), rtol=1e-15)
    names = {"drake": "other.urdf", "isaac": "other.urdf", "gepetto": "other.urdf", "sdf": "other.sdf"}
    if importlib.util.find_spec("pxr"):
        names["usd"] = "other.usda"
    for other, name in names.items():
        with pytest.raises(UnsupportedError, match="coupling 'differential' follows a sum of joints"):
            stp.export(chain, tmp_path / name, format=other)
        assert not (tmp_path / name).exists()


def test_a_cam_in_a_sum_is_no_tendon(tmp_path: Path) -> None:
    with pytest.raises(
        UnsupportedError, match="coupling 'differential' follows a sum of joints, one of them by a"
    ):
        stp.export(gear_train(np.random.default_rng(5), differential=True), tmp_path / "a.xml", format="mjcf")


def test_a_gear_is_written_as_urdf_plus_has_it(tmp_path: Path) -> None:
    again(linear(gear_train(np.random.default_rng(5))), "urdf+", tmp_path)
    text = (tmp_path / "again.urdf").read_text()
    # Turn and wheel stand in one branch: the common ancestor leaves no joint on one side, so it is no plain gear.
    assert text.count('type="rolling"') == 0 and text.count('type="polynomial"') == 3
    chain = gear_train(np.random.default_rng(5))
    gear = replace(chain.mechanism, couplings=(Coupling("gear", "wheel", "pinion", (0.0, -2.5)),))
    assert_same(build_chain(gear), again(build_chain(gear), "urdf+", tmp_path), "urdf+")
    text = (tmp_path / "again.urdf").read_text()
    assert '<predecessor link="pinion"/>' in text and '<ratio value="-2.5"/>' in text


def test_names_of_frames_that_are_taken_are_named(tmp_path: Path) -> None:
    chain = four_bar()
    links = (*chain.mechanism.links, Link("pin_A"))
    joint = replace(chain.mechanism.joints[-1], name="extra", child="pin_A", kind=JointKind.FIXED)
    taken = build_chain(replace(chain.mechanism, links=links, joints=(*chain.mechanism.joints, joint)))
    with pytest.raises(UnsupportedError, match="a link is called 'pin_A'"):
        stp.export(taken, tmp_path / "a.urdf", format="gepetto")


def test_a_moving_world_is_refused_by_drake(tmp_path: Path) -> None:
    text = bundled("four_bar").read_text().replace('"rocker"', '"world"')
    with pytest.raises(UnsupportedError, match="link 'world' moves"):
        stp.export(stp.load(write(tmp_path, text)), tmp_path / "a.urdf", format="drake")
    ground = bundled("four_bar").read_text().replace('"base"', '"world"')
    chain = stp.load(write(tmp_path, ground))
    assert_same(chain, again(chain, "drake", tmp_path), "urdf+")


@pytest.mark.parametrize("format", ["isaac", "gepetto", "drake"])
def test_a_path_that_cannot_be_written_is_named(format: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="path: cannot write"):
        stp.export(four_bar(), tmp_path / "none" / "a.urdf", format=format)
    with pytest.raises(InputError, match=f"format must be one of .*{format}.*, got 'step'"):
        stp.export(four_bar(), tmp_path / "a.urdf", format="step")


@pytest.mark.parametrize("format", ["urdf+", "isaac", "gepetto"])
@pytest.mark.parametrize("name", ["stewart", "four_bar", "arm_7r"])
def test_pinocchio_opens_the_file_as_our_tree(name: str, format: str, tmp_path: Path) -> None:
    chain = stp.load(name)
    stp.export(chain, tmp_path / "a.urdf", format=format)
    theirs = pin.buildModelFromUrdf(str(tmp_path / "a.urdf"))
    assert list(theirs.names) == list(chain.model.names)
    # Pinocchio holds the angle of a continuous joint as cosine and sine.
    q = np.concatenate([
        [np.cos(value[0]), np.sin(value[0])] if their.nq > our.nq else value
        for our, their, value in (
            (our, their, chain.q_home[our.idx_q : our.idx_q + our.nq])
            for our, their in zip(chain.model.joints[1:], theirs.joints[1:], strict=True)
        )
    ])  # fmt: skip
    ours = pin.crba(chain.model, chain.model.createData(), chain.q_home)
    np.testing.assert_allclose(pin.crba(theirs, theirs.createData(), q), ours, atol=1e-12)
