"""The bundled planar and rotary robots against their textbooks: printed figures, and closed forms from SOURCE.md."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.building.loading import urdf_root
from tests.closed_states import random_configuration, robot

THIRDS = 2 * np.pi / 3 * np.arange(3)


@pytest.mark.parametrize(
    ("name", "dof", "idle", "redundant"),
    [
        ("four_bar", 1, 0, 1),
        ("five_bar", 2, 0, 3),
        ("rpr_planar", 3, 0, 6),
        ("delta", 3, 6, 0),
        ("hexapod_rss", 6, 6, 0),
    ],
)
def test_textbook_mobility(name: str, dof: int, idle: int, redundant: int) -> None:
    found = stp.mobility(robot(name))
    assert (found.dof - len(found.idle), len(found.idle), found.redundant_rows) == (dof, idle, redundant)
    assert found.motors_sufficient and not found.home_singular and robot(name).nu == dof
    assert all(text.startswith("rod") and text.endswith(": spin about its axis") for text in found.idle)


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "rpr_planar", "delta", "hexapod_rss"])
def test_other_readers_see_the_tree(name: str) -> None:
    model = pin.buildModelFromUrdf(str(urdf_root() / name / f"{name}.urdf"))
    chain = robot(name)
    assert model.nv == chain.nv and pin.computeTotalMass(model) == pytest.approx(
        pin.computeTotalMass(chain.model), rel=1e-15
    )


def test_four_bar_of_the_textbook() -> None:
    """Norton prints 20.30°, 57.33°; -4.121, 6.998 rad/s; 296.089, 470.134 rad/s² for the crank at 40°, 25 and 15."""
    chain = robot("four_bar")
    crank, coupler, rocker = (
        chain.model.joints[chain.model.getJointId(name)].idx_v
        for name in ("crank_motor", "crank_pin", "rocker_hinge")
    )
    q = chain.q_home
    assert np.degrees(q[crank]) == pytest.approx(40, abs=1e-12)
    np.testing.assert_allclose(np.degrees([q[crank] + q[coupler], q[rocker]]), [20.30, 57.33], atol=0.006)
    jacobian = stp.loop_jacobian(chain, q)
    passive = jacobian[:, [coupler, rocker]]
    v = np.zeros(3)
    v[crank] = 25.0
    v[[coupler, rocker]] = np.linalg.lstsq(passive, -jacobian @ v, rcond=None)[0]
    np.testing.assert_allclose([v[crank] + v[coupler], v[rocker]], [-4.121, 6.998], atol=6e-4)
    a = np.zeros(3)
    a[crank] = 15.0
    a[[coupler, rocker]] = np.linalg.lstsq(passive, -jacobian @ a - stp.loop_bias(chain, q, v), rcond=None)[0]
    np.testing.assert_allclose([a[crank] + a[coupler], a[rocker]], [296.089, 470.134], atol=6e-4)


def test_five_bar_is_two_circles(rng: np.random.Generator) -> None:
    chain = robot("five_bar")
    for _ in range(5):
        q = random_configuration(chain, rng)
        hips, turn = np.array([[-0.059, 0], [0.059, 0]]), stp.motor_positions(chain, q)
        knees = hips + 0.09 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        middle, half = knees.mean(axis=0), (knees[1] - knees[0]) / 2
        across = np.array([-half[1], half[0]]) / np.linalg.norm(half)
        pin_point = middle + np.sqrt(0.09**2 - half @ half) * across
        np.testing.assert_allclose(stp.platform_pose(chain, q).translation, [*pin_point, 0], atol=1e-13)


def test_planar_platform_of_the_exercise(rng: np.random.Generator) -> None:
    chain = robot("rpr_planar")
    planar = stp.PlanarRPR.from_sides(3, 3 * np.sqrt(2), 3, np.pi / 4, 5, 0, 6)
    np.testing.assert_allclose(stp.motor_positions(chain, chain.q_home), [5, 5, 3], atol=1e-12)
    modes = stp.planar_assembly_modes(planar, [5, 5, 3])
    pose = stp.platform_pose(chain, chain.q_home)
    assert Rotation.from_matrix(pose.rotation).as_rotvec()[2] == pytest.approx(modes.angle[2], abs=1e-12)
    # All four poses of the exercise are configurations of the robot.
    for position, angle in zip(modes.position, modes.angle, strict=True):
        there = pin.SE3(pin.rpy.rpyToMatrix(0, 0, float(angle)), np.array([*position, 0]))
        q = stp.inverse_kinematics(chain, there, limits=False).q
        np.testing.assert_allclose(stp.motor_positions(chain, q), [5, 5, 3], atol=1e-9)
    for _ in range(5):
        q = random_configuration(chain, rng)
        pose = stp.platform_pose(chain, q)
        angle = float(Rotation.from_matrix(pose.rotation).as_rotvec()[2])
        lengths = stp.planar.planar_leg_lengths(planar, pose.translation[:2], angle)
        np.testing.assert_allclose(stp.motor_positions(chain, q), lengths, atol=1e-12)
        expected = stp.planar.planar_leg_jacobian(planar, pose.translation[:2], angle)
        np.testing.assert_allclose(stp.motor_jacobian(chain, q)[:, [0, 1, 5]], expected, atol=1e-9)


def delta() -> stp.rotary.RotaryLegs:
    """Return the geometry that its SOURCE.md gives."""
    return stp.rotary.delta_legs(
        base_radius=0.4573 / (2 * np.sqrt(3)),
        platform_radius=0.115 / (2 * np.sqrt(3)),
        crank=0.112,
        rod=0.232,
    )


def rotary_hexapod() -> stp.rotary.RotaryLegs:
    """Return the geometry that its SOURCE.md gives."""
    side = np.tile([-1.0, 1.0], 3)
    foot, head = np.repeat(THIRDS, 2) + 0.25 * side, np.repeat(THIRDS, 2) + (np.pi / 3 - 0.2) * side

    def on_circle(angle: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(angle), np.sin(angle), np.zeros(6)], axis=1)

    out = on_circle(foot)
    zeros = side[:, None] * np.cross([0, 0, 1], out)
    return stp.rotary.RotaryLegs(
        0.3 * out, np.cross(zeros, [0, 0, 1]), zeros, 0.2 * on_circle(head), 0.12, 0.45
    )


@pytest.mark.parametrize(("name", "legs"), [("delta", delta()), ("hexapod_rss", rotary_hexapod())])
def test_rotary_legs_in_closed_form(name: str, legs: stp.rotary.RotaryLegs, rng: np.random.Generator) -> None:
    chain = robot(name)
    for _ in range(5):
        q = random_configuration(chain, rng)
        pose = stp.platform_pose(chain, q)
        angles = stp.rotary.crank_angles(legs, pose.translation, pose.rotation).angle[:, 0]
        np.testing.assert_allclose(stp.motor_positions(chain, q), angles, atol=1e-10)
        expected = stp.rotary.crank_jacobian(legs, pose.translation, pose.rotation, angles)
        found = stp.motor_jacobian(chain, q)
        columns = slice(3 if name == "delta" else 6)  # the platform of a Delta does not turn
        np.testing.assert_allclose(found[:, columns], expected[:, columns], rtol=1e-8, atol=1e-8)


def test_inverse_kinematics_of_the_rotary_hexapod(rng: np.random.Generator) -> None:
    chain, legs = robot("hexapod_rss"), rotary_hexapod()
    home = stp.platform_pose(chain, chain.q_home)
    for _ in range(5):
        turn = pin.exp3(rng.uniform(-0.15, 0.15, 3))
        pose = pin.SE3(turn, home.translation + rng.uniform(-0.04, 0.04, 3))
        q = stp.inverse_kinematics(chain, pose).q
        angles = stp.rotary.crank_angles(legs, pose.translation, pose.rotation, limits=(-1.5, 1.5)).angle[
            :, 0
        ]
        np.testing.assert_allclose(stp.motor_positions(chain, q), angles, atol=1e-10)


def test_forward_kinematics_of_the_delta(rng: np.random.Generator) -> None:
    chain = robot("delta")
    for _ in range(5):
        angle = np.pi / 4 + rng.uniform(-0.3, 0.3, 3)
        pose = stp.platform_pose(chain, stp.forward_kinematics(chain, angle).q)
        np.testing.assert_allclose(
            pose.translation, stp.rotary.delta_positions(delta(), angle).position[0], atol=1e-12
        )
        np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-12)
