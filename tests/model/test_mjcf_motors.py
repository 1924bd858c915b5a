"""Which actuators of MJCF are motors, in which order, and how strong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.model.small_mjcf import (
    BOTH,
    actuator,
    body,
    hinge,
    notes,
    read,
)

pytest.importorskip("mujoco")


def test_motors_stand_in_the_order_of_the_actuators(tmp_path: Path) -> None:
    arm = body("arm", hinge("a") + hinge("b", axis="0 1 0") + hinge("c", axis="1 0 0"))
    drives = actuator('<motor joint="c"/>', '<position joint="a" kp="3"/>', '<velocity joint="b" kv="3"/>')
    found = read(tmp_path, arm, drives)
    assert [joint.name for joint in found.joints if joint.independent] == ["c", "a", "b"]
    assert "its gains and dynamics" in notes(found)


EFFORTS = {
    "force": ('<motor joint="motor" forcerange="-3 3"/>', 3),
    "gear": ('<motor joint="motor" forcerange="-3 3" gear="-2"/>', 6),
    "control": ('<motor joint="motor" ctrlrange="-0.5 0.5" gear="8"/>', 4),
    "gain": ('<general joint="motor" gainprm="3" ctrlrange="-2 2"/>', 6),
    "smaller of both": ('<motor joint="motor" ctrlrange="-2 2" forcerange="-1 1"/>', 1),
    "angle of a servo": ('<position joint="motor" kp="5" ctrlrange="-1 1"/>', np.inf),
    "none": ('<motor joint="motor"/>', np.inf),
    "two": ('<motor joint="motor" forcerange="-1 1"/><motor joint="motor" forcerange="-2 2"/>', 3),
    "uneven": ('<motor joint="motor" forcerange="-1 4"/>', (-1, 4)),
    "uneven gear": ('<motor joint="motor" forcerange="-1 4" gear="-2"/>', (-8, 2)),
    "one side": ('<motor joint="motor" forcerange="0 4"/>', (0, 4)),
    "control of one side": ('<motor joint="motor" ctrlrange="0 4" forcerange="-1 1"/>', (0, 1)),
}


@pytest.mark.parametrize(("drive", "effort"), EFFORTS.values(), ids=EFFORTS)
def test_largest_efforts(tmp_path: Path, drive: str, effort: float | tuple[float, float]) -> None:
    found = read(tmp_path, BOTH, actuator(drive))
    assert found.joint("motor").effort == effort
    assert found.joint("motor").independent and not found.joint("wrist").independent
    assert "efforts" not in notes(found)


def test_the_joint_itself_may_limit_the_effort(tmp_path: Path) -> None:
    arm = body("arm", hinge("a", actuatorfrcrange="-2 2"))
    assert read(tmp_path, arm, actuator('<motor joint="a" forcerange="-3 3"/>')).joint("a").effort == 2
    assert read(tmp_path, arm).joint("a").effort == 2


NO_MOTORS = {
    "tendon": ('<motor name="m" tendon="t"/>', "acts on a tendon"),
    "site": ('<motor name="m" site="palm"/>', "acts on a site"),
    "body": ('<adhesion name="m" body="hand" ctrlrange="0 1"/>', "acts on a body"),
    "ball": ('<motor name="m" joint="ball"/>', "acts on joint 'ball', which has not one freedom"),
    "brake": ('<damper name="m" joint="motor" kv="2" ctrlrange="0 1"/>', "a brake"),
    "no gear": ('<motor name="m" joint="motor" gear="0"/>', "gear 0"),
}


@pytest.mark.parametrize(("drive", "words"), NO_MOTORS.values(), ids=NO_MOTORS)
def test_actuators_that_are_no_motors_are_named(tmp_path: Path, drive: str, words: str) -> None:
    tendon = '<tendon><fixed name="t"><joint joint="wrist" coef="1"/></fixed></tendon>'
    world = BOTH + body("c", '<joint type="ball" name="ball"/>')
    found = read(tmp_path, world, tendon, actuator(drive))
    assert not any(joint.independent for joint in found.joints)
    assert f"ignored actuator 'm' {words}" in notes(found)


@pytest.mark.parametrize("option", ['<flag actuation="disable"/>', 'actuatorgroupdisable="2"'])
def test_disabled_actuators_are_no_motors(tmp_path: Path, option: str) -> None:
    section = f"<option>{option}</option>" if option.startswith("<") else f"<option {option}/>"
    drives = actuator(
        '<motor name="m" joint="motor" group="2"/>', '<motor name="n" joint="wrist" group="1"/>'
    )
    found = read(tmp_path, BOTH, drives, section)
    assert "actuator 'm' the file disables it: no motor" in notes(found)
    assert found.joint("wrist").independent == ("group" in option)
