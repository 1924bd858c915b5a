"""A file is written whole or not at all, whatever fails; places where none can stand are named with a remedy."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, InputError
from stewart_pin.model.formats.dialect import dialects
from tests.mechanisms import four_bar

FORMATS = (*(dialect.name for dialect in dialects() if dialect.write is not None), "sdf", "mjcf")
END = {"sdf": ".sdf", "mjcf": ".xml"}


def place(folder: Path, format: str) -> Path:
    return folder / f"a{END.get(format, '.urdf')}"


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file(
    format: str, step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = place(tmp_path, format)
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(*((os, "fsync", full) if step == "fsync" else (Path, "replace", full)))
    with pytest.raises(InputError, match=r"path: cannot write .*No space left on device"):
        stp.export(four_bar(), path, format=format)
    assert [file.name for file in tmp_path.iterdir()] == [path.name] and path.read_text() == "old"


def test_of_two_files_none_is_put_before_both_are_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain, order, replace = four_bar(), list[str](), Path.replace

    def noted(self: Path, to: Path) -> Path:
        order.append(to.suffix)
        return replace(self, to)

    monkeypatch.setattr(Path, "replace", noted)
    stp.export(chain, tmp_path / "a.urdf", format="gepetto")
    assert order == [".yaml", ".urdf"]
    assert [loop.name for loop in stp.load(tmp_path / "a.urdf").loops] == ["pin"]


def test_links_permissions_and_other_names(tmp_path: Path) -> None:
    chain, real, link, other = four_bar(), tmp_path / "real.urdf", tmp_path / "a.urdf", tmp_path / "b.urdf"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real.name)
    os.link(real, other)
    stp.write_urdf(chain, link)
    assert link.is_symlink() and stp.load(real).name == chain.name
    assert real.stat().st_mode & 0o777 == 0o640
    assert other.read_text() == "old"
    mask = os.umask(0o027)
    try:
        stp.write_urdf(chain, tmp_path / "new.urdf")
    finally:
        os.umask(mask)
    assert (tmp_path / "new.urdf").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("format", FORMATS)
def test_places_where_no_file_can_stand(format: str, tmp_path: Path) -> None:
    chain, path = four_bar(), place(tmp_path, format)
    path.mkdir()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    places: list[tuple[Any, str]] = [
        (path, "it is a folder; give the name of a file in it"),
        (tmp_path / "none" / path.name, "does not exist; make it first"),
        (pipe, "it is no plain file"),
        (tmp_path / "a.yaml", "ends as a file beside a URDF does; give the URDF's name, as 'a.urdf'"),
        ("", "path must name a file"),
        (7, "path must name a file"),
    ]
    for bad, words in places:
        with pytest.raises(InputError, match=words):
            stp.export(chain, bad, format=format)
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([path.name, "pipe"])


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_what_is_protected_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_text("old")
    path.chmod(0o444)
    with pytest.raises(InputError, match="write-protected; allow writing"):
        stp.write_urdf(four_bar(), path)


@pytest.mark.parametrize("format", ["urdf+", "drake", "isaac"])
def test_a_yaml_that_was_left_beside_is_noted_and_not_read(format: str, tmp_path: Path) -> None:
    """Each loop would be there twice, and its reactions half as large."""
    stp.export(four_bar(), tmp_path / "a.urdf", format="gepetto")
    chain = stp.load(tmp_path / "a.urdf")
    report = stp.export(chain, tmp_path / "a.urdf", format=format)
    assert "file 'a.yaml' beside it" in str(report)
    assert len(stp.load(tmp_path / "a.urdf").loops) == 1
    words = r"has all its loops, and a\.yaml would add them again"
    with pytest.raises(FileFormatError, match=words):
        stp.load(tmp_path / "a.urdf", loops=tmp_path / "a.yaml")
    with pytest.raises(FileFormatError, match=words):
        stp.load(tmp_path / "a.yaml")


def test_a_path_that_no_file_can_have(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="path must name a file"):
        stp.export(four_bar(), str(tmp_path / "a\0.urdf"))
