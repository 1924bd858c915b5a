"""A chain survives being written and read back: masses, joints, limits, loops, motors, platform, home."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError
from stewart_pin.model.description import (
    AXIS_FREE_LOOPS,
    LOOP_KINDS,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Outcome,
)
from tests.small_urdf import ARM, bundled, joint, link, robot, write

# Numbers are printed exactly; roll, pitch and yaw of a rotation give it back to a few units of round-off.
EXACT = 1e-15
TOLERANCE = 1e-12


def there_and_back(chain: stp.ClosedChain, folder: Path) -> stp.ClosedChain:
    path = folder / "again.urdf"
    stp.write_urdf(chain, path)
    return stp.load(path, gravity=chain.gravity)


def random_placement(rng: np.random.Generator) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.uniform(-2, 2, 3)), rng.normal(size=3))


def random_body(rng: np.random.Generator) -> pin.Inertia:
    """Inertia of a few particles: physical, and without symmetry."""
    total = pin.Inertia.Zero()
    for point in rng.normal(size=(5, 3)):
        total += pin.Inertia(float(rng.uniform(0.1, 2)), point, np.zeros((3, 3)))
    return total


def assert_placements_equal(mine: pin.SE3, other: pin.SE3) -> None:
    np.testing.assert_allclose(mine.homogeneous, other.homogeneous, rtol=0, atol=TOLERANCE)


def assert_same(first: stp.ClosedChain, second: stp.ClosedChain) -> None:
    assert (second.name, second.motors, second.platform) == (first.name, first.motors, first.platform)
    one, two = first.mechanism, second.mechanism
    assert [link.name for link in two.links] == [link.name for link in one.links]
    for mine, other in zip(one.links, two.links, strict=True):
        assert (mine.inertia is None) == (other.inertia is None)
        if mine.inertia is not None:
            scale = max(1.0, np.abs(mine.inertia.matrix()).max())
            np.testing.assert_allclose(
                mine.inertia.matrix(), other.inertia.matrix(), rtol=0, atol=EXACT * scale
            )
    theirs = {joint.name: joint for joint in two.joints}
    assert set(theirs) == {joint.name for joint in one.joints}
    for mine in one.joints:
        other = theirs[mine.name]
        assert (mine.kind, mine.parent, mine.child) == (other.kind, other.parent, other.child)
        assert (mine.name in first.motors) == other.independent
        assert_placements_equal(mine.placement, other.placement)
        if mine.has_axis:
            np.testing.assert_allclose(mine.axis, other.axis, rtol=0, atol=EXACT)
            for limit in ("lower", "upper", "effort", "velocity"):
                assert getattr(mine, limit) == getattr(other, limit)
    assert len(one.loops) == len(two.loops)
    for mine, other in zip(one.loops, two.loops, strict=True):
        assert (mine.name, mine.kind, mine.link1, mine.link2) == (
            other.name,
            other.kind,
            other.link1,
            other.link2,
        )
        assert_placements_equal(mine.placement1, other.placement1)
        assert_placements_equal(mine.placement2, other.placement2)
        if mine.kind not in AXIS_FREE_LOOPS:
            np.testing.assert_allclose(mine.axis, other.axis, rtol=0, atol=EXACT)
        if mine.kind is JointKind.UNIVERSAL:
            np.testing.assert_allclose(mine.axis2, other.axis2, rtol=0, atol=EXACT)
        assert mine.length == other.length
    np.testing.assert_allclose(
        first.q_home, second.q_home, rtol=0, atol=TOLERANCE * max(1, first.length_scale)
    )
    np.testing.assert_array_equal(first.gravity, second.gravity)
    assert list(first.model.names) == list(second.model.names)


@pytest.mark.parametrize("name", stp.robots())
def test_bundled_robots(name: str, tmp_path: Path) -> None:
    chain = stp.load(name)
    assert_same(chain, there_and_back(chain, tmp_path))


@pytest.mark.parametrize("name", ["stewart", "stewart_sps", "stewart_cad", "stewart_s1"])
def test_bundled_files_are_what_we_write(name: str, tmp_path: Path) -> None:
    stp.write_urdf(stp.load(name), tmp_path / "again.urdf", simple_shapes=False)
    assert (tmp_path / "again.urdf").read_text() == bundled(name).read_text()


@pytest.mark.parametrize("lower_joint", ["universal", "spherical"])
def test_random_hexapods(lower_joint: str, tmp_path: Path, rng: np.random.Generator) -> None:
    for _ in range(3):
        base, platform = rng.uniform(-1, 1, (2, 6, 3)) * [1.0, 1.0, 0.1]
        chain = stp.hexapod_chain(
            stp.Hexapod(base, platform),
            platform=random_body(rng),
            lower=random_body(rng),
            upper=random_body(rng),
            base=random_body(rng),
            lower_joint=lower_joint,
            home=pin.SE3(pin.exp3(rng.uniform(-0.3, 0.3, 3)), np.array([0.1, -0.2, 2.5])),
            effort=float(rng.uniform(1, 100)),
            gravity=rng.normal(size=3),
        )
        assert_same(chain, there_and_back(chain, tmp_path))


def mechanism_with(kind: JointKind, rng: np.random.Generator) -> Mechanism:
    """Two free bodies, held to each other by a loop of any kind that is closed at home, and a motor on the first."""
    axis, axis2, joint_axis = (x / np.linalg.norm(x) for x in rng.normal(size=(3, 3)))
    placement1, placement2 = random_placement(rng), random_placement(rng)
    # Frame 2 on frame 1, but for a universal joint's second axis, which is laid across the first.
    relative = pin.SE3.Identity()
    length = 0.0
    if kind is JointKind.UNIVERSAL:
        across = np.cross(axis, axis2) / np.linalg.norm(np.cross(axis, axis2))
        # Turn about the common normal until the axes are a quarter turn apart.
        short = np.pi / 2 - np.arccos(axis @ axis2)
        relative = pin.SE3(pin.exp3(short * across), np.zeros(3))
    if kind in (JointKind.DISTANCE, JointKind.CABLE):
        length = 0.7
        relative = pin.SE3(np.eye(3), np.array([0, 0, length]))
    pose1 = random_placement(rng)
    pose2 = pose1 * placement1 * relative * placement2.inverse()
    first, second = random_placement(rng), random_placement(rng)
    return Mechanism(
        "two",
        (Link("base"), Link("a", random_body(rng)), Link("b", random_body(rng)), Link("platform", random_body(rng))),
        (
            Joint("fly_a", JointKind.FLOATING, "base", "a", first),
            Joint("fly_b", JointKind.FLOATING, "base", "b", second),
            Joint("push", JointKind.PRISMATIC, "a", "platform", random_placement(rng), joint_axis, independent=True),
        ),
        (Loop("tie", kind, "a", "b", placement1, placement2, axis, axis2, length),),
        platform="platform",
        home={
            "fly_a": pin.SE3ToXYZQUAT(first.inverse() * pose1),
            "fly_b": pin.SE3ToXYZQUAT(second.inverse() * pose2),
            "push": np.array([0.3]),
        },
        source="two.urdf",
    )  # fmt: skip


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_every_kind_of_loop(kind: JointKind, tmp_path: Path, rng: np.random.Generator) -> None:
    chain = build_chain(mechanism_with(kind, rng))
    again = there_and_back(chain, tmp_path)
    assert_same(chain, again)
    # The rows mean the same, also where the loop is open.
    q = pin.integrate(chain.model, chain.q_home, 0.1 * rng.normal(size=chain.nv))
    if kind is not JointKind.FIXED:  # whose rows stand in a triad that the file leaves open
        np.testing.assert_allclose(stp.loop_gap(chain, q), stp.loop_gap(again, q), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9])
def test_placements_at_gimbal_lock(pitch: float, tmp_path: Path) -> None:
    turn = f'rpy="0.3 {pitch!r} -0.4" xyz="1 2 3"'
    text = robot(
        *ARM, link("lid"), joint("j", "arm", "lid", origin=turn), joint("k", "lid", "pin"), link("pin")
    )
    chain = stp.load(write(tmp_path, text))
    assert_same(chain, there_and_back(chain, tmp_path))


LIMITS = [
    (-np.inf, np.inf, np.inf, np.inf),
    (-np.inf, np.inf, 5.0, np.inf),
    (-1.0, np.inf, np.inf, 2.0),
    (-np.inf, 1.0, np.inf, np.inf),
    (-1.0, 1.0, 0.0, 0.0),
]


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("kind", [JointKind.REVOLUTE, JointKind.PRISMATIC])
def test_limits_and_their_absence(limits: tuple, kind: JointKind, tmp_path: Path, rng) -> None:
    lower, upper, effort, velocity = limits
    mechanism = mechanism_with(JointKind.SPHERICAL, rng)
    push = replace(mechanism.joints[2], kind=kind, lower=lower, upper=upper, effort=effort, velocity=velocity)
    chain = build_chain(replace(mechanism, joints=(*mechanism.joints[:2], push)))
    again = there_and_back(chain, tmp_path)
    assert_same(chain, again)
    assert all(note.outcome is Outcome.KEPT for note in again.report.notes)
    # Pinocchio insists on limits, and must not read an absent one as zero.
    theirs = pin.buildModelFromUrdf(str(tmp_path / "again.urdf"))
    at = theirs.joints[theirs.getJointId("push")]
    if at.nq == 1:
        assert theirs.lowerPositionLimit[at.idx_q] == max(lower, -1e30)
        assert theirs.upperPositionLimit[at.idx_q] == min(upper, 1e30)


def test_chosen_motors_and_platform_are_kept(tmp_path: Path) -> None:
    chain = stp.load("stewart", motors=["leg4", "leg1_x", "leg2"], platform="leg3_upper")
    again = there_and_back(chain, tmp_path)
    assert_same(chain, again)
    assert again.motors == ("leg4", "leg1_x", "leg2") and again.platform == "leg3_upper"


@pytest.mark.parametrize("point_platform", [True, False])
def test_bodies_without_mass_stay_bodies(point_platform: bool, tmp_path: Path) -> None:
    chain = stp.massless_legs(stp.load("stewart"), point_platform=point_platform)
    assert_same(chain, there_and_back(chain, tmp_path))


def test_names_with_special_characters(tmp_path: Path) -> None:
    text = robot(*ARM).replace('"arm"', '"arm &lt;&amp;&quot; Ä"')
    chain = stp.load(write(tmp_path, text))
    assert chain.mechanism.links[1].name == 'arm <&" Ä'
    assert_same(chain, there_and_back(chain, tmp_path))


def test_export_is_the_same_file_and_names_its_formats(tmp_path: Path) -> None:
    chain = stp.load("stewart")
    stp.export(chain, tmp_path / "a.urdf")
    stp.write_urdf(chain, tmp_path / "b.urdf")
    assert (tmp_path / "a.urdf").read_bytes() == (tmp_path / "b.urdf").read_bytes()
    with pytest.raises(InputError, match=r"format must be one of .*urdf\+"):
        stp.export(chain, tmp_path / "a.urdf", format="step")


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none" / "a.urdf", tmp_path):
        with pytest.raises(InputError, match="path: cannot write"):
            stp.write_urdf(stp.load("stewart"), path)


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "jerk"])
def test_limits_to_one_side(kind: str, tmp_path: Path) -> None:
    """Of joints of the tree and of those that close loops; a greatest value alone holds to both sides in a file."""
    limits = {"leg1_pin": {kind: (None, 3.0)}, "leg2_pin": {kind: (-2.0, None)}, "leg1": {kind: (None, 3.0)}}
    chain = stp.with_limits(stp.load("rpr_planar"), limits)
    again = there_and_back(chain, tmp_path)
    np.testing.assert_array_equal(getattr(again.limits, kind), getattr(chain.limits, kind))
