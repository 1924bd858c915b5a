"""Locked joints: the smaller chain moves as the whole one does when these joints are held."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, MechanismError, UnsupportedError
from stewart_pin.model.description import Coupling, JointKind
from tests.building.test_round_trip import assert_same
from tests.closed_states import NAMES, close, random_configuration, random_motion, robot
from tests.mechanisms import gear_train, two_bodies


def entries(chain: stp.ClosedChain, joints: tuple[str, ...], size: str) -> np.ndarray:
    """Find the indices of joints in the configuration (size "q") or in the tangent ("v")."""
    found = []
    for name in joints:
        joint = chain.model.joints[chain.model.getJointId(name)]
        start, count = getattr(joint, f"idx_{size}"), getattr(joint, f"n{size}")
        found += range(start, start + count)
    return np.array(found, dtype=int)


def held_acceleration(
    chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray, tau: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """Solve M a + nle = tau + forces of loops and of held joints, J a = -bias, a = 0 where held, at once."""
    model, data = chain.model, pin.Data(chain.model)
    upper = np.triu(np.reshape(pin.crba(model, data, q), (chain.nv, chain.nv)))
    inertia = upper + np.triu(upper, 1).T
    push = tau - pin.nonLinearEffects(model, data, q, v)
    scale = chain.tangent_scale
    # In natural units, so that redundant rows are told from round-off: a row that is round-off must stay it.
    sizes = np.concatenate([chain.row_sizes, scale[held]])
    rows = np.vstack([stp.loop_jacobian(chain, q), np.eye(chain.nv)[held]]) * scale / sizes[:, None]
    bias = np.concatenate([stp.loop_bias(chain, q, v), np.zeros(len(held))]) / sizes
    size = np.abs(scale[:, None] * inertia * scale).max()
    system = np.block(
        [[scale[:, None] * inertia * scale / size, rows.T], [rows, np.zeros((len(rows), len(rows)))]]
    )
    right = np.concatenate([scale * push / size, -bias])
    return scale * np.linalg.lstsq(system, right, rcond=1e-12)[0][: chain.nv]


def moving_with(
    chain: stp.ClosedChain, held: np.ndarray, q: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Draw a velocity that keeps the loops closed and the held joints at rest."""
    rows = np.vstack([stp.loop_jacobian(chain, q), np.eye(chain.nv)[held]]) * chain.tangent_scale
    _, s, vt = np.linalg.svd(rows)
    free = vt[np.count_nonzero(s > 1e-9 * s[0]) :]
    return chain.tangent_scale * (rng.normal(size=len(free)) @ free)


def require_same_motion(chain: stp.ClosedChain, joints: tuple[str, ...], rng: np.random.Generator) -> None:
    """Compare the chain with locked joints to the whole one with held joints: pose, acceleration, efforts."""
    q = random_configuration(chain, rng)
    small = stp.lock_joints(chain, joints, q)
    at_q, at_v = entries(chain, joints, "q"), entries(chain, joints, "v")
    assert small.motors == tuple(motor for motor in chain.motors if motor not in joints)
    assert [*small.model.names] == [name for name in chain.model.names if name not in joints]
    size = max(1.0, chain.length_scale)
    np.testing.assert_allclose(small.q_home, np.delete(q, at_q), atol=1e-12 * size)
    np.testing.assert_allclose(
        stp.platform_pose(small, small.q_home).homogeneous,
        stp.platform_pose(chain, q).homogeneous,
        atol=1e-12 * size,
    )
    v = moving_with(chain, at_v, q, rng)
    weight = np.abs(pin.computeGeneralizedGravity(chain.model, pin.Data(chain.model), q)).max()
    tau_motor = (1.0 + weight) * rng.normal(size=small.nu)
    tau = np.zeros(chain.nv)
    tau[[chain.model.joints[chain.model.getJointId(motor)].idx_v for motor in small.motors]] = tau_motor
    whole = held_acceleration(chain, q, v, tau, at_v)
    motion = stp.forward_dynamics(small, small.q_home, np.delete(v, at_v), tau_motor)
    scale = np.delete(chain.tangent_scale, at_v)
    error = np.abs(motion.a - np.delete(whole, at_v)) / scale
    # The judge solves one large system, whose condition grows with the square of the thinnest rod's.
    assert error.max(initial=0.0) <= 1e-7 * max(1.0, np.abs(motion.a / scale).max(initial=0.0))


