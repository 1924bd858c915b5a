"""Derivatives of the dynamics by the ends of the legs: against differences of the closed form of hexapods."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from tests.closed_states import close, derivative, robot

STATES = 3


@pytest.fixture(scope="module", params=["stewart", pytest.param("stewart_sps", marks=pytest.mark.slow)])
def kernels(request: pytest.FixtureRequest) -> stp.Kernels:
    return stp.compile_kernels(robot(request.param))


@pytest.fixture
def motion(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses, twists and accelerations."""
    position = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.1, 0.1, (STATES, 3))
    turn = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (STATES, 3)))
    pose = np.hstack([position, turn.as_quat()])
    return pose, rng.uniform(-1, 1, (STATES, 6)), rng.uniform(-5, 5, (STATES, 6))


def closed_form(chain: stp.ClosedChain, shift: np.ndarray, pose, twist, acceleration) -> np.ndarray:
    """Leg forces of the platform with its twelve points moved by `shift` (2, 6, 3)."""
    hexapod = stp.Hexapod.from_chain(chain)
    moved = stp.Hexapod(hexapod.base_points + shift[0], hexapod.platform_points + shift[1])
    rotation = Rotation.from_quat(pose[3:]).as_matrix()
    bodies = stp.hexapod_bodies(chain)
    return stp.hexapod_inverse_dynamics(moved, bodies, pose[:3], rotation, twist, acceleration).actuator


def forward(chain: stp.ClosedChain, shift: np.ndarray, pose, twist, tau: np.ndarray) -> np.ndarray:
    """Acceleration from the closed form, which is linear in it."""
    bias = closed_form(chain, shift, pose, twist, np.zeros(6))
    columns = [closed_form(chain, shift, pose, twist, unit) - bias for unit in np.eye(6)]
    return np.linalg.solve(np.array(columns).T, tau - bias)


def differences(function) -> np.ndarray:
    """Differentiate along each coordinate of each point: (6, 36), base points first."""
    columns = []
    for k in range(36):
        unit = np.zeros(36)
        unit[k] = 1.0
        shift = unit.reshape(2, 6, 3)
        columns.append(derivative(lambda t, shift=shift: function(t * shift)))
    return np.array(columns).T


# Differences of order 4 at h = 1 mm: (h/size)⁴/30 and eps/h, both below 1e-11 of the efforts per metre.
def test_inverse_dynamics(kernels: stp.Kernels, motion) -> None:
    found = np.concatenate(kernels.inverse_dynamics_geometry(*motion), axis=2)
    for k in range(STATES):
        state = [part[k] for part in motion]
        close(found[k], differences(lambda shift, s=state: closed_form(kernels.chain, shift, *s)), 1e-8)


def test_forward_dynamics(kernels: stp.Kernels, motion) -> None:
    pose, twist, _ = motion
    tau = kernels.inverse_dynamics(*motion)
    found = np.concatenate(kernels.forward_dynamics_geometry(pose, twist, tau), axis=2)
    for k in range(STATES):
        state = (pose[k], twist[k], tau[k])
        close(found[k], differences(lambda shift, s=state: forward(kernels.chain, shift, *s)), 1e-8)


def test_moving_everything_moves_nothing(kernels: stp.Kernels, motion) -> None:
    """Base points shifted and platform points shifted back in the platform: the legs see the same."""
    by_base, by_platform = kernels.inverse_dynamics_geometry(*motion)
    assert by_base.shape == by_platform.shape == (STATES, 6, 18)
    # All base points together by d is the platform by -d: the derivative by its position, with the other sign.
    by_pose = kernels.inverse_dynamics_derivatives(*motion)[0]
    together = by_base.reshape(STATES, 6, 6, 3).sum(axis=2)
    close(together, -by_pose[..., :3], 1e-11)


def test_rotary_legs_too(rng: np.random.Generator) -> None:
    """The same law for cranks with rods, whose closed form is not that of hexapods."""
    kernels = stp.compile_kernels(robot("hexapod_rss"))
    home = stp.platform_pose(kernels.chain, kernels.chain.q_home)
    pose = np.concatenate([home.translation, [0, 0, 0, 1]])[None]
    motion = (pose, 0.2 * rng.normal(size=(1, 6)), rng.normal(size=(1, 6)))
    by_base, _ = kernels.inverse_dynamics_geometry(*motion)
    by_pose = kernels.inverse_dynamics_derivatives(*motion)[0]
    close(by_base.reshape(1, 6, 6, 3).sum(axis=2), -by_pose[..., :3], 1e-10)


@pytest.mark.parametrize("name", ["delta", "four_bar"])
def test_platforms_of_fewer_freedoms_are_refused(name: str) -> None:
    kernels = stp.compile_kernels(robot(name))
    pose = np.array([0, 0, 0, 0, 0, 0, 1.0])
    with pytest.raises(UnsupportedError, match=r"freedoms|closed form"):
        kernels.inverse_dynamics_geometry(pose, np.zeros(6), np.zeros(6))
