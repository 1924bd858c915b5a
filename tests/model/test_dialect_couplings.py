"""Couplings: of rotors and belts, joints that mimic others, and plugins that make them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.formats.reading import read_urdf
from tests.model.small_dialects import PLUGIN, TIP
from tests.small_urdf import ARM, MOTOR, joint, link, robot, write

LEG = (
    link("base"),
    link("abduct"),
    link("abduct_rotor"),
    link("platform"),
    joint("abduct_turn", "base", "abduct", attributes='independent="True"'),
    joint("rotor_turn", "base", "abduct_rotor", attributes='independent="False"'),
    joint("hip", "abduct", "platform", origin=TIP, attributes=MOTOR),
)
"""The abduction joint of a legged robot, with the rotor of its motor on the same parent."""


def test_coupling_of_a_rotor(tmp_path: Path) -> None:
    text = (
        '<coupling name="abduct_transmission" type="rolling"><predecessor link="abduct"/>'
        '<successor link="abduct_rotor"/><ratio value="6.0"/></coupling>'
    )
    (found,) = read_urdf(write(tmp_path, robot(*LEG, text))).couplings
    assert found.name == "abduct_transmission"
    # ratio × Σ q(ancestor to predecessor) = Σ q(ancestor to successor): the rotor turns six times as fast.
    assert (found.joint1, found.joint2, found.polynomial) == ("rotor_turn", "abduct_turn", (0.0, 6.0))
    chain = stp.load(write(tmp_path, robot(*LEG, text.replace(' type="rolling"', ""))))
    assert (chain.nc, chain.couplings[0].polynomial) == (1, (0.0, 6.0))


def test_coupling_of_sums(tmp_path: Path) -> None:
    """One motor moves two joints: rotor = 2 (hip + abduct), and told the other way hip + abduct = 0.5 rotor."""
    text = (
        '<coupling name="belt"><predecessor link="platform"/><successor link="abduct_rotor"/><ratio value="2"/>'
        "</coupling>"
    )
    chain = stp.load(write(tmp_path, robot(*LEG, text)))
    back = text.replace("abduct_rotor", "x").replace("platform", "abduct_rotor").replace("x", "platform")
    other = stp.load(write(tmp_path, robot(*LEG, back.replace('value="2"', 'value="0.5"'))))
    for told in (chain, other):
        joints = dict(zip(told.tangent_names, np.eye(3), strict=True))
        row = stp.loop_jacobian(told, told.q_home)[0]
        wanted = joints["rotor_turn"] - 2 * (joints["hip"] + joints["abduct_turn"])
        rotor = told.tangent_names.index("rotor_turn")
        np.testing.assert_allclose(row / row[rotor], wanted, rtol=1e-15)
        assert (told.nc, stp.mobility(told).dof) == (1, 2)
    for link_ in ("base", "abduct"):
        bare = text.replace("abduct_rotor", link_)
        with pytest.raises(
            UnsupportedError, match="coupling 'belt': no joint moves between the successor and"
        ):
            stp.load(write(tmp_path, robot(*LEG, bare)))


def test_mimic(tmp_path: Path) -> None:
    follower = joint("follow", "base", "shell", content='<mimic joint="elbow" multiplier="-2" offset="0.5"/>')
    chain = stp.load(write(tmp_path, robot(*ARM, link("shell"), follower)))
    (found,) = chain.couplings
    assert (found.name, found.joint1, found.joint2) == ("follow_mimic", "follow", "elbow")
    assert found.polynomial == (0.5, -2.0)
    q = dict(zip(chain.tangent_names, chain.q_home, strict=True))
    assert abs(q["follow"] - 0.5 + 2 * q["elbow"]) < 1e-12
    plain = follower.replace(' multiplier="-2" offset="0.5"', "")
    assert stp.load(write(tmp_path, robot(*ARM, link("shell"), plain))).couplings[0].polynomial == (0.0, 1.0)


def test_mimic_plugins_of_gazebo(tmp_path: Path) -> None:
    follower = joint("follow", "base", "shell")
    chain = stp.load(write(tmp_path, robot(*ARM, link("shell"), follower, PLUGIN)))
    (found,) = chain.couplings
    assert (found.joint1, found.joint2, found.polynomial) == ("follow", "elbow", (0.5, -2.0))
    assert "kept: read as Gazebo <gazebo> (coupling 'follow_mimic')" in str(chain.report)
    bare = PLUGIN.replace("<multiplier>-2.0</multiplier><offset>0.5</offset>", "").replace(
        "joint>el", "jointName>el"
    )
    bare = bare.replace("elbow</joint>", "elbow</jointName>")
    chain = stp.load(write(tmp_path, robot(*ARM, link("shell"), follower, bare)))
    assert chain.couplings[0].polynomial == (0.0, 1.0)


@pytest.mark.parametrize(
    ("multiplier", "words"),
    [("-2", "repeats the <mimic>"), ("2", "says otherwise than -2 × 'elbow' + 0.5")],
)
def test_mimic_counts_before_a_plugin(tmp_path: Path, multiplier: str, words: str) -> None:
    own = f'<mimic joint="elbow" multiplier="{multiplier}" offset="0.5"/>'
    chain = stp.load(
        write(tmp_path, robot(*ARM, link("shell"), PLUGIN, joint("follow", "base", "shell", content=own)))
    )
    assert chain.couplings[0].polynomial == (0.5, float(multiplier)) and len(chain.couplings) == 1
    assert words in str(chain.report)


def test_mimic_of_rigid_joints(tmp_path: Path) -> None:
    own = '<mimic joint="elbow" multiplier="-2" offset="0.5"/>'
    text = robot(*ARM, link("shell"), joint("follow", "base", "shell", "fixed", content=own))
    chain = stp.load(write(tmp_path, text))
    assert chain.couplings == () and "does not follow 'elbow': it is fixed (joint 'follow')" in str(
        chain.report
    )
    text = robot(*ARM, link("shell"), joint("follow", "base", "shell", content=own))
    chain = stp.load(
        write(tmp_path, text.replace('"elbow" type="revolute" independent="true"', '"elbow" type="fixed"'))
    )
    assert (chain.couplings[0].joint2, chain.couplings[0].polynomial) == (None, (0.5,))
    assert chain.q_home[chain.model.joints[chain.model.getJointId("follow")].idx_q] == 0.5
