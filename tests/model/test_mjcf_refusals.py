"""What the reader of MJCF refuses, and what MuJoCo's compiler says or asks for on the way."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MissingExtraError
from tests.model.small_mjcf import (
    ARM,
    BALL,
    BOTH,
    body,
    hinge,
    mjcf,
    notes,
    read,
    write,
)

pytest.importorskip("mujoco")

CLOTH = '<flexcomp type="grid" count="3 3 1" name="cloth" dim="2" radius="0.01"><edge equality="true"/></flexcomp>'
REFUSED = {
    "another root": ("<mujocoinclude/>", "<mujocoinclude>"),
    "unknown tag": (mjcf(BOTH, "<springs/>"), "unrecognized element"),
    "unknown attribute": (mjcf(BOTH.replace("axis=", "achse=")), "unrecognized attribute"),
    "no mass": (mjcf('<body name="a"><joint/></body>'), "mass and inertia of moving bodies"),
    "two names": (mjcf(BOTH + BOTH), "repeated name 'arm'"),
    "not a number": (mjcf(BOTH.replace("0.5 0 0", "0 NaN 0")), r"pos of <body> \(line 1\) holds 'nan'"),
    "no number of one word": (mjcf(BOTH, '<custom><numeric name="a" data="nan"/></custom>'), r"data of <numeric>"),
    "overflow": (mjcf(BOTH.replace("0.5 0 0", "0 1e40 0")), "'body_pos' that are not finite"),
    "deformable": (mjcf(body("hand", hinge("j") + BALL + CLOTH)), "<flexcomp>.*deformable"),
    "much cloth": (mjcf(BOTH + CLOTH.replace("3 3 1", "999 999 999")), "<flexcomp>.*few points"),
    "replicas": (mjcf(f'<replicate count="30000">{BOTH}</replicate>'), "more than 20000 elements"),
    "nested replicas": (
        mjcf(f'<replicate count="300"><replicate count="300">{BOTH}</replicate></replicate>'),
        "more than 20000 elements",
    ),
    "height field": (
        mjcf(BOTH, '<asset><hfield name="h" nrow="90000" ncol="90000" size="1 1 1 1"/></asset>'),
        "more than 4000000 cells",
    ),
    "fine mesh": (
        mjcf(BOTH, '<asset><mesh name="m" builtin="supersphere" params="900 1 1"/></asset>'),
        "resolution above 200",
    ),
    "absent include": (mjcf(BOTH, '<include file="nowhere.xml"/>'), "nowhere.xml"),
    "itself": (mjcf(BOTH, '<include file="small.xml"/>'), "already included"),
    "absent mesh": (
        mjcf(
            '<body name="a"><joint/><geom type="mesh" mesh="m"/></body>',
            '<asset><mesh name="m" file="nowhere.stl"/></asset>',
        ),
        "nowhere.stl.*give it an <inertial>",
    ),
    "document type": ("<!DOCTYPE mujoco []>" + mjcf(BOTH), "<!DOCTYPE"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), REFUSED.values(), ids=REFUSED)
def test_refusals_name_the_file_and_the_fault(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.load(path)
    assert str(path) in str(caught.value)
    # What is refused would take MuJoCo minutes, or all memory.
    assert time.perf_counter() - start < 2.0


def test_included_files_are_searched_as_well(tmp_path: Path) -> None:
    write(tmp_path, '<!DOCTYPE a [<!ENTITY b "c">]><mujocoinclude/>', "part.xml")
    with pytest.raises(FileFormatError, match=r"part\.xml: a document type declaration"):
        read(tmp_path, BOTH, '<include file="part.xml"/>')
    write(tmp_path, f"<mujocoinclude>{BOTH}</mujocoinclude>", "part.xml")
    assert read(tmp_path, '<include file="part.xml"/>').link("hand").inertia is not None


@pytest.mark.parametrize("held", [CLOTH, f'<body name="table" pos="0 0 1">{CLOTH}</body>'])
def test_deformable_bodies_on_the_ground_are_left_out(tmp_path: Path, held: str) -> None:
    found = read(tmp_path, BOTH + held)
    assert "hangs on no link" in notes(found)
    assert {j.name for j in found.joints} - {"table_fixed"} == {j.name for j in read(tmp_path, BOTH).joints}


def test_deformable_bodies_of_attached_models_are_refused(tmp_path: Path) -> None:
    write(tmp_path, mjcf(f'<body name="tool">{CLOTH}</body>'), "part.xml")
    hand = body("hand", hinge("wrist") + '<frame><attach model="p" body="tool" prefix="a_"/></frame>' + BALL)
    with pytest.raises(FileFormatError, match=r"<flexcomp>.*deformable"):
        read(tmp_path, ARM % hand, '<asset><model name="p" file="part.xml"/></asset>')


def test_warnings_of_the_compiler_are_in_the_report(tmp_path: Path) -> None:
    twice = body("arm", hinge("a") + hinge("b"))
    assert "MuJoCo warns: Inertia matrix is too close to singular" in notes(read(tmp_path, twice))


def test_attached_models_are_read_where_they_stand(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="no.stl"/></asset>'
    part = f'<body name="tool" pos="0 0 1">{hinge("turn")}{BALL}<geom type="mesh" mesh="m"/></body>'
    write(tmp_path, mjcf(part, mesh), "part.xml")
    hand = body(
        "hand", hinge("wrist") + '<frame pos="0 2 0"><attach model="p" body="tool" prefix="a_"/></frame>'
    )
    found = read(tmp_path, ARM % hand, '<asset><model name="p" file="part.xml"/></asset>')
    turn = found.joint("a_turn")
    assert (turn.parent, turn.child) == ("hand", "a_tool")
    np.testing.assert_array_equal(turn.placement.translation, [0, 2, 1])


SIZES = ('memory="900T"', 'nkey="2000000000"', 'nuserdata="2000000000"', 'nuser_jnt="2000000000"')


@pytest.mark.parametrize("size", SIZES)
def test_memory_that_a_file_asks_for_is_not_set_aside(tmp_path: Path, size: str) -> None:
    assert read(tmp_path, BOTH, f"<size {size}/>").link("hand").inertia is not None


def test_files_without_weight_need_not_exist(tmp_path: Path) -> None:
    """Meshes, pictures and height fields that no inertia depends on; the arm's inertia stands in the file."""
    assets = (
        '<asset><mesh name="m" file="no.stl"/><texture name="t" type="2d" file="no.png"/>'
        '<material name="t" texture="t"/><hfield name="h" file="no.png" size="1 1 1 1"/>'
        '<mesh name="light" file="no.obj"/></asset>'
    )
    inside = '<geom type="mesh" mesh="m" material="t"/><geom name="g" type="mesh" mesh="m"/>'
    ground = '<geom type="hfield" hfield="h"/><geom type="mesh" mesh="m" name="f"/>'
    shapes = '<geom size="0.1"/><geom type="mesh" mesh="light" mass="0"/>'
    round_body = f'<body name="round"><joint name="r"/>{shapes}</body>'
    pair = '<contact><pair geom1="g" geom2="f"/></contact>'
    found = read(tmp_path, ground + ARM % inside + round_body, assets, pair)
    assert found.link("arm").inertia.mass == 1.3
    # A ball of water of radius 0.1 m.
    np.testing.assert_allclose(found.link("round").inertia.mass, 4 / 3 * np.pi, rtol=1e-12)


def test_without_mujoco_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[mjcf\]"):
        stp.load(write(tmp_path, mjcf(BOTH)))


def test_nothing_is_written_beside_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo keeps a log of its warnings in the working directory."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError):
        read(tmp_path, BOTH.replace("0.5 0 0", "0 nan 0"))
    assert [path.name for path in tmp_path.iterdir()] == ["small.xml"]


def test_names_may_be_nan(tmp_path: Path) -> None:
    """A word that is no number is a name like any other, as MuJoCo has it."""
    text = '<body name="nan"><joint name="NaN"/><geom name="-nan" size="0.1"/></body>'
    motor = '<actuator><motor name="+nan" joint="NaN"/></actuator><custom><text name="platform" data="nan"/></custom>'
    chain = stp.load(write(tmp_path, mjcf(text, motor)))
    assert (chain.motors, chain.platform) == (("NaN",), "nan")
