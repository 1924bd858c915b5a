"""What of an SDFormat file is noted: left out, or kept though it is odd."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import MechanismError
from stewart_pin.model.description import Outcome
from tests.model.sdf_reading import read
from tests.small_sdf import BODY, HOLD, joint, link, sdf, write


def test_what_is_ignored_is_noted(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path,
        "<self_collide>1</self_collide>",
        '<plugin name="p" filename="libdrive.so"><joint_name>j</joint_name></plugin>',
        link("a", content=BODY + '<visual name="v"/><collision name="c"/><sensor name="s" type="imu"/>'),
        joint(
            "j",
            "world",
            "a",
            axis="<dynamics><damping>1</damping><slack>9</slack></dynamics>",
            content="<physics><ode/></physics>",
        ),
        "<odd_one>1</odd_one>",
    )
    ignored = {note.text.split(":")[0] for note in mechanism.notes if note.outcome is Outcome.IGNORED}
    assert ignored >= {
        "<self_collide>", "<plugin>", "<visual>", "<collision>", "<sensor>", "<slack>", "<physics>", "<odd_one>",
    }  # fmt: skip


def test_an_attribute_that_nobody_reads_is_noted(tmp_path: Path) -> None:
    mechanism = read(tmp_path, link("a").replace("<link ", '<link colour="red" '))
    assert "attribute 'colour' of <link>: unknown" in {note.text for note in mechanism.notes}


def test_a_link_without_inertial_weighs_one_kilogram(tmp_path: Path) -> None:
    mechanism = read(tmp_path, link("a", content=""), link("b"), HOLD, joint("j", "a", "b"))
    inertia = mechanism.link("a").inertia
    assert inertia is not None and inertia.mass == 1 and (inertia.inertia == np.eye(3)).all()
    some = BODY.replace("<ixx>0.5</ixx>", "").replace("<ixy>0.01</ixy>", "").replace("<mass>2</mass>", "")
    half = read(tmp_path, link("a", content=some.replace("0.2 -0.1 0.4", "0 0 0"))).link("a").inertia
    assert half is not None and half.mass == 1
    np.testing.assert_array_equal(half.inertia, [[1, 0, -0.02], [0, 0.6, 0.03], [-0.02, 0.03, 0.7]])
    assert any("1 kg" in note.text and note.outcome is Outcome.KEPT for note in mechanism.notes)


def test_no_gravity_on_any_link_is_no_gravity(tmp_path: Path) -> None:
    light = BODY + "<gravity>false</gravity>"
    assert read(tmp_path, link("a", content=light)).gravity == (0, 0, 0)


def test_gravity_off_on_some_links_is_left_out_aloud(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path, link("a", content=BODY + "<gravity>0</gravity>"), link("b"), HOLD, joint("j", "a", "b")
    )
    told = [note for note in mechanism.notes if "<gravity> off" in note.text]
    assert mechanism.gravity is None and [note.subject for note in told] == ["link 'a'"]
    assert told[0].outcome is Outcome.IGNORED


def test_inertia_of_no_real_body_is_kept_aloud(tmp_path: Path) -> None:
    """Simulators take it, so that who compares with them needs it; a negative moment nobody takes."""
    heavy = BODY.replace("<izz>0.7</izz>", "<izz>7</izz>")
    text = sdf(link("a", content=heavy), joint("j", "world", "a"))
    chain = stp.load(write(tmp_path, text), motors=["j"], platform="a")
    assert "link 'a'" in str(chain.report) and "triangle inequality" in str(chain.report)
    assert np.linalg.eigvalsh(chain.mechanism.link("a").inertia.inertia)[-1] > 6.5
    negative = BODY.replace("<izz>0.7</izz>", "<izz>-7</izz>")
    with pytest.raises(MechanismError, match=r"link 'a'.*negative principal moment"):
        stp.load(write(tmp_path, sdf(link("a", content=negative), joint("j", "world", "a"))), motors=["j"])
