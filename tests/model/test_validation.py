"""Descriptions that are no mechanism: each refusal names the culprit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import MechanismError
from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.model.validation import broken_triangle, validate
from tests.small_urdf import ARM, INERTIAL, MOTOR, home, joint, link, loop, robot, write

ONE = pin.SE3.Identity()


def body(mass: float = 1.0, com=(0.0, 0.0, 0.0), moments=(1.0, 1.0, 1.0)) -> pin.Inertia:
    inertia = pin.Inertia(mass, np.array(com), np.zeros((3, 3)))
    inertia.inertia = np.diag(moments)  # the constructor refuses negative moments itself
    return inertia


GOOD = Mechanism(
    "good",
    (Link("base"), Link("a", body()), Link("b", body())),
    (
        Joint("ja", JointKind.REVOLUTE, "base", "a", ONE, independent=True),
        Joint("jb", JointKind.PRISMATIC, "a", "b", ONE),
    ),
    (Loop("la", JointKind.SPHERICAL, "base", "b", ONE, ONE),),
    platform="b",
    source="good.urdf",
)


def with_body(inertia: pin.Inertia) -> Mechanism:
    return replace(GOOD, links=(*GOOD.links[:2], Link("b", inertia)))


def with_joint(**changes) -> Mechanism:
    return replace(GOOD, joints=(GOOD.joints[0], replace(GOOD.joints[1], **changes)))


def with_loop(**changes) -> Mechanism:
    return replace(GOOD, loops=(replace(GOOD.loops[0], **changes),))


NAN = float("nan")
SHEARED = pin.SE3(np.diag([1.0, 1.0, 2.0]), np.zeros(3))
BROKEN = {
    "negative mass": (with_body(body(-2.0)), "b", "negative mass -2 kg"),
    "mass without digits": (with_body(body(1e-320)), "b", "keeps no digits"),
    "mass nan": (with_body(body(NAN)), "b", "not finite"),
    "com nan": (with_body(body(com=(0, NAN, 0))), "b", "not finite"),
    "negative moment": (with_body(body(moments=(1, 1, -0.1))), "b", "negative principal moment -0.1"),
    "triangle": (with_body(body(moments=(1, 1, 2.1))), "b", "1, 1, 2.1 kg m² break the triangle inequality"),
    "inertia without mass": (with_body(body(0.0)), "b", "inertia but no mass"),
    "link twice": (replace(GOOD, links=(*GOOD.links, Link("a"))), "a", "2 links are called 'a'"),
    "joint twice": (with_joint(name="ja"), "ja", "2 joints are called 'ja'"),
    "loop twice": (replace(GOOD, loops=GOOD.loops * 2), "la", "2 loops are called 'la'"),
    "universe": (with_joint(name="universe"), "universe", "'universe'"),
    "zero axis": (with_joint(axis=np.zeros(3)), "jb", "unit vector"),
    "long axis": (with_joint(axis=np.array([0, 0, 2.0])), "jb", "unit vector"),
    "axis nan": (with_joint(axis=np.array([0, 0, NAN])), "jb", "unit vector"),
    "axis shape": (with_joint(axis=np.ones(1)), "jb", "unit vector"),
    "placement nan": (with_joint(placement=pin.SE3(np.eye(3), np.full(3, NAN))), "jb", "not finite"),
    "placement sheared": (with_joint(placement=SHEARED), "jb", "whose rotation is none"),
    "missing parent": (with_joint(parent="c"), "jb", "missing parent link 'c'; the links are: a, b, base"),
    "missing child": (with_joint(child="c"), "jb", "missing child link 'c'"),
    "kind": (with_joint(kind=JointKind.PLANAR), "jb", "type 'planar' in the tree"),
    "limits": (with_joint(lower=1.0, upper=-1.0), "jb", "lower limit 1 above upper limit -1"),
    "limit nan": (with_joint(lower=NAN), "jb", "lower limit nan"),
    "effort": (with_joint(effort=-1.0), "jb", "effort limit -1"),
    "velocity": (with_joint(velocity=NAN), "jb", "velocity limit nan"),
    "motor kind": (with_joint(kind=JointKind.FIXED, independent=True), "jb", "marked independent"),
    "two parents": (with_joint(child="a"), "a", "'ja' and 'jb'"),
    "two roots": (replace(GOOD, links=(*GOOD.links, Link("c"))), "c", "without a parent: base, c"),
    "no link": (Mechanism("empty", (), (), source="good.urdf"), "empty", "has no <link>"),
    "no ground": (
        replace(GOOD, joints=(*GOOD.joints, Joint("jc", JointKind.FIXED, "b", "base", ONE))), "a", "cycle of joints",
    ),
    "own child": (with_joint(parent="b"), "b", "cycle of joints"),
    "loop to itself": (with_loop(link1="b"), "la", "joins link 'b' to itself"),
    "loop link": (with_loop(link1="c"), "la", "missing predecessor link 'c'"),
    "loop link 2": (with_loop(link2="c"), "la", "missing successor link 'c'"),
    "loop kind": (with_loop(kind=JointKind.FLOATING), "la", "type 'floating'"),
    "loop axis": (with_loop(axis=np.zeros(3)), "la", "unit vector"),
    "loop axis2": (with_loop(axis2=np.ones(3)), "la", "unit vector"),
    "loop placement": (with_loop(placement2=SHEARED), "la", "whose rotation is none"),
    "rod": (with_loop(kind=JointKind.DISTANCE), "la", "keeps the distance 0 m"),
    "rod of round-off": (with_loop(kind=JointKind.DISTANCE, length=5e-17), "la", "a ball where the two points"),
    "platform": (replace(GOOD, platform="c"), "c", "missing link 'c'"),
    "home": (replace(GOOD, home={"jc": np.zeros(1)}), "jc", "missing joint 'jc'"),
}  # fmt: skip


@pytest.mark.parametrize(("mechanism", "culprit", "words"), BROKEN.values(), ids=BROKEN)
def test_refusals_name_the_culprit(mechanism: Mechanism, culprit: str, words: str) -> None:
    with pytest.raises(MechanismError) as caught:
        validate(mechanism)
    assert caught.value.culprit == culprit
    assert words in str(caught.value) and culprit in str(caught.value)
    assert caught.value.path == mechanism.source and mechanism.source in str(caught.value)


def test_mechanisms_pass() -> None:
    validate(GOOD)
    validate(with_body(body(1.0, moments=(0, 0, 0))))  # a point
    validate(with_body(body(0.0, moments=(0, 0, 0))))  # nothing
    validate(with_body(body(1.0, moments=(1, 0, 1))))  # a thin rod


def test_a_thin_rod_printed_with_ten_digits_passes() -> None:
    turn = pin.exp3(np.array([0.3, 0.4, 0.5]))
    printed = np.round(turn @ np.diag([1.0, 1.0, 0.0]) @ turn.T, 10)
    assert broken_triangle(printed) is None
    assert broken_triangle(printed + np.diag([0, 0, -1e-6])) is not None


def bar_of(mass: float, size: float, moments: tuple[float, ...], away: float = 0.0) -> Mechanism:
    """One hinge at some distance from the world's origin, and on it a body with its centre of mass aside."""
    inertia = pin.Inertia(mass, np.array([size, 0.0, 0.0]), np.zeros((3, 3)))
    inertia.inertia = np.diag(moments)
    place = pin.SE3(np.eye(3), np.array([away, 0.0, 0.0]))
    joint = Joint("hinge", JointKind.REVOLUTE, "base", "bar", place)
    return Mechanism("bar", (Link("base"), Link("bar", inertia)), (joint,))


