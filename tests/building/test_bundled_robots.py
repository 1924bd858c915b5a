"""The bundled six-legged platforms, rebuilt from the numbers that their SOURCE.md gives."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import urdf_root
from stewart_pin.geometry.rotations import rotation_from_rpy
from tests.building.test_round_trip import assert_same


def body(mass: float, com: tuple[float, float, float], moments: tuple[float, float, float]) -> pin.Inertia:
    return pin.Inertia(mass, np.array(com), np.diag(moments))


def level(z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, z]))


@pytest.mark.parametrize(("name", "lower_joint"), [("stewart", "universal"), ("stewart_sps", "spherical")])
def test_the_ideal_platform(name: str, lower_joint: str, report_ideal: stp.Hexapod) -> None:
    rebuilt = stp.hexapod_chain(
        report_ideal,
        platform=body(20.0, (0, 0, 0), (1.5, 1.5, 2.8)),
        lower=body(2.0, (0, 0, 0.2), (0.03, 0.03, 0.002)),
        upper=body(1.5, (0, 0, -0.2), (0.02, 0.02, 0.001)),
        base=body(40.0, (0, 0, 0), (5, 5, 9)),
        lower_joint=lower_joint,
        stroke=(0.5, 1.8),
        effort=1e4,
        velocity=2.0,
        home=level(1.0),
        name=name,
    )
    assert_same(rebuilt, stp.load(name))


def test_the_platform_that_was_built(report_cad: stp.Hexapod) -> None:
    # Stroke: actuator output 0.7 to 1.2 m, plus 0.600 m and 0.90147 m.
    rebuilt = stp.hexapod_chain(
        report_cad,
        platform=body(200.0, (0, 0, 0), (18, 18, 36)),
        lower=body(20.0, (0, 0, 0.6), (2.4, 2.4, 0.025)),
        upper=body(12.0, (0, 0, -0.5), (1.2, 1.2, 0.006)),
        base=body(400.0, (0, 0, 0), (50, 50, 90)),
        stroke=(2.20147, 2.70147),
        effort=1e4,
        velocity=0.5,
        home=level(2.4),
        name="stewart_cad",
    )
    assert_same(rebuilt, stp.load("stewart_cad"))
    np.testing.assert_allclose([0.7 + 1.50147, 1.2 + 1.50147], [2.20147, 2.70147], rtol=1e-15)


def test_the_platform_of_the_forward_kinematics_example() -> None:
    platform = [(0, 0), (0, 4), (-16, 13), (-19, 11), (-19, -7), (-16, -9)]
    base = [(0, 0), (0, 28), (-6, 31), (-30, 17), (-30, 11), (-6, -3)]
    x, y, z = (
        -3.4469557159719698767603820145102,
        7.967616235254526202721299530723,
        18.017646567180649831017508642222,
    )
    yaw, pitch, roll = (
        0.023390306070863206015935701738644,
        -0.078688271816232459173105224884905,
        0.19162395249659578920609236083318,
    )
    pose = pin.SE3(rotation_from_rpy(roll, pitch, yaw), np.array([x, y, z]))
    hexapod = stp.Hexapod(*(np.column_stack([points, np.zeros(6)]) for points in (base, platform)))
    rebuilt = stp.hexapod_chain(
        hexapod,
        platform=body(2000.0, (-11.7, 3.5, 0), (6e4, 6e4, 1.2e5)),
        lower=body(300.0, (0, 0, 5), (2500, 2500, 10)),
        upper=body(200.0, (0, 0, -4), (1100, 1100, 4)),
        base=body(5e4, (0, 0, 0), (5e6, 5e6, 9e6)),
        stroke=(11.0, 35.0),
        effort=2e5,
        velocity=5.0,
        home=pose,
        name="stewart_s1",
    )
    chain = stp.load("stewart_s1")
    assert_same(rebuilt, chain)
    # S1.8: the legs whose lengths the example starts from.
    np.testing.assert_allclose(stp.motor_positions(chain, chain.q_home), [20, 25, 26, 20, 20, 20], atol=1e-12)


@pytest.mark.parametrize("name", stp.robots())
def test_every_robot_says_where_its_numbers_come_from(name: str) -> None:
    source = urdf_root() / name / "SOURCE.md"
    assert source.is_file() and Path(source).read_text().startswith(f"# {name}")


@pytest.mark.parametrize("name", stp.robots())
def test_every_robot_has_real_bodies_and_nothing_to_note(name: str) -> None:
    chain = stp.load(name, odd_inertias=False)
    assert all(note.text == "read as URDF+" for note in chain.report.notes), chain.report


def test_every_robot_is_listed() -> None:
    told = (urdf_root() / "README.md").read_text("utf-8")
    rows = [line.split("|")[1] for line in told.splitlines() if line.startswith("| `")]
    assert sorted(re.findall(r"`(\w+)`", "".join(rows))) == sorted(stp.robots())
    assert f"| {len(stp.robots())} robots" in (urdf_root().parent / "README.md").read_text("utf-8")


@pytest.mark.parametrize("name", ["stewart", "stewart_sps", "stewart_cad", "stewart_s1"])
def test_leg_ends_are_read_off_the_chain(name: str) -> None:
    chain = stp.load(name)
    hexapod, pose = stp.Hexapod.from_chain(chain), stp.platform_pose(chain, chain.q_home)
    lengths = stp.leg_lengths(hexapod, pose.translation, pose.rotation)
    np.testing.assert_allclose(lengths, stp.motor_positions(chain, chain.q_home), rtol=1e-14)
