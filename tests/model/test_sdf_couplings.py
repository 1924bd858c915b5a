"""Gearboxes, mimics and threads of SDFormat couple joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stewart_pin.errors import FileFormatError
from tests.model.sdf_reading import read
from tests.small_sdf import HOLD, TWO, axis2, joint, link


@pytest.mark.parametrize(
    ("axis", "second", "reversed_joint", "factor"),
    [
        ("0 0 1", "0 0 1", False, -0.25),
        ("0 0 1", "0 0 -1", False, 0.25),
        ("0 0 -1", "0 0 -1", False, -0.25),
        ("0 0 1", "0 0 1", True, 0.25),
    ],
)
def test_a_gearbox_couples_two_hinges(
    tmp_path: Path, axis: str, second: str, reversed_joint: bool, factor: float
) -> None:
    """θ2 = -ratio θ1, angles from the reference body to the wheels, each about its axis."""
    gear = joint(
        "gear",
        "fast",
        "slow",
        "gearbox",
        xyz=axis,
        content=f"{axis2(second)}<gearbox_ratio>0.25</gearbox_ratio>"
        "<gearbox_reference_body>case</gearbox_reference_body>",
    )
    ends = ("slow", "case") if reversed_joint else ("case", "slow")
    mechanism = read(
        tmp_path,
        link("case"),
        link("fast", "1 0 0 0 0 0"),
        link("slow", "2 0 0 0 0 0"),
        joint("input", "case", "fast"),
        joint("output", *ends),
        gear,
    )
    (coupling,) = mechanism.couplings
    assert (coupling.name, coupling.joint1, coupling.joint2) == ("gear", "output", "input")
    assert coupling.polynomial == (0.0, factor)
    assert not mechanism.loops  # it holds nothing


def test_a_gearbox_needs_its_hinges(tmp_path: Path) -> None:
    gear = joint(
        "gear",
        "a",
        "b",
        "gearbox",
        content=f"{axis2('0 0 1')}<gearbox_reference_body>c</gearbox_reference_body>",
    )
    with pytest.raises(FileFormatError, match=r"no revolute joint about its <axis> joins 'c' and 'a'"):
        read(tmp_path, *TWO, link("c"), joint("j", "a", "b"), gear)


def test_an_axis_that_mimics_another(tmp_path: Path) -> None:
    """The follower stands at multiplier (leader - reference) + offset = 3 (x - 0.5) + 2."""
    numbers = "<multiplier>3</multiplier><offset>2</offset><reference>0.5</reference>"
    rule = f'<mimic joint="u" axis="axis2">{numbers}</mimic>'
    mechanism = read(
        tmp_path,
        *TWO,
        link("c"),
        HOLD,
        joint("u", "a", "b", "universal", xyz="1 0 0", content=axis2("0 1 0")),
        joint("k", "b", "c", axis=rule),
        version="1.11",
    )
    (coupling,) = mechanism.couplings
    assert (coupling.joint1, coupling.joint2, coupling.polynomial) == ("k", "u_2", (0.5, 3.0))
    assert not mechanism.assembled


def test_drakes_mimic(tmp_path: Path) -> None:
    rule = '<drake:mimic joint="j" multiplier="-2" offset="0"/>'
    mechanism = read(
        tmp_path, *TWO, link("c"), HOLD, joint("j", "a", "b"), joint("k", "b", "c", content=rule)
    )
    assert [(x.joint1, x.joint2, x.polynomial) for x in mechanism.couplings] == [("k", "j", (0.0, -2.0))]


def test_threads_of_screws(tmp_path: Path) -> None:
    """0.3 m per turn to the right; 20 rad per metre to the left."""
    for tag, lead in (("screw_thread_pitch", 0.3), ("thread_pitch", -2 * np.pi / 20)):
        value = 0.3 if tag == "screw_thread_pitch" else 20
        mechanism = read(
            tmp_path, *TWO, HOLD, joint("j", "a", "b", "screw", content=f"<{tag}>{value}</{tag}>")
        )
        (thread,) = mechanism.couplings
        assert thread.polynomial[1] * 2 * np.pi == pytest.approx(lead, rel=1e-15)
