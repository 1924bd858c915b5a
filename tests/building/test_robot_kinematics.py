"""Bundled robots against the closed forms that are printed of their kinds: motors of poses, and what is parasitic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import StewartPinError
from tests.closed_states import robot

THIRDS = 2 * np.pi / 3 * np.arange(3)
X, Y, Z = np.eye(3)


def level(angles: np.ndarray, radius: float = 1.0) -> np.ndarray:
    return radius * np.stack([np.cos(angles), np.sin(angles), 0 * np.asarray(angles)], axis=-1)


def two_link(out: np.ndarray, up: np.ndarray, crank: float, rod: float, side: float) -> np.ndarray:
    """Angle of the first of two bars that reach a point, the elbow on one side (law of cosines)."""
    reach2 = out**2 + up**2
    return np.arctan2(up, out) + side * np.arccos(
        (reach2 + crank**2 - rod**2) / (2 * crank * np.sqrt(reach2))
    )


def slider_crank(pose: pin.SE3) -> np.ndarray:
    """X = r cos θ + √(l² - r² sin² θ), solved for the crank angle."""
    x = pose.translation[0]
    return two_link(np.array([x]), np.zeros(1), 0.05, 0.2, 1.0)


def scissor_lift(pose: pin.SE3) -> np.ndarray:
    """Two stages of bars of 1 m: h = 2 √(1 - x²), and the drive has pulled the feet in by 1 - x."""
    return np.array([1 - np.sqrt(1 - (pose.translation[2] / 2) ** 2)])


def agile_eye(pose: pin.SE3) -> np.ndarray:
    """Orthogonal axes: each angle alone, tan θ = -R_ij / R_kk (Gosselin, St-Pierre and Gagné 1996)."""
    R = pose.rotation
    return np.array([np.arctan2(-R[(k + 1) % 3, (k + 2) % 3], R[(k + 2) % 3, (k + 2) % 3]) for k in range(3)])


def wrist(pose: pin.SE3) -> np.ndarray:
    """W · v = cos 90° for the middle axis w and the end axis v of each leg (Gosselin and Angeles 1989)."""
    v = level(THIRDS) @ pose.rotation.T
    s, c = np.sin(np.pi / 4), np.cos(np.pi / 4)
    # s (v_x cos φ + v_y sin φ) = c v_z, and the middle axis stood a quarter turn ahead of the end one at zero.
    phi = np.arctan2(v[:, 1], v[:, 0]) + np.arccos(c * v[:, 2] / (s * np.hypot(v[:, 0], v[:, 1])))
    return (phi - THIRDS - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi


def tripod(base: float, top: float) -> Callable[[pin.SE3], np.ndarray]:
    """Leg lengths: distances of the points that they join."""
    return lambda pose: np.linalg.norm(
        level(THIRDS, top) @ pose.rotation.T + pose.translation - level(THIRDS, base), axis=1
    )


def three_rrs(pose: pin.SE3) -> np.ndarray:
    d, e, f, g = (0.0254 * inches for inches in (2.0, 3.125, 1.75, 3.669291339))
    heads = level(THIRDS, e) @ pose.rotation.T + pose.translation
    return two_link(np.sum(heads * level(THIRDS), axis=1) - d, heads[:, 2], f, g, -1.0)


def linear_delta(pose: pin.SE3) -> np.ndarray:
    """Height of a carriage: that of the platform, and what the rod rises."""
    feet = level(np.radians([210, 330, 90]), 0.1344) - pose.translation
    return pose.translation[2] + np.sqrt(0.268**2 - feet[:, 0] ** 2 - feet[:, 1] ** 2)


def ankle(pose: pin.SE3) -> np.ndarray:
    """Crank ends on circles, heels on the foot: a cos θ + b sin θ = c (Zhou and Tsagarakis 2018)."""
    found = []
    for side, height in ((1, 0.49), (-1, 0.37)):
        x, y, z = pose.rotation @ [-0.12, 0.06 * side, 0] - [0, 0.06 * side, height]
        # Crank end (-r cos θ, 0, r sin θ), heel d, rod l: -x cos θ + z sin θ = (r² + |d|² - l²) / 2 r.
        c = (0.12**2 + x * x + y * y + z * z - height**2) / (2 * 0.12)
        root = np.arctan2(z, -x) + np.arccos(c / np.hypot(x, z))
        found.append((root + np.pi) % (2 * np.pi) - np.pi)
    return np.array(found)


def hexaglide(pose: pin.SE3) -> np.ndarray:
    """Place each sledge before or behind its head by what the rod has left (Honegger et al. 1997)."""
    side = np.array([1, 1, -1, 1, 1, -1])
    rail = np.array([0.35, 0.25, 0.05, -0.35, -0.25, -0.05])
    heads = level(np.radians([10, 130, 90, -10, -130, -90]), 0.16) @ pose.rotation.T + pose.translation
    return heads[:, 0] + side * np.sqrt(0.6**2 - (rail - heads[:, 1]) ** 2 - (0.4 - heads[:, 2]) ** 2)


def par4(pose: pin.SE3) -> np.ndarray:
    """Parts of the plate do not turn, their link does: |p + R(θ) e + c - crank end| = l (Nabat et al. 2005)."""
    out = level(np.radians([45, 135, 225, 315]))
    link = pose.rotation @ [0, 0.1, 0]
    # From the link's middle half the link to a part, then along the part to where the rods of a chain meet it.
    corners = pose.translation + np.array([1, 1, -1, -1])[:, None] * link
    corners = corners + np.array([[0.04, 0.02, 0], [-0.2, 0.02, 0], [-0.2, -0.02, 0], [0.04, -0.02, 0]])
    aside = np.sum(corners * np.cross(Z, out), axis=1)
    return -two_link(
        np.sum(corners * out, axis=1) - 0.275, corners[:, 2], 0.375, np.sqrt(0.825**2 - aside**2), 1.0
    )


def turned(x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: np.ndarray | None = None) -> pin.SE3:
    return pin.SE3(np.eye(3) if rotation is None else rotation, np.array([x, y, z]))


def rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    return pin.rpy.rpyToMatrix(roll, pitch, yaw)


def tilted(top: float, height: float, about_x: float, about_y: float) -> pin.SE3:
    """Pose of a tripod whose heads stay in planes at 120°: R_12 = R_21, and what it shifts by (Lee and Shah 1988)."""
    R = rpy(about_x, about_y, 0)
    yaw = np.arctan2(R[0, 1] - R[1, 0], R[0, 0] + R[1, 1])
    R = rpy(0, 0, yaw) @ R
    assert abs(R[0, 1] - R[1, 0]) < 1e-15
    return pin.SE3(R, np.array([top * (R[0, 0] - R[1, 1]) / 2, -top * R[1, 0], height]))


TURNS = [(0, 0, 0), (0.3, -0.2, 0.1), (-0.4, 0.1, 0.5), (0.1, 0.5, -0.4)]
TILTS = [(0, 0), (0.2, -0.1), (-0.15, 0.25), (0.0, 0.3)]
RRS = 0.0254 * 3.125
CASES: dict[str, tuple[Callable[[pin.SE3], np.ndarray], list[pin.SE3]]] = {
    "slider_crank": (slider_crank, [turned(x) for x in (0.18, 0.2, 0.22, 0.24)]),
    "scissor_lift": (scissor_lift, [turned(0, 0, z) for z in (0.6, 1.0, 1.2, 1.6)]),
    "agile_eye": (agile_eye, [turned(rotation=rpy(*t)) for t in TURNS]),
    "spherical_wrist_parallel": (wrist, [turned(rotation=rpy(*t)) for t in TURNS]),
    "three_rps": (tripod(0.5, 0.3), [tilted(0.3, 0.55 + 0.05 * k, *t) for k, t in enumerate(TILTS)]),
    "three_rrs": (three_rrs, [tilted(RRS, 0.11 - 0.005 * k, *t) for k, t in enumerate(TILTS)]),
    "tripod_3upu": (
        tripod(0.5, 0.25),
        [turned(*p) for p in ((0, 0, 0.6), (0.1, -0.05, 0.55), (-0.08, 0.12, 0.7), (0.02, -0.15, 0.5))],
    ),
    "linear_delta": (
        linear_delta,
        [turned(*p) for p in ((0, 0, 0.1), (0.05, -0.04, 0.05), (-0.06, 0.03, 0.2), (0, 0.08, 0.12))],
    ),
    "par4": (
        par4,
        [
            turned(0.08, 0, -0.7),
            turned(0.2, -0.1, -0.8, rpy(0, 0, 0.5)),
            turned(0.0, 0.15, -0.75, rpy(0, 0, -0.8)),
            turned(0.1, 0.1, -0.9, rpy(0, 0, 0.3)),
        ],
    ),
    "ankle_2rss": (ankle, [turned(rotation=rpy(r, p, 0)) for r, p in ((0, 0), (0.2, 0.3), (-0.25, 0.1), (0.1, -0.5))]),
    "hexaglide": (
        hexaglide,
        [turned(0.05 * k, -0.02 * k, 0.03 * k, rpy(*(0.4 * np.array(t)))) for k, t in enumerate(TURNS)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_motors_of_poses_are_those_of_the_closed_form(name: str) -> None:
    chain, (form, poses) = robot(name), CASES[name]
    np.testing.assert_allclose(
        form(stp.platform_pose(chain, chain.q_home)), stp.motor_positions(chain, chain.q_home), atol=1e-12
    )
    for pose in poses:
        found = stp.inverse_kinematics(chain, pose)
        np.testing.assert_allclose(stp.motor_positions(chain, found.q), form(pose), atol=1e-9)
        again = stp.forward_kinematics(chain, form(pose))
        assert stp.platform_pose(chain, again.q).isApprox(pose, 1e-8)


@pytest.mark.parametrize(("name", "top"), [("three_rps", 0.3), ("three_rrs", RRS)])
def test_a_tilted_tripod_shifts_and_turns_as_printed(name: str, top: float) -> None:
    chain = robot(name)
    home = stp.motor_positions(chain, chain.q_home)
    size = 0.1 * np.abs(home).max()
    for step in ([1, 0, 0], [1, -1, 0], [0.5, 1, -1]):
        pose = stp.platform_pose(chain, stp.forward_kinematics(chain, home + size * np.array(step)).q)
        expected = tilted(top, pose.translation[2], *pin.rpy.matrixToRpy(pose.rotation)[:2])
        assert pose.isApprox(expected, 1e-9)
        assert np.abs(pose.rotation - np.eye(3)).max() > 0.01
    level_pose = stp.platform_pose(chain, chain.q_home)
    with pytest.raises(StewartPinError):
        stp.inverse_kinematics(chain, pin.SE3(np.eye(3), level_pose.translation + [0.1 * top, 0, 0]))


@pytest.mark.parametrize("name", ["tripod_3upu", "linear_delta"])
def test_platforms_that_only_translate(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    home = stp.motor_positions(chain, chain.q_home)
    for _ in range(3):
        pose = stp.platform_pose(
            chain, stp.forward_kinematics(chain, home + rng.uniform(-0.04, 0.04, 3), limits=False).q
        )
        np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-9)
    turning = pin.SE3(rpy(0, 0, 0.1), stp.platform_pose(chain, chain.q_home).translation)
    with pytest.raises(StewartPinError):
        stp.inverse_kinematics(chain, turning)


def test_par4_translates_and_turns_about_the_vertical(rng: np.random.Generator) -> None:
    """Motors that go up and down in turn turn it, less than a quarter, where the plate is flat; it cannot tilt."""
    chain = robot("par4")
    home = stp.motor_positions(chain, chain.q_home)
    start = stp.platform_pose(chain, chain.q_home)
    for _ in range(3):
        motors = home + rng.uniform(-0.05, 0.05, 4)
        pose = stp.platform_pose(chain, stp.forward_kinematics(chain, motors).q)
        np.testing.assert_allclose(pose.rotation[:, 2], Z, atol=1e-9)
    by_turns = stp.forward_kinematics(chain, home + 0.05 * np.array([-1, 1, -1, 1]))
    assert abs(pin.log3(stp.platform_pose(chain, by_turns.q).rotation)[2]) > 0.2
    with pytest.raises(StewartPinError):
        stp.inverse_kinematics(chain, pin.SE3(rpy(0.1, 0, 0), start.translation))
    beyond = pin.SE3(rpy(0, 0, np.pi / 2), start.translation)
    motors = par4(beyond)
    with pytest.raises(StewartPinError):
        stp.forward_kinematics(chain, motors + 0.05 * np.sign(motors - home))


def test_the_sphere_keeps_its_centre_and_the_eye_one_answer(rng: np.random.Generator) -> None:
    """The orthogonal wrist is undone motor by motor: no other motor matters to the sight of one end axis."""
    chain = robot("agile_eye")
    for _ in range(3):
        q = stp.forward_kinematics(chain, rng.uniform(-0.5, 0.5, 3)).q
        pose = stp.platform_pose(chain, q)
        np.testing.assert_allclose(pose.translation, 0, atol=1e-12)
        np.testing.assert_allclose(agile_eye(pose), stp.motor_positions(chain, q), atol=1e-9)
    wrist_chain = robot("spherical_wrist_parallel")
    turn = stp.platform_pose(wrist_chain, stp.forward_kinematics(wrist_chain, np.full(3, 0.7)).q)
    np.testing.assert_allclose(
        turn.rotation, rpy(0, 0, 0.7), atol=1e-9
    )  # motors together turn it about their axis
