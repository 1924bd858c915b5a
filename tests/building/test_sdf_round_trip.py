"""A chain written as SDFormat and read back is the same mechanism, with all that it held; other words are refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import FileFormatError, UnsupportedError
from stewart_pin.model.description import LOOP_KINDS, Bounds, Coupling, JointKind, Mechanism, loop_coordinates
from stewart_pin.model.formats.sdf import read_sdf
from stewart_pin.model.shapes import Material, Shape, ShapeKind
from tests.building.read_again import require_same
from tests.closed_states import robot, slow_but_for_few
from tests.mechanisms import four_bar, gear_train, two_bodies
from tests.small_urdf import bundled, write
from tests.zoo.table import ROWS, zoo_chain

SAYABLE = {
    JointKind.SPHERICAL,
    JointKind.FIXED,
    JointKind.REVOLUTE,
    JointKind.PRISMATIC,
    JointKind.UNIVERSAL,
}
WITHOUT_A_WORD = ("rscr", "rccc")
"""Mechanisms of the zoo that are closed by a cylindrical joint."""
FEW = (
    "stewart",
    "delta",
    "rpr_planar",
    "wedge",
    "screw_jack",
    "scissor_lift",
    "cardan_shaft",
    "planetary_gear",
)


def again(chain: stp.ClosedChain, folder: Path) -> stp.ClosedChain:
    path = folder / "again.sdf"
    stp.export(chain, path, format="sdf")
    return stp.load(path)


@pytest.mark.parametrize("name", slow_but_for_few([*stp.robots(), *ROWS], (*FEW, *WITHOUT_A_WORD)))
def test_robots_and_the_zoo(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    chain = zoo_chain(name) if name in ROWS else stp.load(name)
    if name in WITHOUT_A_WORD:
        with pytest.raises(UnsupportedError, match="loop 'loop1' is cylindrical; SDFormat closes"):
            again(chain, tmp_path)
        return
    other = again(chain, tmp_path)
    require_same(chain, other, rng)
    assert other.platform == chain.platform
    assert [(x.name, x.kind, x.link1, x.link2) for x in other.loops] == [
        (x.name, x.kind, x.link1, x.link2) for x in chain.loops
    ]
    # What was read is written the same: no world is added twice.
    first = (tmp_path / "again.sdf").read_bytes()
    again(other, tmp_path)
    assert (tmp_path / "again.sdf").read_bytes().count(b"\n") == first.count(b"\n")


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_kinds_of_loops(kind: JointKind, rng: np.random.Generator, tmp_path: Path) -> None:
    """The free body floats by a joint of another name, its frame where it is."""
    chain = two_bodies(kind, np.random.default_rng(11))
    if kind not in SAYABLE:
        with pytest.raises(UnsupportedError, match=f"loop 'loop' is {kind}"):
            again(chain, tmp_path)
        assert not list(tmp_path.iterdir()), "half a file was written"
        return
    other = again(chain, tmp_path)
    require_same(chain, other, rng)
    (mine,), (theirs,) = chain.loops, other.loops
    for one, two in (
        (mine.placement1.homogeneous, theirs.placement1.homogeneous),
        (mine.placement2.homogeneous, theirs.placement2.homogeneous),
    ):
        np.testing.assert_allclose(two, one, atol=1e-12)
    if kind is not JointKind.FIXED:
        np.testing.assert_allclose(theirs.axis, mine.axis, atol=1e-12)


def limited(mechanism: Mechanism) -> Mechanism:
    """State every limit that there is, to both sides otherwise."""
    joints = tuple(
        replace(
            joint,
            lower=-4.0,
            upper=5.0,
            effort=(-6.0, 7.0),
            velocity=8.0,
            acceleration=(-9.0, 10.0),
            jerk=11.0,
        )
        if joint.has_axis
        else replace(joint, swing=2.5, turn=3.0)
        if joint.kind is JointKind.SPHERICAL
        else joint
        for joint in mechanism.joints
    )
    bounds = Bounds((-3.5, 3.6), (-1.0, 2.0), (-3.0, 3.0), jerk=(-4.0, 5.0))
    loops = tuple(
        replace(loop, bounds=(bounds,) * len(loop_coordinates(loop.kind))) for loop in mechanism.loops
    )
    return replace(mechanism, joints=joints, loops=loops)


@pytest.mark.parametrize("kind", sorted(SAYABLE))
def test_every_limit(kind: JointKind, tmp_path: Path) -> None:
    chain = two_bodies(kind, np.random.default_rng(11))
    chain = build_chain(replace(limited(chain.described()), home=chain.described().home))
    other = again(chain, tmp_path)
    names = list(other.limits.names)
    order = [names.index(name) for name in chain.limits.names]
    for quantity in ("position", "velocity", "acceleration", "effort", "jerk"):
        one, two = (getattr(each.limits, quantity) for each in (chain, other))
        np.testing.assert_allclose(two[order], one, rtol=1e-12, atol=1e-12, equal_nan=True)


def test_names_that_sdformat_does_not_allow(rng: np.random.Generator, tmp_path: Path) -> None:
    """Joints and links share names, a cross has a name of its own, couplings have theirs."""
    gears = gear_train(np.random.default_rng(5))
    couplings = tuple(replace(c, polynomial=c.polynomial[:2]) for c in gears.couplings)
    chain = build_chain(replace(gears.mechanism, couplings=couplings))
    other = again(chain, tmp_path)
    require_same(chain, other, rng)
    for mine in chain.couplings:
        theirs = next(each for each in other.couplings if each.name == mine.name)
        assert (theirs.joint1, theirs.joint2) == (mine.joint1, mine.joint2)
        np.testing.assert_allclose(theirs.polynomial, mine.polynomial, rtol=0, atol=1e-14)
    text = write(tmp_path, bundled("four_bar").read_text().replace('"rocker"', '"a::world"'))
    report = stp.export(stp.load(text), tmp_path / "b.sdf", format="sdf")
    assert "called 'a_world', as SDFormat keeps such names for itself (link 'a::world')" in str(report)
    assert "a_world" in [link.name for link in read_sdf(tmp_path / "b.sdf").links]


def test_blanks_around_names(tmp_path: Path) -> None:
    """Text of an element is read without them, so links lose theirs aloud; joints keep them in a word of ours."""
    text = bundled("four_bar").read_text()
    for name in ("rocker", "crank_pin"):
        text = text.replace(f'"{name}"', f'" {name}"')
    report = stp.export(stp.load(write(tmp_path, text)), tmp_path / "b.sdf", format="sdf")
    assert "called 'rocker', as SDFormat keeps such names for itself (link ' rocker')" in str(report)
    found = stp.load(tmp_path / "b.sdf").mechanism
    assert "rocker" in [link.name for link in found.links]
    assert " crank_pin" in [joint.name for joint in found.joints]


CAM = {
    "a cam": (Coupling("cam", "wheel", "pinion", (0.2, -0.4, 0.1)), "is not linear"),
    "a joint held still": (Coupling("cam", "wheel", None, (0.2,)), "holds a joint still"),
}


@pytest.mark.parametrize(("coupling", "words"), CAM.values(), ids=CAM)
def test_couplings_without_a_word(coupling: Coupling, words: str, tmp_path: Path) -> None:
    mechanism = gear_train(np.random.default_rng(5)).mechanism
    chain = build_chain(replace(mechanism, couplings=(coupling, *mechanism.couplings[1:])), motors=["swing"])
    with pytest.raises(UnsupportedError, match=f"coupling 'cam' {words}.* format 'sdf'"):
        again(chain, tmp_path)


@pytest.mark.parametrize(
    "motors",
    [
        ("leg6_y",),
        ("leg6_x", "leg1"),
        ("leg6_y", "leg6_x"),
        ("leg6_x", "leg1", "leg6_y"),
        ("leg6_x", "leg6_y"),
    ],
    ids="-".join,
)
def test_motors_on_the_hinges_of_a_cross(motors: tuple[str, ...], tmp_path: Path) -> None:
    """As one universal joint both would be driven, one after the other."""
    assert again(stp.load("stewart", motors=motors), tmp_path).motors == motors


@pytest.mark.parametrize("motors", [(), ("rocker_hinge",)])
def test_roles_and_gravity(motors: tuple[str, ...], tmp_path: Path) -> None:
    chain = stp.load("four_bar", motors=motors, platform="rocker", gravity=(0.1, 0.2, -1.62))
    other = again(chain, tmp_path)
    assert (other.motors, other.platform) == (motors, "rocker")
    np.testing.assert_array_equal(other.gravity, chain.gravity)


def test_a_loop_that_ends_on_the_world_is_told_from_its_other_side(
    rng: np.random.Generator, tmp_path: Path
) -> None:
    chain = four_bar(JointKind.REVOLUTE)
    described = chain.described()
    renamed = {"ground": "world"}
    links = tuple(replace(link, name=renamed.get(link.name, link.name)) for link in described.links)
    hinge = described.joint("rocker_hinge")
    joints = tuple(
        replace(joint, parent=renamed.get(joint.parent, joint.parent))
        for joint in described.joints
        if joint is not hinge
    )
    pin_loop = described.loops[0]
    rocker = replace(
        hinge, name="top", parent="coupler", placement=pin_loop.placement1, axis=np.array([0.0, 0.0, 1.0])
    )
    foot = replace(
        pin_loop,
        name="foot",
        link1="rocker",
        link2="world",
        placement1=pin_loop.placement2.inverse(),
        placement2=hinge.placement,
        bounds=(Bounds((0.1, 0.2)),),
    )
    rocker = replace(rocker, placement=pin_loop.placement1)
    home = {"crank_motor": described.home["crank_motor"], "elbow": described.home["elbow"]}
    mechanism = replace(described, links=links, joints=(*joints, rocker), loops=(foot,), home=home)
    told = build_chain(replace(mechanism, home_is_guess=True))
    other = again(told, tmp_path)
    require_same(told, other, rng)
    report = stp.export(told, tmp_path / "b.sdf", format="sdf")
    assert "told from its other side" in str(report)
    assert other.limits.position[-1] == pytest.approx(told.limits.position[-1])
    # The angle of the closure counts the same way: a limit is exceeded by as much.
    mine, theirs = (stp.limits_exceeded(each.at(each.q_home)) for each in (told, other))
    (mine,), (theirs,) = ([x.by for x in each if x.joint == "foot"] for each in (mine, theirs))
    assert theirs == pytest.approx(mine, abs=1e-12)


def test_shapes(tmp_path: Path) -> None:
    red = Material("red", (1.0, 0.0, 0.0, 0.5))
    place = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2.0, 3.0]))
    shapes = (
        Shape(ShapeKind.BOX, (0.1, 0.2, 0.3), place, "front", material=red),
        Shape(ShapeKind.CYLINDER, (0.1, 0.2), name="front"),
        Shape(ShapeKind.CAPSULE, (0.1, 0.2)),
        Shape(ShapeKind.ELLIPSOID, (0.1, 0.2, 0.3)),
        Shape(ShapeKind.SPHERE, (0.1,)),
        Shape(ShapeKind.MESH, (1.0, 2.0, 1.0), mesh="a.stl", folder=str(tmp_path)),
    )
    mechanism = stp.load("four_bar").described()
    links = tuple(
        replace(link, visuals=shapes, collisions=shapes[:1]) if link.name == "rocker" else link
        for link in mechanism.links
    )
    (tmp_path / "out").mkdir()
    again(build_chain(replace(mechanism, links=links)), tmp_path / "out")
    theirs = stp.load(tmp_path / "out" / "again.sdf").mechanism.link("rocker")
    assert len(theirs.collisions) == 1
    for one, two in zip(shapes, theirs.visuals, strict=True):
        assert (two.kind, two.sizes, two.name, two.material) == (one.kind, one.sizes, one.name, one.material)
        np.testing.assert_allclose(two.placement.homogeneous, one.placement.homogeneous, atol=1e-14)
    assert theirs.visuals[-1].mesh == "../a.stl"


BAD = {
    "position": ('stewart_pin:position="1 2 3"', "may not hold 3 numbers"),
    "part of a name": ('stewart_pin:axis="1 2"', "stewart_pin:axis must hold three numbers"),
    "independent": ('stewart_pin:independent="perhaps"', "must be true or false"),
}


@pytest.mark.parametrize(("word", "fault"), BAD.values(), ids=BAD)
def test_own_words_that_make_no_sense_are_refused(word: str, fault: str, tmp_path: Path) -> None:
    again(stp.load("four_bar"), tmp_path)
    text = (tmp_path / "again.sdf").read_text()
    key = word.partition("=")[0]
    joint = 'name="rocker_hinge" type="revolute"'
    line = next(line for line in text.splitlines() if joint in line)
    kept = " ".join(part for part in line.rstrip(">").split(" ") if not part.startswith(key))
    (tmp_path / "bad.sdf").write_text(text.replace(line, f"{kept} {word}>"))
    with pytest.raises(FileFormatError, match=fault):
        stp.load(tmp_path / "bad.sdf")


@pytest.mark.parametrize("digits", [6, 8])
def test_printed_axes_of_universal_loops(digits: int, tmp_path: Path) -> None:
    path = tmp_path / "tripod.sdf"
    stp.export(robot("tripod_3upu"), path, format="sdf")
    text = re.sub(
        r"(?<=<xyz>)[^<]*",
        lambda found: " ".join(f"{float(word):.{digits}g}" for word in found[0].split()),
        path.read_text(),
    )
    path.write_text(text)
    assert stp.mobility(stp.load(path)).dof == 3
