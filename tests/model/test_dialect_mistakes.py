"""What is wrong with a tag of a dialect is said with its name and place."""

from __future__ import annotations

from pathlib import Path

import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError
from tests.model.small_dialects import DRAKE_BALL, ENDS, GAZEBO, TIPS, bushing, drake_joint
from tests.small_urdf import ARM, joint, link, robot, write

PIN = '<loop_joint name="pin" type="{kind}">{content}</loop_joint>'
LINKS = '<link1 link="arm"/><link2 link="base"/>'
MISTAKES = {
    "isaac type": (PIN.format(kind="screw", content=LINKS), "type 'screw'; supported: spherical"),
    "isaac end": (PIN.format(kind="ball", content='<link1 link="arm"/>'), "needs a <link1> and a <link2>"),
    "isaac axis": (PIN.format(kind="revolute", content=LINKS), "needs a <axis>"),
    "isaac tag": (PIN.format(kind="ball", content=f"{LINKS}<origin/>"), "<origin> of <loop_joint>"),
    "fusion axis": (
        PIN.format(kind="revolute", content=f'{ENDS}{TIPS}<axis xyz="0 0 1" frame="child"/>'),
        "<axis frame> must be 'parent'",
    ),
    "fusion origin": (PIN.format(kind="ball", content=ENDS), "needs a <parent_origin>"),
    "fusion link": (
        PIN.format(kind="fixed", content=f"{ENDS}{TIPS}"), "loop_joint 'pin' names the missing link 'rocker'",
    ),
    "drake body": (DRAKE_BALL.replace("body_A", "body_C"), "is <drake:ball_constraint_body_A> meant"),
    "drake text": (DRAKE_BALL.replace('value="1 0 0"', 'value="1 0"'), "must hold 3 numbers"),
    "drake type": (drake_joint("curvilinear"), "type 'curvilinear'; supported: ball, planar, screw, universal"),
    "drake pitch": (drake_joint("screw"), "needs a <drake:screw_thread_pitch>"),
    "bushing": ("<drake:linear_bushing_rpy/>", "needs a <drake:bushing_force_stiffness>"),
    "bushing of one turn": (bushing("0 1 0"), "springs that stand for no joint"),
    "bushing of a plane": (bushing(force="1 1 0"), "springs that stand for no joint"),
    "bushing's frame": (bushing().replace('frameA name="', 'frameA name="x'), "missing frame 'xplatform_pin'"),
    "urdfdom type": (f'<constraint name="c" type="distance">{ENDS}</constraint>', "type 'distance'; supported"),
    "urdfdom axis": (f'<constraint name="c" type="revolute">{ENDS}</constraint>', "needs a <parent_axis>"),
    "gazebo type": (GAZEBO.format(kind="belt", axis=""), "type 'belt'; supported: fixed, revolute.*gearbox"),
    "gazebo gearbox": (GAZEBO.format(kind="gearbox", axis=""), "needs a <gearbox_reference_body>"),
    "gazebo axis": (GAZEBO.format(kind="revolute", axis=""), "needs a <axis>"),
    "gazebo link": (GAZEBO.format(kind="ball", axis=""), "names the missing link 'rocker'"),
    "gazebo pose": (GAZEBO.format(kind="ball", axis="").replace("0.4<", "<"), "<pose> must hold 6 numbers"),
    "coupling type": ('<coupling name="c" type="cam"/>', "type 'cam'; supported: rolling, polynomial"),
    "coupling ratio": (
        '<coupling name="c"><predecessor link="arm"/><successor link="base"/></coupling>', "needs a <ratio>",
    ),
    "half a pair": (
        link("closing_x_1", "") + joint("x", "arm", "closing_x_1", "fixed"), "the other half is missing",
    ),
    "mimic": (link("s") + joint("j", "base", "s", content='<mimic multiplier="2"/>'), "lacks 'joint'"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.load(write(tmp_path, robot(*ARM, text, attributes='xmlns:drake="http://drake.mit.edu"')))
    assert caught.value.culprit and str(tmp_path) in caught.value.path
