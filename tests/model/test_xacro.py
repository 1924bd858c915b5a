"""Files of xacro are what xacro makes of them, and are read in one call."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MissingExtraError

HEAD = '<?xml version="1.0"?><robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
BEAM = """<xacro:macro name="beam" params="name parent x">
  <link name="${name}"><inertial><origin xyz="${x/2} 0 0"/><mass value="${2*x}"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn_${name}" type="continuous"><parent link="${parent}"/><child link="${name}"/>
    <origin xyz="${x} 0 0"/><axis xyz="0 0 1"/></joint>
</xacro:macro>"""
CALLS = '<link name="base"/><xacro:beam name="a" parent="base" x="0.5"/><xacro:beam name="b" parent="a" x="${far}"/>'
FAR = '<xacro:arg name="far" default="0.25"/><xacro:property name="far" value="$(arg far)"/>'


def write(path: Path, *parts: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(HEAD + "".join(parts) + "</robot>")
    return path


@pytest.mark.parametrize("name", ["arm.xacro", "arm.urdf.xacro", "arm.urdf"])
def test_macros_properties_and_arguments(name: str, tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    chain = stp.load(write(tmp_path / name, BEAM, FAR, CALLS))
    assert [joint.name for joint in chain.mechanism.joints] == ["turn_a", "turn_b"]
    np.testing.assert_array_equal(chain.mechanism.joint("turn_b").placement.translation, [0.25, 0, 0])
    inertia = chain.mechanism.link("b").inertia
    assert inertia is not None and inertia.mass == 0.5 and inertia.lever[0] == 0.125


def test_macros_are_written_out_once_for_one_load_and_again_for_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    xacro = pytest.importorskip("xacro")
    calls: list[str] = []
    process = xacro.process_file
    monkeypatch.setattr(xacro, "process_file", lambda name: calls.append(name) or process(name))
    path = write(tmp_path / "arm.xacro", BEAM, FAR, CALLS)
    stp.load(path)
    assert calls == [str(path)]
    write(path, BEAM, FAR.replace("0.25", "0.75"), CALLS)
    assert stp.load(path).mechanism.joint("turn_b").placement.translation[0] == 0.75


@pytest.mark.parametrize("folder", ["arms", "src"])
def test_included_files_stand_beside_or_in_the_package(folder: str, tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    root = tmp_path / folder
    write(root / "macros" / "beam.xacro", BEAM)
    (root / "package.xml").write_text("<package><name>arms</name></package>")
    for place in ("../macros/beam.xacro", "$(find arms)/macros/beam.xacro"):
        path = write(root / "robots" / "arm.xacro", f'<xacro:include filename="{place}"/>', FAR, CALLS)
        assert stp.load(path).nv == 2
    with pytest.raises(FileFormatError, match=r"xacro refuses the file: .*\$\(find legs\), as no folder"):
        stp.load(write(path, '<xacro:include filename="$(find legs)/beam.xacro"/>'))


def test_what_makes_no_robot_is_refused_in_words(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    with pytest.raises(
        FileFormatError, match="defines macros of xacro alone, and no robot; load the file that calls"
    ):
        stp.load(write(tmp_path / "beam.xacro", BEAM))
    with pytest.raises(FileFormatError, match=r"xacro refuses the file: .*'far' is not defined"):
        stp.load(write(tmp_path / "arm.xacro", BEAM, CALLS))
    with pytest.raises(
        FileFormatError, match=r"xacro refuses the file: xacro:arg: missing attribute 'default'"
    ):
        stp.load(write(tmp_path / "arm.xacro", BEAM, FAR.replace('default="0.25"', ""), CALLS))
    with pytest.raises(FileFormatError, match="<!DOCTYPE"):
        path = write(tmp_path / "arm.xacro", BEAM, FAR, CALLS)
        path.write_text(path.read_text().replace("<robot", '<!DOCTYPE a [<!ENTITY b "c">]><robot', 1))
        stp.load(path)


def test_without_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[xacro\]"):
        stp.load(write(tmp_path / "arm.xacro", BEAM, FAR, CALLS))
