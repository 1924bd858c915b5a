"""What the reader of SDFormat does not understand is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, UnsupportedError
from tests.small_sdf import frame, joint, link, sdf, write

A = link("a")
ODD = {
    "no version": ("<sdf><model name='m'/></sdf>", r"lacks 'version'"),
    "an old version": ("<sdf version='1.2'><model name='m'/></sdf>", r"versions 1\.3 to 1\.12 are read"),
    "a version in words": ("<sdf version='new'><model name='m'/></sdf>", "'new'"),
    "no model": ("<sdf version='1.9'/>", "keep one"),
    "two models": ("<sdf version='1.9'><model name='m'/><model name='n'/></sdf>", "2 <model>.*'m', 'n'"),
    "no link": (sdf(), "has no <link>"),
    "a reserved name": (sdf(link("world")), "'world', which SDFormat keeps for itself"),
    "two links of a name": (sdf(A, A), r"a <link> and a <link> \(line 1\).*'a'; rename one"),
    "a link and a joint of a name": (sdf(A, joint("a", "world", "a")), "a <link> and a <joint>"),
    "a missing frame": (sdf(link("a", "0 0 0 0 0 0", relative_to="nobody")), "names the frame 'nobody'.*has: a"),
    "a missing child": (sdf(A, joint("j", "world", "nobody")), "names the frame 'nobody'"),
    "the world as child": (sdf(A, joint("j", "a", "world")), "the world as its child; make it the parent"),
    "a link with itself": (sdf(A, joint("j", "a", "a")), "joins link 'a' to itself"),
    "frames in a circle": (
        sdf(A, link("b", relative_to="c"), link("c", relative_to="b")),
        "stand in each other in a circle",
    ),
    "frames attached in a circle": (
        sdf(A, frame("f", attached_to="g"), frame("g", attached_to="f")),
        "in a circle",
    ),
    "an unknown type": (sdf(A, joint("j", "world", "a", "piston")), "type 'piston'; supported: ball, continuous"),
    "no axis": (sdf(A, joint("j", "world", "a", xyz="")), "needs a <axis>"),
    "an axis of zero": (sdf(A, joint("j", "world", "a", xyz="0 0 0")), "axis of length zero"),
    "half a pose": (sdf(link("a", "1 2 3")), r"<pose> \(line 1\) must hold 6 numbers"),
    "a pose in a frame of a wrong word": (
        sdf(link("a", "1 2 3 0 0 0").replace("<pose", "<pose relativ_to='b'")),
        "attribute 'relativ_to' of <pose>.*is not understood; it may have relative_to",
    ),
    "an axis in a frame of a wrong word": (
        sdf(A, joint("j", "world", "a").replace("<xyz", "<xyz frame='b'")),
        "attribute 'frame' of <xyz>",
    ),
    "an infinite pose": (sdf(link("a", "1 2 inf 0 0 0")), "must be finite"),
    "a new flag in an old way": (
        sdf(A, joint("j", "world", "a", axis="<use_parent_model_frame>1</use_parent_model_frame>")),
        "ended with version 1.6; write <xyz expressed_in='__model__'>",
    ),
    "a screw without thread": (sdf(A, joint("j", "world", "a", "screw")), "give <screw_thread_pitch>"),
    "a screw of no pitch": (
        sdf(A, joint("j", "world", "a", "screw", content="<thread_pitch>0</thread_pitch>")),
        "must not be zero",
    ),
    "a screw of no lead": (
        sdf(A, joint("j", "world", "a", "screw", content="<screw_thread_pitch>0</screw_thread_pitch>")),
        "is a screw that does not travel; write a revolute joint",
    ),
    "a leader that is missing": (
        sdf(A, joint("j", "world", "a", axis='<mimic joint="k"/>'), version="1.11"),
        "mimics the axis of joint 'k', which does not exist",
    ),
    "a joint that mimics itself": (
        sdf(A, joint("j", "world", "a", axis='<mimic joint="j"/>'), version="1.11"),
        "mimics itself",
    ),
    "a plugin that couples": (
        sdf(A, '<plugin name="m" filename="libmimic_joint.so"/>'),
        "could hold or couple links while the simulation runs",
    ),
    "a plugin with a mimic": (
        sdf(A, '<plugin name="p" filename="libcontrol.so"><mimicJoint>j</mimicJoint></plugin>'),
        "could hold or couple",
    ),
    "a plugin that holds": (
        sdf(A, '<plugin name="gz::sim::systems::DetachableJoint" filename="gz-sim-detachable-joint-system"/>'),
        "could hold or couple",
    ),
    "an unknown constraint": (sdf(A, "<loop_constraint/>"), "could close a loop"),
    "a bushing": (
        sdf(
            A,
            "<drake:linear_bushing_rpy><drake:bushing_force_stiffness>1 1 1</drake:bushing_force_stiffness>"
            "<drake:bushing_torque_stiffness>0 0 1</drake:bushing_torque_stiffness></drake:linear_bushing_rpy>",
        ),
        "springs that stand for no joint",
    ),
    "a tendon": (sdf(A, "<drake:tendon_constraint/>"), "is not understood; write <mimic>"),
    "a curved joint": (sdf(A, '<drake:joint name="c" type="curvilinear"/>'), "type 'curvilinear'; supported: planar"),
    "a kinematic link": (sdf(link("a", content="<kinematic>1</kinematic>")), "something outside the model moves it"),
    "inertia from shapes": (sdf(link("a", content='<inertial auto="true"/>')), "write <mass> and <inertia>"),
    "added mass": (
        sdf(link("a", content="<inertial><fluid_added_mass/></inertial>")),
        "<fluid_added_mass>, which no rigid body has",
    ),
    "a static robot": (
        sdf("<static>true</static>", A, joint("j", "world", "a")),
        "is static, so that its joints cannot move",
    ),
    "an odd flag": (sdf("<static>maybe</static>", A), "must be true or false, got 'maybe'"),
    "an include with parameters": (
        sdf("<include><uri>x.sdf</uri><experimental:params/></include>"), "changes the model of 'x.sdf'"
    ),
    "an include by name": (
        sdf("<include><uri>model://arm</uri></include>"),
        "'model://arm' would be looked up in a simulator's model path; give the path",
    ),
    "an include of nothing": (sdf("<include><uri>nothing.sdf</uri></include>"), "no such file"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), ODD.values(), ids=ODD)
def test_what_is_not_understood_is_refused_in_words(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises((FileFormatError, UnsupportedError), match=words) as caught:
        stp.load(write(tmp_path, text), motors=["j"], platform="a")
    assert str(tmp_path) in str(caught.value)
