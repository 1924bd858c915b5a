"""How finely files print their geometry."""

from __future__ import annotations

from pathlib import Path

import pytest

from stewart_pin.model.formats.precision import Precision, printed_precision

URDF = '<robot name="r"><joint name="j"><origin {}/><axis xyz="{}"/></joint>{}</robot>'
MJCF = '<mujoco>{}<worldbody><body {}><geom pos="0.12345 0 0"/></body></worldbody></mujoco>'
SDF = "<sdf><model><pose{}>{}</pose></model></sdf>"

FILES = {
    # Half a unit of the last digit, of numbers of four and more digits.
    "a short number is meant": (URDF.format('xyz="0.1 2 300"', "0 0 1", ""), Precision()),
    "a right angle": (URDF.format('xyz="0.1 0 0" rpy="1.5708 0 0"', "0 0 1", ""), Precision(0, 5e-5)),
    "a length": (URDF.format('xyz="0.12345 0 0"', "0 0 1", ""), Precision(5e-6, 0)),
    "an axis is a direction": (URDF.format("", "0.70711 0.70711 0", ""), Precision(0, 5e-6)),
    "trailing zeros are digits": (URDF.format('xyz="0.100000 0 0"', "0 0 1", ""), Precision(5e-7, 0)),
    "floats are exact": (URDF.format('xyz="0.1234567890123456 6.1e-17 0"', "0 0 1", ""), Precision()),
    "an exponent": (URDF.format('xyz="1.23456e-3 0 0"', "0 0 1", ""), Precision(5e-9, 0)),
    "masses place nothing": (
        URDF.format("", "0 0 1", '<link><inertial><origin xyz="0.1234 0 0"/></inertial></link>'),
        Precision(),
    ),
    "degrees": (MJCF.format("", 'euler="45.1234 0 0"'), Precision(0, 5e-5 * 3.141592653589793 / 180)),
    "radians": (MJCF.format('<compiler angle="radian"/>', 'euler="0.7854 0 0"'), Precision(0, 5e-5)),
    "a quaternion": (MJCF.format("", 'quat="0.70711 0.70711 0 0" pos="1.2345 0 0"'), Precision(5e-5, 5e-6)),
    "a pose": (SDF.format("", "0.12345 0 0 1.5708 0 0"), Precision(5e-6, 5e-5)),
    "a pose in degrees": (
        SDF.format(' degrees="true"', "0 0 0 45.1234 0 0"),
        Precision(0, 5e-5 * 3.141592653589793 / 180),
    ),
}


@pytest.mark.parametrize(("text", "right"), FILES.values(), ids=FILES)
def test_half_a_unit_of_the_last_digit(text: str, right: Precision, tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    found = printed_precision(path)
    assert found.length == pytest.approx(right.length) and found.angle == pytest.approx(right.angle)


def test_side_cars_count(tmp_path: Path) -> None:
    path, beside = tmp_path / "robot.urdf", tmp_path / "robot.yaml"
    path.write_text(URDF.format("", "0 0 1", ""))
    beside.write_text("closed_loop: true\nframe: [0.12345, 1]\n")
    found = printed_precision(path, beside)
    assert found.length == found.angle == pytest.approx(5e-6)