@pytest.mark.parametrize("away", [0.0, 100.0])
@pytest.mark.parametrize(("mass", "size"), [(1e-18, 1e-6), (1e-9, 1e-4), (1.0, 0.1), (1e4, 30.0)])
def test_moments_are_judged_by_mass_and_size(mass: float, size: float, away: float) -> None:
    """Of a body of any size: what no body has is refused, what turning leaves of nothing passes."""
    moment = mass * size**2
    validate(bar_of(mass, size, (moment, moment, moment), away))
    with pytest.raises(MechanismError, match="negative principal moment"):
        validate(bar_of(mass, size, (-0.1 * moment, moment, moment), away))
    with pytest.raises(MechanismError, match="triangle"):
        validate(bar_of(mass, size, (0.1 * moment, 0.1 * moment, moment), away))
    left = 1e-16 * moment
    validate(bar_of(mass, size, (0.0, left, -left), away))
    with pytest.raises(MechanismError, match="negative principal moment"):
        validate(bar_of(mass, size, (0.0, 0.0, -1e-12 * moment), away))


FILES = {
    "negative mass": (link("shell", INERTIAL.replace('mass value="1"', 'mass value="-1"')), "negative mass -1"),
    "negative moment": (link("shell", INERTIAL.replace('izz="1"', 'izz="-1"')), "negative principal moment -1"),
    "no motor kind": (link("shell") + joint("j", "arm", "shell", "fixed", attributes=MOTOR), "marked independent"),
    "name twice": (link("arm"), "2 links are called 'arm'"),
    "missing link": (joint("j", "arm", "ghost"), "missing child link 'ghost'"),
    "second root": (link("island"), "without a parent: base, island"),
    "loop on one link": (loop("l", "spherical", "arm", "arm"), "joins link 'arm' to itself"),
    "home": (home(ghost="0"), "missing joint 'ghost'"),
    "home size": (home(elbow="0 0"), "gives joint 'elbow' 2 values, it has 1"),
    "platform": ('<end_effector name="platform" parent_link="ghost"/>', "missing link 'ghost'"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), FILES.values(), ids=FILES)