@pytest.mark.parametrize("name", NAMES)
def test_random_joints_of_every_robot(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    moving = list(chain.model.names[1:])
    for count in (1, 2):
        joints = tuple(str(joint) for joint in rng.choice(moving, min(count, len(moving) - 1), replace=False))
        require_same_motion(chain, joints, rng)


@pytest.mark.parametrize("joints", [("drive",), ("ball",), ("float",), ("ball", "drive")])
def test_joints_of_several_freedoms(joints: tuple[str, ...], rng: np.random.Generator) -> None:
    require_same_motion(two_bodies(JointKind.REVOLUTE, rng), joints, rng)


@pytest.mark.parametrize(
    "joints", [("pinion",), ("wheel",), ("slide",), ("wheel", "slide"), ("swing",), ("turn",)]
)
def test_coupled_joints(joints: tuple[str, ...], rng: np.random.Generator) -> None:
    require_same_motion(gear_train(rng), joints, rng)


@pytest.mark.parametrize(
    "joints", [("planet",), ("pinion",), ("slide",), ("turn", "slide"), ("planet", "turn")]
)
def test_joints_of_a_differential(joints: tuple[str, ...], rng: np.random.Generator) -> None:
    require_same_motion(gear_train(rng, differential=True), joints, rng)


def test_inverse_dynamics_of_the_motors_that_are_left(rng: np.random.Generator) -> None:
    """A locked leg pushes as its motor would; the other five give what they give in the whole robot."""
    chain = robot("stewart")
    q = random_configuration(chain, rng)
    small, leg = stp.lock_joints(chain, ["leg3"], q), entries(chain, ("leg3",), "v")
    v, a = random_motion(small, rng, small.q_home)
    whole = [np.insert(x, leg[0], 0.0) for x in (v, a)]
    expected = np.delete(stp.inverse_dynamics(chain, q, *whole).tau_motor, 2)
    for method in ("pinocchio", "constraint_matrix"):
        close(stp.inverse_dynamics(small, small.q_home, v, a, method=method).tau_motor, expected, 1e-10)


def test_freedoms_that_are_left() -> None:
    chain = robot("stewart")
    for count in range(1, 7):
        found = stp.mobility(stp.lock_joints(chain, [f"leg{k}" for k in range(1, count + 1)]))
        assert (found.dof, found.motors_sufficient) == (6 - count, True)
    # A rod without spin is the classical universal leg.
    sps = stp.lock_joints(robot("stewart_sps"), [f"leg{k}_z" for k in range(1, 7)])
    found = stp.mobility(sps)
    assert (found.dof, found.idle) == (6, ())


def test_a_structure_is_allowed_and_has_statics() -> None:
    """Without a freedom left, the legs' loops carry the weight that the legs' motors carried."""
    chain = robot("stewart")
    small = stp.lock_joints(chain, list(chain.motors))
    rest = np.zeros(small.nv)
    effort = stp.inverse_dynamics(small, small.q_home, rest, rest)
    assert effort.tau_motor.shape == (0,) and effort.residual < 1e-9
    whole = stp.inverse_dynamics(chain, chain.q_home, np.zeros(chain.nv), np.zeros(chain.nv))
    close(effort.lambda_c, whole.lambda_c, 1e-11)
    assert not stp.forward_dynamics(small, small.q_home, rest, []).a.any()


@pytest.mark.parametrize(
    ("name", "joints"),
    [
        ("stewart", ("leg2", "leg5_x")),
        ("delta", ("rod1a_spin", "motor2")),
        ("rpr_planar", ("platform_pose",)),
        ("five_bar", ("left_knee",)),
    ],
)
def test_files_keep_the_smaller_chain(
    name: str, joints: tuple, tmp_path: Path, rng: np.random.Generator
) -> None:
    chain = robot(name)
    small = stp.lock_joints(chain, joints, random_configuration(chain, rng))
    stp.write_urdf(small, tmp_path / "small.urdf")
    assert_same(small, stp.load(tmp_path / "small.urdf"))


def test_gravity_platform_and_the_first_chain_stay() -> None:
    chain = stp.load("stewart", gravity=(1.0, 0.0, -3.0))
    small = stp.lock_joints(chain, ["leg1"])
    np.testing.assert_array_equal(small.gravity, [1.0, 0.0, -3.0])
    assert (small.platform, small.name) == (chain.platform, chain.name)
    assert chain.nv == 24 and chain.mechanism.joint("leg1").kind is JointKind.PRISMATIC


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (["leg9"], "joints name 'leg9', which is no joint; the joints that move are: leg1_x"),
        (["leg1", "leg1"], "joints name a joint twice"),
        ("leg1", "joints must be a sequence of joint names, got 'leg1'"),
    ],
)
def test_bad_joints_are_named(joints, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.lock_joints(robot("stewart"), joints)


def test_what_is_fixed_or_all_there_is_cannot_be_locked() -> None:
    with pytest.raises(InputError, match="'tool', which is fixed already"):
        stp.lock_joints(robot("five_bar"), ["tool"])
    with pytest.raises(InputError, match="every joint that moves"):
        stp.lock_joints(robot("arm_3r_planar"), ["joint1", "joint2", "joint3"])


def test_open_loops_are_refused_and_printed_digits_are_not(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    step = rng.normal(size=chain.nv)
    with pytest.raises(
        InputError, match=r"q does not keep the loops closed: .* leg\d_ball row \d; see close_loops"
    ):
        stp.lock_joints(chain, ["leg1"], pin.integrate(chain.model, chain.q_home, 0.01 * step))
    near = pin.integrate(chain.model, chain.q_home, 1e-8 * step)
    small = stp.lock_joints(chain, list(chain.motors) + ["leg1_x"], near)  # held twice: no room for a gap
    assert np.abs(stp.loop_gap(small, small.q_home)).max() < 1e-12


def test_a_stationary_cam_does_not_hold_its_shaft(rng: np.random.Generator) -> None:
    """At the top of a cam the follower stands still whatever the shaft does: locking it would lock nothing."""
    chain = gear_train(rng)
    x = float(chain.q_home[entries(chain, ("pinion",), "q")[0]])
    cam = Coupling("lift", "swing", "pinion", (0.3 + x**2, -2 * x, 1.0))  # 0.3 + (pinion - x)²
    home = dict(chain.described().home) | {"swing": np.array([0.3])}
    stopped = build_chain(
        replace(chain.described(), couplings=(*chain.couplings, cam), home=home),
        motors=chain.motors,
        platform=chain.platform,
    )
    with pytest.raises(
        UnsupportedError, match="'swing' cannot be locked alone here: its coupling 'lift' is stationary"
    ):
        stp.lock_joints(stopped, ["swing"])
    assert stp.lock_joints(stopped, ["swing", "pinion"]).nv == stopped.nv - 2


def test_a_home_beyond_the_limits_of_a_joint_is_refused() -> None:
    chain = robot("stewart")
    high = pin.SE3(np.eye(3), np.array([0.0, 0.0, 2.0]))
    q = stp.inverse_kinematics(chain, high, limits=False).q
    with pytest.raises(
        MechanismError, match=r"joint 'leg2' would stand at 2.0\d+, beyond its limits 0.5 to 1.8"
    ):
        stp.lock_joints(chain, ["leg1"], q)
