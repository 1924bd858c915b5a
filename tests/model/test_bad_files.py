"""Files that are broken, hostile or nonsense: one readable error, at once, and nothing outside the file is touched."""

from __future__ import annotations

import codecs
import time
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import stewart_pin as stp
from stewart_pin.errors import (
    FileFormatError,
    FileMissingError,
    InputError,
    MechanismError,
    UnsupportedError,
)
from tests.model.mutations import assert_loads_or_says_why, damaged, quick
from tests.small_urdf import ARM, bundled, link, robot, write

hypothesis = pytest.importorskip("hypothesis")

LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 20))
BOMB = f'<!DOCTYPE robot [<!ENTITY l0 "ha">{LAUGHS}]>'
BOMBED = f'<?xml version="1.0"?>{BOMB}<robot name="&l19;"/>'


def load_bytes(folder: Path, content: bytes) -> stp.ClosedChain:
    path = folder / "small.urdf"
    path.write_bytes(content)
    return stp.load(path)


CONTENTS = {
    "empty": (b"", "the file is empty"),
    "blank": (b" \n\t", "the file is empty"),
    "text": (b"hello", "not well-formed XML"),
    "cut off": (robot(*ARM)[:-20].encode(), r"not well-formed XML: .*\(line 1\)"),
    "wrong end": (b"<robot><link></robot>", "not well-formed XML"),
    "attribute twice": (b'<robot name="a" name="b"/>', "not well-formed XML"),
    "two roots": (b"<robot/><robot/>", "not well-formed XML"),
    "unknown entity": (b'<robot name="&boom;"/>', "not well-formed XML"),
    "too deep": (b"<robot>" + b"<a>" * 5000, "not well-formed XML"),
    "zero byte": (b'<robot name="a\0b"/>', "not well-formed XML"),
    "binary": (bytes(range(128, 256)), "not text in the encoding utf-8"),
    "another root": (b"<html/>", "the root element is <html>"),
    "empty robot": (b"<robot/>", "has no <link>"),
    "utf-7": (b'<?xml version="1.0" encoding="UTF-7"?>+ADw-robot/+AD4-', "encoding 'UTF-7' is refused"),
    "ebcdic": ('<?xml version="1.0"?><robot/>'.encode("cp037"), "not text in the encoding utf-8"),
    "unknown encoding": (
        b'<?xml version="1.0" encoding="klingon"?><robot/>',
        "encoding 'klingon' is refused",
    ),
    "odd utf-16": (codecs.BOM_UTF16_LE + b"<", "not text in the encoding utf-16"),
}


@pytest.mark.parametrize(("content", "words"), CONTENTS.values(), ids=CONTENTS)
def test_broken_files_are_named(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(FileFormatError, match=words) as caught:
        load_bytes(tmp_path, content)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1", "windows-1252"])
def test_encodings_that_are_read(tmp_path: Path, encoding: str) -> None:
    declared = "utf-8" if encoding == "utf-8-sig" else encoding
    text = f'<?xml version="1.0" encoding="{declared}"?>' + robot(*ARM).replace('"small"', '"Größe"')
    assert load_bytes(tmp_path, text.encode(encoding)).name == "Größe"


ENCODED_BOMBS = {
    "plain": BOMBED.encode(),
    "after a comment": BOMBED.replace("<!DOCTYPE", "<!-- fine --><!DOCTYPE").encode(),
    "utf-8 mark": codecs.BOM_UTF8 + BOMBED.encode(),
    "utf-16": BOMBED.encode("utf-16"),
    "utf-16 big": codecs.BOM_UTF16_BE + BOMBED.encode("utf-16-be"),
    "utf-16 without mark": BOMBED.encode("utf-16-le"),
    "utf-32": BOMBED.encode("utf-32"),
    "utf-7": b'<?xml version="1.0" encoding="UTF-7"?>' + BOMBED[21:].encode("utf-7"),
    "ebcdic": BOMBED.encode("cp037"),
}


@pytest.mark.parametrize("content", ENCODED_BOMBS.values(), ids=ENCODED_BOMBS)
def test_a_billion_laughs_are_refused_at_once(tmp_path: Path, content: bytes) -> None:
    start = time.perf_counter()
    with pytest.raises(FileFormatError) as caught:
        load_bytes(tmp_path, content)
    # 2e19 bytes when expanded; refused in under a millisecond, the bound leaves room for a busy machine.
    assert time.perf_counter() - start < 1.0
    assert len(str(caught.value)) < 600
    if content.startswith((b"<?xml", codecs.BOM_UTF8, codecs.BOM_UTF16_BE)) and b"UTF-7" not in content:
        assert caught.value.culprit == "<!DOCTYPE" and "entities" in str(caught.value)


@pytest.mark.parametrize("target", ["file", "http"])
def test_external_entities_are_not_fetched(tmp_path: Path, target: str) -> None:
    secret = write(tmp_path, '"stolen"', "secret.txt")
    address = secret.as_uri() if target == "file" else "http://192.0.2.1/never"  # an address nobody has
    doctype = f'<!DOCTYPE robot [<!ENTITY e SYSTEM "{address}">]>'
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match="<!DOCTYPE") as caught:
        load_bytes(tmp_path, f'{doctype}<robot name="a">&e;</robot>'.encode())
    assert time.perf_counter() - start < 1.0
    assert "stolen" not in str(caught.value)


