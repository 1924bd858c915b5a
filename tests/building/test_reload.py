"""Whatever `export` writes, plain `load` reads again: no argument has to be remembered beside the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError, UnsupportedError
from stewart_pin.model.description import JointKind, Outcome
from stewart_pin.model.formats.dialect import dialects
from stewart_pin.model.formats.reading import read_mechanism
from tests.building import cassie
from tests.closed_states import NAMES
from tests.model.test_published_robots import published
from tests.small_sdf import joint as sdf_joint
from tests.small_sdf import link as sdf_link
from tests.small_sdf import sdf
from tests.small_urdf import ARM, INERTIAL, joint, link, robot, write

FORMATS = [*sorted(dialect.name for dialect in dialects() if dialect.write is not None), "mjcf"]
ODD = INERTIAL.replace('izz="1"', 'izz="5"')


def again(
    chain: stp.ClosedChain, folder: Path, format: str
) -> tuple[stp.ClosedChain, tuple[tuple[str, str], ...]]:
    """Write a chain and read it; return what the report of the export says as well."""
    if format == "mjcf":
        pytest.importorskip("mujoco")
    path = folder / ("again.xml" if format == "mjcf" else "again.urdf")
    report = stp.export(chain, path, format=format)
    return stp.load(path), tuple((note.subject, note.text) for note in report.notes)


def odd_arm(folder: Path) -> stp.ClosedChain:
    text = robot(*ARM, link("disc", ODD), joint("turn", "arm", "disc", "continuous"))
    return stp.load(write(folder, text))


@pytest.mark.parametrize("format", FORMATS)
def test_odd_inertias(format: str, tmp_path: Path) -> None:
    chain = odd_arm(tmp_path)
    other, notes = again(chain, tmp_path, format)
    moments = other.mechanism.link("disc").inertia.inertia  # type: ignore[union-attr]
    if format != "mjcf":
        np.testing.assert_array_equal(np.diag(moments), [1, 1, 5])
        assert notes == () and other.mechanism.odd_inertias == {"disc"}
        assert "<odd_inertia>: its inertia is kept" in str(other.report)
        return
    # MuJoCo refuses what no body has.
    np.testing.assert_allclose(np.diag(moments), [1, 1, 2], rtol=1e-15)
    assert any(who == "link 'disc'" and "break the triangle" in text for who, text in notes)


@pytest.mark.parametrize("format", FORMATS)
def test_odd_inertias_of_sdformat(format: str, tmp_path: Path) -> None:
    disc = "<inertial><inertia><izz>5</izz></inertia></inertial>"
    (tmp_path / "a.sdf").write_text(
        sdf(sdf_link("platform", content=disc), sdf_joint("j", "world", "platform"))
    )
    other, _ = again(stp.load(tmp_path / "a.sdf", motors=["j"]), tmp_path, format)
    assert other.motors == ("j",)


def test_odd_inertias_that_nobody_asked_for_are_refused_still(tmp_path: Path) -> None:
    path = tmp_path / "again.urdf"
    stp.write_urdf(odd_arm(tmp_path), path)
    worse = path.read_text().replace('izz="1"', 'izz="9"')
    path.write_text(worse)
    with pytest.raises(MechanismError, match=r"link 'base'.* break the triangle"):
        stp.load(path, odd_inertias=False)
    path.write_text(worse.replace('<odd_inertia link="disc"/>', '<odd_inertia link="disk"/>'))
    with pytest.raises(FileFormatError, match=r"<odd_inertia> \(line \d+\) names the missing link 'disk'"):
        stp.load(path)


@pytest.mark.parametrize("format", FORMATS)
def test_the_platform_and_its_names(format: str, tmp_path: Path) -> None:
    """Also where another link is called platform, or the platform is a frame without inertia."""
    text = robot(*ARM, link("hand"), joint("wrist", "platform", "hand", "continuous"))
    chain = stp.load(write(tmp_path, text), platform="hand")
    assert again(chain, tmp_path, format)[0].platform == "hand"
    tool = stp.with_platform(
        chain, "hand", placement=pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.ones(3)), name="tip"
    )
    other, _ = again(tool, tmp_path, format)
    assert other.platform == "tip"
    np.testing.assert_allclose(
        stp.platform_pose(other, other.q_home).homogeneous,
        stp.platform_pose(tool, tool.q_home).homogeneous,
        atol=1e-14,
    )
    assert again(stp.with_platform(chain, "platform"), tmp_path, format)[0].platform == "platform"


def test_an_mjcf_names_its_platform(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = """<mujoco><custom><text name="platform" data="{}"/><numeric name="velocity:j" data="2"/>
      <numeric name="velocity:k" data="3"/></custom><worldbody><body name="hand"><joint name="j"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><site name="tip" pos="0 0 1"/></body></worldbody>
      <actuator><motor joint="j"/></actuator></mujoco>"""
    for name in ("hand", "tip"):
        (tmp_path / "a.xml").write_text(text.format(name))
        chain = stp.load(tmp_path / "a.xml")
        assert chain.platform == name and chain.mechanism.joint("j").velocity == 2
        assert "no joint of this name (<numeric name='velocity:k'>)" in str(chain.report)
    (tmp_path / "a.xml").write_text(text.format("hond"))
    with pytest.raises(FileFormatError, match="names 'hond', which is no body and no site; correct the name"):
        stp.load(tmp_path / "a.xml")


@pytest.mark.parametrize("format", FORMATS)
def test_a_home_that_the_file_puts_beyond_limits(format: str, tmp_path: Path) -> None:
    """The links of an SDFormat file stand where it places them, although the joint may not: no loop has to give way."""
    limit = "<limit><lower>0.4</lower><upper>0.8</upper></limit>"
    parts = [
        sdf_link("platform", "1 0 0 0 0 0"),
        sdf_joint("j", "world", "platform", axis=limit),
        sdf_joint("k", "world", "platform", "ball", pose="0.5 0 0 0 0 0", xyz=""),
    ]
    (tmp_path / "a.sdf").write_text(sdf(*parts))
    chain = stp.load(tmp_path / "a.sdf", motors=["j"])
    assert "it stays there" in str(chain.report)
    other, _ = again(chain, tmp_path, format)
    np.testing.assert_allclose(other.q_home, chain.q_home, atol=1e-12)


def _shapes(chain: stp.ClosedChain) -> tuple[int, int]:
    links = chain.mechanism.links
    return sum(len(each.visuals) for each in links), sum(len(each.collisions) for each in links)


@pytest.mark.slow
@pytest.mark.parametrize("format", FORMATS)
def test_published_robots(format: str, tmp_path: Path) -> None:
    """URDF files as they are published, each driven by its first joint: every one that loads, loads again."""
    tried = 0
    for path in published():
        mechanism = read_mechanism(path)
        movable = [each.name for each in mechanism.joints if each.has_axis]
        try:
            chain = stp.load(path, motors=movable[:1], platform=mechanism.joints[-1].child, odd_inertias=True)
        except (MechanismError, IndexError):
            continue  # masses that no body has, or no robot yet
        try:
            other, notes = again(chain, tmp_path, format)
        except UnsupportedError:
            assert format == "mjcf"  # which takes neither equal limits nor bodies without moments
            continue
        assert (other.motors, other.platform) == (chain.motors, chain.platform), path
        tried += 1
        if format != "mjcf":
            # Kept, and told: what other software than ours passes over of joints that do something by themselves.
            told = [text for _, text in notes if "passes over" not in text]
            assert not told and _shapes(other) == _shapes(chain), path
            kept = [
                {x.name: x.physics for x in each.mechanism.joints if x.physics} for each in (other, chain)
            ]
            assert kept[0] == kept[1], path
            np.testing.assert_allclose(other.q_home, chain.q_home, atol=1e-12)
        elif _shapes(other) != _shapes(chain):
            assert any(text.startswith(("visual: left out", "collision: left out")) for _, text in notes), (
                path
            )
    assert tried > (40 if format == "mjcf" else 55) or not published()


@pytest.mark.skipif(cassie.folder() is None, reason="needs the package example-robot-data")
@pytest.mark.parametrize("name", cassie.FILES)
def test_cassie_survives_urdf(name: str, tmp_path: Path) -> None:
    """Its file places joints beyond their limits, and two of its rotors have inertias that no body has."""
    folder = cassie.folder()
    assert folder is not None
    chain = stp.load(folder / "robots" / f"{name}.sdf", motors=cassie.motors(name), platform="pelvis")
    other, notes = again(chain, tmp_path, "urdf+")
    assert notes == () and _shapes(other) == _shapes(chain) and sum(_shapes(chain)) > 30
    assert (other.motors, other.platform) == (chain.motors, "pelvis")
    np.testing.assert_allclose(other.q_home, chain.q_home, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_robots_survive_mjcf_and_urdf(name: str, tmp_path: Path) -> None:
    """What MuJoCo has no word for is in the report; all else is there after MJCF, and after URDF from it."""
    chain = stp.load(name)
    middle, notes = again(chain, tmp_path, "mjcf")
    last, none = again(middle, tmp_path, "urdf+")
    assert none == ()
    for other in (middle, last):
        assert (other.name, other.motors, other.platform) == (chain.name, chain.motors, chain.platform)
        np.testing.assert_array_equal(other.gravity, chain.gravity)
        told = {who for who, _ in notes}
        for own in chain.mechanism.joints:
            if own.kind is JointKind.FIXED:
                assert f"joint '{own.name}'" in told
                continue
            same = other.mechanism.joint(own.name)
            assert (same.kind, same.lower, same.upper, same.velocity) == (
                own.kind, own.lower, own.upper, own.velocity,
            )  # fmt: skip
            assert same.effort == own.effort
        names = {each.name for each in other.mechanism.links}
        for name in {each.name for each in chain.mechanism.links}:
            assert name in names or f"link '{name}'" in told, name
        assert [each.name for each in other.loops] == [each.name for each in chain.loops]
        assert [c.name for c in other.couplings] == [c.name for c in chain.couplings]
    assert all(
        note.outcome is not Outcome.CHANGED
        for note in stp.export(chain, tmp_path / "a.xml", format="mjcf").notes
    )


def test_inertia_without_mass_goes_along(tmp_path: Path) -> None:
    flange = INERTIAL.replace('mass value="1"', 'mass value="0"')
    text = robot(*ARM, link("flange", flange), joint("glue", "arm", "flange", "fixed"))
    other, _ = again(stp.load(write(tmp_path, text)), tmp_path, "mjcf")
    inertia = other.mechanism.link("flange").inertia
    assert inertia is not None and inertia.mass == 0
    np.testing.assert_allclose(inertia.inertia, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("format", FORMATS)
def test_loops_beside_a_file_are_not_added_to_another(format: str, tmp_path: Path) -> None:
    """Where a URDF with its YAML is overwritten by one that has its loops inside, the YAML lies there still."""
    chain = stp.load("stewart")
    again(chain, tmp_path, "gepetto")
    other, _ = again(chain, tmp_path, format)
    assert [loop.name for loop in other.loops] == [loop.name for loop in chain.loops]
    if format not in ("mjcf", "gepetto"):
        again_by_hand = tmp_path / "again.urdf"
        assert len(stp.load(again_by_hand, loops=None).loops) == 6
        again_by_hand.write_text(again_by_hand.read_text().replace('loops="here"', 'loops="there"'))
        with pytest.raises(FileFormatError, match="<robot loops='there'>: it may be 'here'"):
            stp.load(again_by_hand)


def test_inertia_that_mujoco_cannot_have_is_named(tmp_path: Path) -> None:
    text = robot(*ARM, link("dot", INERTIAL.replace('"1"', '"0"')), joint("glue", "arm", "dot", "fixed"))
    chain = stp.load(write(tmp_path, text.replace('"base"', '"world"')))
    _, notes = again(chain, tmp_path, "mjcf")
    assert ("link 'dot'", "its inertia is left out: MuJoCo has no body without mass") in notes
    assert ("link 'world'", "its inertia is left out: MuJoCo's world is no body") in notes