def test_files_are_validated(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(MechanismError, match=words) as caught:
        stp.load(write(tmp_path, robot(*ARM, text)))
    assert caught.value.path.endswith("small.urdf")


def at_home(folder: Path, value: str, kind: str = "spherical") -> stp.ClosedChain:
    other = joint("fly", "base", "free", kind, axis="")
    return stp.load(write(folder, robot(*ARM, link("free"), other, home(fly=value))))


@pytest.mark.parametrize("value", ["0.48 0.52 0.71 0", "0.5 0.5 0.7 0", "1 0 0 0.02", "0.7 0 0 0.7"])
def test_a_quaternion_at_home_is_scaled_where_its_digits_explain_its_length(
    tmp_path: Path, value: str
) -> None:
    numbers = np.array(value.split(), float)
    for kind, before in (("spherical", ""), ("floating", "1 2 3 ")):
        chain = at_home(tmp_path, before + value, kind)
        fly = chain.model.joints[chain.model.getJointId("fly")]
        ours = chain.q_home[fly.idx_q : fly.idx_q + fly.nq][-4:]
        np.testing.assert_allclose(ours, numbers / np.linalg.norm(numbers), atol=1e-15)
        told = "scaled to length one, as its digits leave open (joint 'fly' of the home configuration)"
        assert f"changed: its quaternion was {told}" in str(chain.report)
    assert "scaled" not in str(at_home(tmp_path, "0 0.6 0.8 0").report)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("0 0 0 0", "'0 0 0 0' is of length 0; write x y z w of length one, 0 0 0 1 is no turn"),
        ("0 0 3 4", "'0 0 3 4' is of length 5; write x y z w of length one, as a turn: 0 0 0.6 0.8"),
        ("0.480 0.521 0.711 0.001", "is of length 1.0"),
        ("0.5 0.5 0.5 0.8", "is of length 1.17"),
    ],
)
def test_a_quaternion_at_home_of_another_length_is_refused(tmp_path: Path, value: str, words: str) -> None:
    with pytest.raises(MechanismError, match=rf"small.urdf: joint 'fly' of the home .*{words}"):
        at_home(tmp_path, value)


def test_a_coupling_to_a_joint_that_closes_a_loop_says_so() -> None:
    geared = replace(GOOD, couplings=(Coupling("gear", "ja", "la", (0.0, 2.0)),))
    with pytest.raises(MechanismError, match="names joint 'la', which closes a loop"):
        validate(geared)