def test_missing_files_name_the_bundled_robots(tmp_path: Path) -> None:
    for missing in (tmp_path / "none.urdf", "stewrat", "a\0b", robot(*ARM), tmp_path / "none" / "a.urdf"):
        with pytest.raises(FileMissingError, match=r"bundled robots are: .*stewart_sps") as caught:
            stp.load(missing)
        assert len(str(caught.value)) < 800
    assert isinstance(caught.value, FileNotFoundError)


def test_a_name_too_long_for_a_file_is_shortened() -> None:
    with pytest.raises(FileMissingError, match="bundled robots are") as caught:
        stp.load("<robot>" * 5000)
    assert len(str(caught.value)) < 800


def test_folders_and_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileMissingError, match="this is a folder"):
        stp.load(tmp_path)
    with pytest.raises(UnsupportedError, match=r"'\.stl'"):
        stp.load(write(tmp_path, "solid", "part.stl"))


@pytest.mark.parametrize("value", [None, 3, b"stewart", ["stewart"]])
def test_what_is_no_name_is_refused(value: object) -> None:
    with pytest.raises(InputError, match="name_or_path must be"):
        stp.load(value)  # type: ignore[arg-type]


def test_prefixes_without_a_namespace_are_read_as_robot_software_does(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM, '<drake:diffuse_map drake:size="3"/>')))
    assert "<drake:diffuse_map>" in str(chain.report)


@pytest.mark.parametrize("size", ["1e30", "-1e30", "1e-300"])
@pytest.mark.parametrize("attribute", ["xyz", "rpy"])
def test_sizes_beyond_sense_do_not_overflow(tmp_path: Path, size: str, attribute: str) -> None:
    text = robot(*ARM).replace('xyz="1 0 0"', f'{attribute}="{size} 0 {size}"')
    chain = stp.load(write(tmp_path, text))
    assert np.isfinite(chain.q_home).all()


def test_a_robot_that_cannot_move_is_refused(tmp_path: Path) -> None:
    # Pinocchio would crash on its Jacobians.
    weld = '<joint name="weld" type="fixed"><parent link="base"/><child link="platform"/></joint>'
    for parts in ([link("base"), link("platform"), weld], [link("platform")]):
        with pytest.raises(MechanismError, match="robot 'small' has no joint that moves"):
            stp.load(write(tmp_path, robot(*parts)), motors=[])


def test_many_links_are_no_trouble(tmp_path: Path) -> None:
    n = 300
    text = "".join(link(f"l{k}") for k in range(n)) + "".join(
        f'<joint name="j{k}" type="fixed"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
        for k in range(n - 1)
    )
    hung = '<joint name="last" type="fixed"><parent link="platform"/><child link="l0"/></joint>'
    assert stp.load(write(tmp_path, robot(*ARM, text, hung))).nv == 2


STEWART = etree.parse(str(bundled("stewart"))).getroot()


@quick()
@hypothesis.given(content=damaged(STEWART))
def test_damaged_files_load_or_fail_with_our_errors(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fuzzed.urdf"
    path.write_bytes(content)
    assert_loads_or_says_why(path)


@pytest.mark.parametrize(
    "content",
    ['<foo_{0} a="b"/>', '<material name="m{0}"><color rgba="1 1 1 1"/></material>'],
    ids=["unknown tags", "materials"],
)
def test_time_grows_with_the_size_of_a_file_and_the_report_stays_short(tmp_path: Path, content: str) -> None:
    took, told = [], 0
    for count in (2_000, 16_000):
        path = write(tmp_path, robot(*ARM, *(content.format(k) for k in range(count))))
        start = time.process_time()
        chain = stp.load(path)
        took.append(time.process_time() - start)
        told = len(str(chain.report).splitlines())
        assert len(chain.report.notes) == count and f"{count - 20} more: " in str(chain.report)
    # Eight times the tags: 64 times the time, were it to grow with the square.
    assert took[1] < 24 * max(took[0], 0.02) and told < 30
