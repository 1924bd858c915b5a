"""Derivatives by the geometry of arrays of states: what is asked for, where it is written, and the closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.closed_states import close, derivative, random_configuration, robot, slow_but_for_few

STATES = 3


@cache
def planar() -> stp.compiled.Kernels:
    return stp.compile_kernels(robot("five_bar"), coordinates="motor")


@cache
def hexapod(name: str = "stewart") -> stp.compiled.Kernels:
    return stp.compile_kernels(robot(name), engine="numpy")


def motion_of_motors(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    chain = planar().chain
    q = [random_configuration(chain, rng)[chain.motor_q_index] for _ in range(STATES)]
    return np.array(q), rng.normal(size=(STATES, chain.nu)), rng.normal(size=(STATES, chain.nu))


def motion_of_platform(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    position = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.1, 0.1, (STATES, 3))
    turn = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (STATES, 3)))
    pose = np.hstack([position, turn.as_quat()])
    return pose, rng.uniform(-1, 1, (STATES, 6)), rng.uniform(-5, 5, (STATES, 6))


def leg_ends(kernels: stp.compiled.Kernels) -> list[stp.build.GeometryParameter]:
    """Shifts of the feet, then of the heads of a hexapod, x y z of each leg in turn."""
    links, parameters = (kernels.chain.mechanism.root, kernels.chain.platform), kernels.geometry_parameters
    ends = [p for link in links for p in parameters if (p.link, p.displacement) == (link, "shift")]
    assert len(ends) == 36
    return ends


def test_the_names_say_what_moves() -> None:
    kernels = planar()
    assert kernels.geometry_parameters == stp.build.geometry_parameters(kernels.chain)
    assert str(kernels.geometry_parameters[2]) == "joint 'left_hip': shift z in 'base'"
    assert kernels.geometry_held == ("left_hip", "right_hip")
    # In platform coordinates as many components as there are freedoms, position before rotation.
    assert stp.compile_kernels(robot("delta")).geometry_held == ("platform vx", "platform vy", "platform vz")
    assert stp.compile_kernels(robot("rpr_planar")).geometry_held == (
        "platform vx",
        "platform vy",
        "platform wz",
    )


def test_arrays_and_single_states(rng: np.random.Generator) -> None:
    kernels, motion = planar(), motion_of_motors(rng)
    motion[0][1] = [np.pi, 0.0]  # the cranks point away from each other
    status, conditioning = np.zeros(STATES, dtype=np.int8), np.zeros(STATES)
    out = np.empty((STATES, 2, 36))
    found = kernels.inverse_dynamics_geometry(*motion, out=out, status=status, conditioning=conditioning)
    assert found is out
    assert status.tolist() == [
        stp.compiled.StateStatus.OK,
        stp.compiled.StateStatus.OUT_OF_BOUNDS,
        stp.compiled.StateStatus.OK,
    ]
    assert conditioning[0] > 1e-3
    assert np.isnan(found[1]).all()
    single = kernels.inverse_dynamics_geometry(*(x[2] for x in motion))
    np.testing.assert_array_equal(single, found[2])
    assert 0 < np.isnan(single).sum() < single.size


@pytest.mark.parametrize("verb", ["inverse_dynamics_geometry", "forward_dynamics_geometry"])
def test_combinations_are_those_of_their_parts(verb: str, rng: np.random.Generator) -> None:
    kernels, motion = planar(), motion_of_motors(rng)
    every = getattr(kernels, verb)(*motion)
    basis = kernels.geometry_displacements
    status, conditioning = np.full(STATES, 7, dtype=np.int8), np.zeros(STATES)
    out = np.empty((STATES, 2, basis.shape[1]))
    places = {"out": out, "status": status, "conditioning": conditioning}
    assert getattr(kernels, verb)(*motion, along=basis, **places) is out
    assert status.tolist() == [stp.compiled.StateStatus.OK] * STATES
    assert (conditioning > 1e-3).all()
    alone = np.count_nonzero(basis, axis=0) == 1
    close(out[..., alone], every[..., ~np.isnan(every).all(axis=(0, 1))], 1e-12)
    # One state, and one state of which several motions are asked.
    close(getattr(kernels, verb)(*(x[1] for x in motion), along=basis), out[1], 1e-12)
    several = getattr(kernels, verb)(motion[0][1], *motion[1:], along=basis)
    close(several[1], out[1], 1e-9)
    both = basis[:, :1] - 2 * basis[:, -1:]
    close(getattr(kernels, verb)(*motion, along=both)[..., 0], out[..., 0] - 2 * out[..., -1], 1e-12)


def test_blocks_of_states_are_one_array(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    kernels, motion = planar(), motion_of_motors(rng)
    basis = kernels.geometry_displacements
    whole = kernels.inverse_dynamics_geometry(*motion, along=basis)
    monkeypatch.setattr("stewart_pin.kernels.verbs.dynamics._BLOCK", 2)
    status = np.full(STATES, 7, dtype=np.int8)
    np.testing.assert_array_equal(
        kernels.inverse_dynamics_geometry(*motion, along=basis, status=status), whole
    )
    assert not status.any()


def test_bad_arguments_are_refused(rng: np.random.Generator) -> None:
    kernels, motion = planar(), motion_of_motors(rng)
    basis = kernels.geometry_displacements
    with pytest.raises(InputError, match=r"along must have shape \(36, n\)"):
        kernels.inverse_dynamics_geometry(*motion, along=basis[:5])
    with pytest.raises(InputError, match=r"along holds joint 'leg1_x'.*none of Kernels.geometry_parameters"):
        kernels.inverse_dynamics_geometry(*motion, along=leg_ends(hexapod()))
    with pytest.raises(InputError, match="finite"):
        kernels.inverse_dynamics_geometry(*motion, along=basis * np.nan)
    with pytest.raises(InputError, match="out must be an array float64"):
        kernels.inverse_dynamics_geometry(*motion, along=basis, out=np.empty((STATES, 2, 2)))
    with pytest.raises(InputError, match="status must be"):
        kernels.inverse_dynamics_geometry(*motion, along=basis, status=np.zeros(2, dtype=np.int8))
    shared = np.zeros((STATES, 2, basis.shape[1]))
    with pytest.raises(InputError, match="out must not share memory with argument 2"):
        kernels.inverse_dynamics_geometry(motion[0], shared[:, :, 0], motion[2], along=basis, out=shared)


def closed_form(chain: stp.ClosedChain, shift: np.ndarray, pose, twist, acceleration) -> np.ndarray:
    """Leg forces of the platform with its twelve points moved by `shift` (2, 6, 3)."""
    geometry = stp.Hexapod.from_chain(chain)
    moved = stp.Hexapod(geometry.base_points + shift[0], geometry.platform_points + shift[1])
    rotation = Rotation.from_quat(pose[3:]).as_matrix()
    bodies = stp.hexapods.hexapod_bodies(chain)
    return stp.hexapods.hexapod_inverse_dynamics(
        moved, bodies, pose[:3], rotation, twist, acceleration
    ).actuator


def forward(chain: stp.ClosedChain, shift: np.ndarray, pose, twist, tau: np.ndarray) -> np.ndarray:
    """Acceleration from the closed form, which is linear in it."""
    bias = closed_form(chain, shift, pose, twist, np.zeros(6))
    columns = [closed_form(chain, shift, pose, twist, unit) - bias for unit in np.eye(6)]
    return np.linalg.solve(np.array(columns).T, tau - bias)


# Differences of order 4 at h = 1 mm: (h/size)⁴/30 and eps/h, both below 1e-10 of the efforts per metre.
@pytest.mark.parametrize("name", slow_but_for_few(["stewart", "stewart_sps"], []))
@pytest.mark.parametrize(
    ("verb", "judge"), [("inverse_dynamics", closed_form), ("forward_dynamics", forward)]
)
def test_ends_of_legs_against_the_closed_form_of_hexapods(
    name: str, verb: str, judge, rng: np.random.Generator
) -> None:
    kernels = hexapod(name)
    pose, twist, acceleration = motion_of_platform(rng)
    third = acceleration
    if verb == "forward_dynamics":
        third = kernels.inverse_dynamics(pose, twist, acceleration)
    found = getattr(kernels, f"{verb}_geometry")(pose, twist, third, along=leg_ends(kernels))
    # The way is that of the legs: nothing was written for the whole tree.
    assert f"{verb}_by_legs" in kernels.report.operations
    assert f"{verb}_by_tree" not in kernels.report.operations
    # Accelerations by the closed form take seven evaluations each: there all ends move at once, in two ways.
    directions = np.eye(36) if verb == "inverse_dynamics" else rng.normal(size=(2, 36))
    for k in range(STATES):
        columns = []
        for direction in directions:
            shift = direction.reshape(2, 6, 3)
            columns.append(
                derivative(lambda t, d=shift, k=k: judge(kernels.chain, t * d, pose[k], twist[k], third[k]))
            )
        close(found[k] @ directions.T, np.transpose(columns), 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stewart", "hexapod_rss"])
def test_moving_everything_moves_nothing(name: str, rng: np.random.Generator) -> None:
    """All feet together by d is the platform by -d: the derivative by its position, with the other sign."""
    kernels = hexapod(name)
    home = stp.platform_pose(kernels.chain, kernels.chain.q_home)
    pose = np.concatenate([home.translation + [0.01, 0.02, 0.0], [0, 0, 0, 1]])
    motion = (pose, 0.2 * rng.normal(size=6), rng.normal(size=6))
    feet = leg_ends(kernels)[:18]
    together = np.array(
        [[float(p in feet and p.axis == k) for k in range(3)] for p in kernels.geometry_parameters]
    )
    found = kernels.inverse_dynamics_geometry(*motion, along=together)
    close(found, -kernels.inverse_dynamics_derivatives(*motion)[0][:, :3], 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_machine_code_of_all_parameters_of_a_hexapod(dtype: type, rng: np.random.Generator) -> None:
    """Fifty thousand operations in one function, after its Newton steps: as the closed forms of the legs have it."""
    kernels = stp.compile_kernels(robot("stewart"), dtype=dtype)
    motion = motion_of_platform(rng)
    every = kernels.inverse_dynamics_geometry(*motion)
    assert every.shape == (STATES, 6, 180)
    assert np.isfinite(every).all()
    ends = leg_ends(kernels)
    places = [kernels.geometry_parameters.index(p) for p in ends]
    by_legs = kernels.inverse_dynamics_geometry(*motion, along=ends)
    close(every[..., places], by_legs, 1e-10 if dtype is np.float64 else 1e-3)
