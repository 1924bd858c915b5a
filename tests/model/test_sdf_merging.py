"""Models that are merged into the one that includes them, against the same file included without merging."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, UnsupportedError
from stewart_pin.model.formats.sdf import read_sdf
from tests.model.sdf_reading import standing
from tests.small_sdf import BODY, TURNED, axis2, frame, joint, link, sdf, write

BASE = (link("base", "1 2 3 0.1 0.2 0.3"), joint("hold", "world", "base", "fixed", xyz=""))
MESH = "<visual name='v'><geometry><mesh><uri>look.stl</uri></mesh></geometry></visual>"
ARM = (
    "<pose>4 5 6 0.3 0.2 0.1</pose>",
    link("upper", TURNED, BODY + MESH),
    link("lower"),
    link("hand", "0.1 0.2 0.3 0.4 0.5 0.6", relative_to="lower"),
    frame("tip", "0 0 1 0.2 0 0"),
    frame("grip", "0 0 0.5 0 0 0.3", attached_to="hand", relative_to="__model__"),
    joint("elbow", "upper", "lower", xyz="0 1 0.5", expressed_in="__model__", pose="0.1 0 0 0 0.3 0"),
    joint(
        "wrist", "lower", "hand", "universal", pose=TURNED, relative_to="__model__", content=axis2("1 0 0")
    ),
    joint("pinned", "__model__", "spare", "fixed", xyz=""),
    link("spare", "0 0 2 0 0 0"),
)
PLACED = "<pose relative_to='base'>0.5 -0.2 0.1 0.4 -0.3 0.2</pose>"


def read_both(folder: Path, place: str, *arm: str) -> list[dict[str, np.ndarray]]:
    """Where the links stand, joints moved, merged and nested; names without the prefix."""
    write(folder, sdf(*(arm or ARM)).replace('name="small"', 'name="arm"'), "arm.sdf")
    found: list[dict[str, np.ndarray]] = []
    for merge, prefix in ((' merge="true"', ""), ("", "arm::")):
        mount = joint("mount", "base", f"{prefix}upper")
        include = f"<include{merge}><uri>arm.sdf</uri>{place}</include>"
        mechanism = read_sdf(write(folder, sdf(*BASE, include, mount)))
        values = {"mount": 0.3, f"{prefix}elbow": 0.4, f"{prefix}wrist_1": -0.7, f"{prefix}wrist_2": 0.9}
        places = standing(mechanism, **values)
        found.append({name.replace("arm::", ""): place.homogeneous for name, place in places.items()})
        assert len(mechanism.joints) == len(set(joint.name for joint in mechanism.joints))
    return found


@pytest.mark.parametrize("place", ["", PLACED, "<pose degrees='true'>1 0 0 30 0 60</pose>"])
def test_a_merged_model_stands_where_a_nested_one_does(tmp_path: Path, place: str) -> None:
    merged, nested = read_both(tmp_path, place)
    assert merged.keys() == nested.keys() and {"hand", "tip", "grip", "spare"} <= merged.keys()
    for name in nested:
        np.testing.assert_allclose(merged[name], nested[name], atol=1e-14, err_msg=name)


def test_names_files_and_notes_of_a_merged_model(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    write(tmp_path / "parts", sdf(*ARM, "<static>true</static>"), "arm.sdf")
    include = '<include merge="true"><uri>parts/arm.sdf</uri></include>'
    mechanism = read_sdf(write(tmp_path, sdf(*BASE, include, joint("mount", "base", "upper"))))
    names = [link.name for link in mechanism.links]
    assert not any(name.startswith("_merged__") for name in names) and "arm" not in " ".join(names)
    shape = mechanism.link("upper").visuals[0]
    assert Path(shape.folder, shape.mesh) == (tmp_path / "parts" / "look.stl").resolve()
    told = " ".join(note.text for note in mechanism.notes)
    assert "frames of 'parts/arm.sdf' are merged into the model" in told
    assert "<static>: left out of a merged model" in told
    chain = stp.load(tmp_path / "small.sdf")
    assert chain.nv == 4  # mount, elbow, and the two of the wrist


REFUSED = {
    "older": (sdf(*ARM, version="1.6"), "", UnsupportedError, "older than version 1.7"),
    "nested": (
        sdf(*ARM, "<include><uri>x</uri></include>"),
        "",
        UnsupportedError,
        "it includes other models",
    ),
    "placed": (sdf(*ARM, attributes='placement_frame="tip"'), "", UnsupportedError, "by a placement_frame"),
    "placed here": (sdf(*ARM), "<placement_frame>tip</placement_frame>", UnsupportedError, "placement_frame"),
    "parameters": (sdf(*ARM), "<experimental:params/>", UnsupportedError, "changes the model of 'arm.sdf'"),
    "no link": (sdf(frame("tip")), "", FileFormatError, "and has no <link>; include it without merge"),
    "a name twice": (sdf(link("base")), "", FileFormatError, "are called 'base'; rename one"),
}


@pytest.mark.parametrize(("arm", "more", "kind", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_not_merged(tmp_path: Path, arm: str, more: str, kind: type[Exception], words: str) -> None:
    write(tmp_path, arm, "arm.sdf")
    include = f'<include merge="true"><uri>arm.sdf</uri>{more}</include>'
    with pytest.raises(kind, match=rf"small\.sdf.*{words}|arm\.sdf.*{words}"):
        read_sdf(write(tmp_path, sdf(*BASE, include)))


def test_a_world_merges_nothing(tmp_path: Path) -> None:
    write(tmp_path, sdf(*ARM), "arm.sdf")
    text = (
        '<sdf version="1.9"><world name="w"><include merge="true"><uri>arm.sdf</uri></include></world></sdf>'
    )
    with pytest.raises(UnsupportedError, match="into a world, which has no links; let a <model> include it"):
        read_sdf(write(tmp_path, text))
