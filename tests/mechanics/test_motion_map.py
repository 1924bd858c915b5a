"""Explicit maps against closed forms, and what they refuse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ActuationError, InputError, SingularityError, UnsupportedError
from stewart_pin.model.description import JointKind
from tests.closed_states import along, close, derivative, random_configuration, random_motion, robot
from tests.joint_physics import physical
from tests.mechanisms import five_bar, four_bar, rotary_hexapod, two_bodies

CRANK, COUPLER, ROCKER = 0.3, 0.8, 0.6


def four_bar_angles(chain: stp.ClosedChain, q: np.ndarray) -> tuple[float, float, float]:
    """Absolute angles of crank, coupler and rocker."""
    angle = dict(zip(chain.tangent_names, q, strict=True))
    return angle["crank_motor"], angle["crank_motor"] + angle["elbow"], angle["rocker_hinge"]


@pytest.mark.parametrize("kind", [JointKind.SPHERICAL, JointKind.REVOLUTE])
def test_four_bar_rate_ratios(kind: JointKind, rng: np.random.Generator) -> None:
    """The textbook ratios from a sin-law, with redundant rows as well: Norton, "Design of Machinery", eq. (6.18)."""
    chain = four_bar(kind)
    q = random_configuration(chain, rng, 0.4)
    crank, coupler, rocker = four_bar_angles(chain, q)
    ratio_coupler = CRANK * np.sin(rocker - crank) / (COUPLER * np.sin(coupler - rocker))
    ratio_rocker = CRANK * np.sin(crank - coupler) / (ROCKER * np.sin(rocker - coupler))
    G = dict(zip(chain.tangent_names, stp.dynamics.motion_map(chain, q).G[:, 0], strict=True))
    assert G["crank_motor"] == pytest.approx(1.0, abs=1e-12)
    assert G["crank_motor"] + G["elbow"] == pytest.approx(ratio_coupler, rel=1e-9)
    assert G["rocker_hinge"] == pytest.approx(ratio_rocker, rel=1e-9)


def test_four_bar_bias_is_the_second_derivative_of_the_angles(rng: np.random.Generator) -> None:
    chain = four_bar()
    q = random_configuration(chain, rng, 0.4)
    speed = 1.3
    v = stp.dynamics.motion_map(chain, q).G[:, 0] * speed
    at = stp.motor_positions(chain, q)

    def rates(t: float) -> np.ndarray:
        moved = stp.forward_kinematics(chain, at + speed * t, q_guess=q).q
        return stp.dynamics.motion_map(chain, moved).G[:, 0] * speed

    close(stp.dynamics.motion_map(chain, q, v).gamma, derivative(rates), 1e-9)


def test_four_bar_inertia_is_that_of_its_links(rng: np.random.Generator) -> None:
    """Reduced inertia as the handbooks have it: the sum of m v² + I ω² of the links at unit crank speed."""
    chain = four_bar()
    q = random_configuration(chain, rng, 0.4)
    crank, coupler, rocker = four_bar_angles(chain, q)
    G = dict(zip(chain.tangent_names, stp.dynamics.motion_map(chain, q).G[:, 0], strict=True))
    ways = {"crank": 1.0, "coupler": 1.0 + G["elbow"], "rocker": G["rocker_hinge"]}

    def across(angle: float) -> np.ndarray:
        return np.array([-np.sin(angle), np.cos(angle)])

    centres = {
        "crank": CRANK / 2 * across(crank),
        "coupler": CRANK * across(crank) + COUPLER / 2 * ways["coupler"] * across(coupler),
        "rocker": ROCKER / 2 * ways["rocker"] * across(rocker),
    }
    expected = sum(
        (body := chain.mechanism.link(name).inertia).mass * centres[name] @ centres[name]
        + body.inertia[2, 2] * ways[name] ** 2
        for name in ways
    )
    assert stp.operational_dynamics(chain, q).M[0, 0] == pytest.approx(expected, rel=1e-9)


def test_redundant_arm_has_the_operational_space_inertia(rng: np.random.Generator) -> None:
    """Khatib 1987: Λ = (J M⁻¹ Jᵀ)⁻¹, his bias μ, and torques in the null space that change neither."""
    chain = robot("arm_7r")
    q = random_configuration(chain, rng, 0.8)
    v = rng.normal(size=7)
    found = stp.operational_dynamics(chain, q, v, coordinates="platform")
    data = pin.Data(chain.model)
    upper = np.triu(pin.crba(chain.model, data, q))
    M = upper + np.triu(upper, 1).T
    J = np.vstack([chain.at(q).J_c, chain.at(q).P])
    close(found.M, np.linalg.inv(J @ np.linalg.solve(M, J.T)), 1e-9)
    tau_motor = 10 * rng.normal(size=7)
    acceleration = J @ stp.forward_dynamics(chain, q, v, tau_motor).a + derivative(
        lambda t: np.vstack([chain.at(along(chain, q, v)(t)).J_c, chain.at(along(chain, q, v)(t)).P]) @ v
    )
    effort = found.motion.share.T @ tau_motor
    close(found.M @ acceleration + found.c + found.g, effort, 1e-8)


@pytest.mark.parametrize("kind", [kind for kind in JointKind if kind is not JointKind.FLOATING])
@pytest.mark.parametrize("coordinates", ["motor", "platform"])
def test_idle_bodies_of_every_loop(kind: JointKind, coordinates: str, rng: np.random.Generator) -> None:
    """A free body and a ball joint hang on the sled: their tangents do not commute, and all that they do is idle."""
    chain = two_bodies(kind, rng)
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    found = stp.operational_dynamics(chain, q, v, coordinates=coordinates)
    basis = found.motion.coordinates.basis if coordinates == "platform" else coordinates
    curve = along(chain, q, v, a)

    def inertia(t: float) -> np.ndarray:
        return stp.operational_dynamics(chain, stp.close_loops(chain, curve(t)).q, coordinates=basis).M

    # h⁴/30 = 2e-15 times a fifth derivative, large where the free body turns sharply; the gap's round-off over h: 1e-9.
    rate = derivative(inertia, 5e-4)
    assert np.abs(rate - found.C - found.C.T).max() <= 1e-7 * np.abs(found.M).max()
    acceleration = rng.normal(size=1)
    free = found.motion.G @ acceleration + found.motion.gamma
    effort = stp.inverse_dynamics(chain, q, v, free)
    close(effort.a, free, 1e-10)
    close(found.M @ acceleration + found.c + found.g, found.motion.share.T @ effort.tau_motor, 1e-10)
    # They turn, so they push back: the Coriolis matrix of the motor alone does not know it.
    assert np.abs(found.c - found.C @ found.motion.rate).max() > 1e-6


def test_spins_without_inertia_turn_links_least(rng: np.random.Generator) -> None:
    chain = stp.massless_legs(robot("stewart_sps"))
    q = random_configuration(chain, rng)
    v, _ = random_motion(chain, rng, q)
    found = stp.dynamics.motion_map(chain, q, v)
    assert found.rest.shape[1] == 6
    data, axes = pin.Data(chain.model), pin.ReferenceFrame.WORLD
    pin.computeJointJacobians(chain.model, data, q)
    turns = [pin.getJointJacobian(chain.model, data, k, axes)[3:] for k in range(1, chain.model.njoints)]
    assert np.abs(sum((J @ found.rest).T @ (J @ found.G) for J in turns)).max() < 1e-12
    a = found.G @ np.ones(6) + found.gamma
    dynamics = stp.operational_dynamics(chain, q, v)
    close(
        dynamics.M @ np.ones(6) + dynamics.c + dynamics.g,
        stp.inverse_dynamics(chain, q, v, a).tau_motor,
        1e-10,
    )


def test_redundant_motors_are_named_with_a_choice(rng: np.random.Generator) -> None:
    chain = five_bar()
    q = random_configuration(chain, rng)
    with pytest.raises(SingularityError, match=r"are 3, but only 2 .* pass coordinates=\[") as caught:
        stp.dynamics.motion_map(chain, q)
    assert caught.value.names == chain.motors
    v, _ = random_motion(chain, rng, q)
    found = stp.operational_dynamics(chain, q, v, coordinates=["left_hip", "right_hip"])
    close(found.motion.G @ found.motion.rate, v, 1e-10)
    a = found.motion.G @ np.array([1.0, -2.0]) + found.motion.gamma
    effort = stp.inverse_dynamics(chain, q, v, a)
    assert not effort.unique
    close(found.M @ [1.0, -2.0] + found.c + found.g, found.motion.share.T @ effort.tau_motor, 1e-10)


def test_leftover_freedom_is_named(rng: np.random.Generator) -> None:
    chain = five_bar(motors=("left_hip",))
    with pytest.raises(ActuationError, match=r"1 freedom\(s\) left over, the motion .*right") as caught:
        stp.dynamics.motion_map(chain, chain.q_home)
    motion = caught.value.direction
    assert np.abs(stp.loop_jacobian(chain, chain.q_home) @ motion).max() < 1e-12
    assert motion[chain.motor_index] == pytest.approx(0.0, abs=1e-12)
    # The platform's own coordinates determine everything, whatever the motors.
    assert stp.dynamics.motion_map(chain, chain.q_home, coordinates="platform").rest.shape[1] == 0


def test_platform_coordinates_are_axes_where_there_are_axes(rng: np.random.Generator) -> None:
    found = stp.dynamics.motion_map(
        robot("arm_3r_planar"), np.array([0.3, 0.9, -0.4]), coordinates="platform"
    )
    assert len(found.coordinates.names) == 3 and set(found.coordinates.names) <= {
        "vx",
        "vy",
        "vz",
        "wx",
        "wy",
        "wz",
    }
    chain = robot("stewart")
    names = stp.dynamics.motion_map(chain, chain.q_home, coordinates="platform").coordinates.names
    assert names == ("vx", "vy", "vz", "wx", "wy", "wz")
    # Elsewhere a basis, which can be handed back.
    bar = five_bar(motors=("left_hip", "right_hip"))
    found = stp.dynamics.motion_map(bar, bar.q_home, coordinates="platform")
    assert found.coordinates.names == ("mode 1", "mode 2")
    again = stp.dynamics.motion_map(bar, bar.q_home, coordinates=found.coordinates.basis)
    close(again.G, found.G, 1e-12)


def test_platform_wrench_is_the_effort_of_platform_coordinates(rng: np.random.Generator) -> None:
    """A wrench on the platform does what the coordinates say: against RNEA with the wrench outside."""
    chain = rotary_hexapod()
    q = random_configuration(chain, rng)
    v, _ = random_motion(chain, rng, q)
    wrench = rng.normal(size=6)
    found = stp.operational_dynamics(chain, q, v, coordinates="platform")
    acceleration = np.linalg.solve(found.M, wrench - found.c - found.g)
    a = found.motion.G @ acceleration + found.motion.gamma
    # All that RNEA asks for must come from the wrench and from the loops.
    jacobian = np.vstack([chain.at(q).J_c, chain.at(q).P])
    needed = pin.rnea(chain.model, pin.Data(chain.model), q, v, a) - jacobian[chain.nc :].T @ wrench
    left = needed - jacobian[: chain.nc].T @ np.linalg.lstsq(jacobian[: chain.nc].T, needed, rcond=1e-12)[0]
    assert np.abs(left).max() < 1e-10 * np.abs(needed).max()


@pytest.mark.parametrize(
    ("coordinates", "message"),
    [
        ("motors", "'motor', 'platform'"),
        (["hip"], "'hip', which does not move or does not exist"),
        (["left_hip", "left_hip"], "twice"),
        ([], "list of joint names"),
        (np.ones((6, 2)), "depend on each other"),
        (np.full((6, 1), np.nan), "finite"),
    ],
)
def test_unknown_coordinates_are_refused(coordinates: object, message: str) -> None:
    chain = five_bar(motors=("left_hip", "right_hip"))
    with pytest.raises(InputError, match=message):
        stp.dynamics.motion_map(chain, chain.q_home, coordinates=coordinates)


def test_a_twist_that_the_platform_cannot_do_is_refused() -> None:
    chain = five_bar(motors=("left_hip", "right_hip"))
    # The origin of the tip link is the knee: it moves on a circle, and never out of the plane.
    with pytest.raises(SingularityError, match=r"only 1 of them .*\+1·mode 3 stays at rest"):
        stp.dynamics.motion_map(chain, chain.q_home, coordinates=np.eye(6)[:, [0, 1, 2]])


def test_open_loops_are_refused() -> None:
    chain = four_bar()
    with pytest.raises(InputError, match="q does not keep the loops closed"):
        stp.dynamics.motion_map(chain, chain.q_home + 0.1)
    with pytest.raises(InputError, match="v does not keep the loops closed"):
        stp.operational_dynamics(chain, chain.q_home, np.ones(chain.nv))


def test_a_platform_that_cannot_move_is_refused() -> None:
    chain = replace(four_bar(), platform="ground")
    with pytest.raises(UnsupportedError, match="cannot move"):
        stp.dynamics.motion_map(chain, chain.q_home, coordinates="platform")


@pytest.mark.parametrize("ground", [None, stp.dynamics.BaseMotion(twist=[0, 0, 0, 1, 2, 0])])
def test_the_bias_holds_what_joints_make_idle_freedoms_do(
    ground: stp.dynamics.BaseMotion | None, rng: np.random.Generator
) -> None:
    chain = physical("stewart_sps")  # its rods spin, on springs and in bearings that rub
    q = random_configuration(chain, rng)
    state = chain.at(q, *random_motion(chain, rng, q), base_motion=ground)
    found, effort = stp.dynamics.motion_map(state), stp.inverse_dynamics(state)
    close(found.G @ effort.a[chain.motor_index] + found.gamma, effort.a, 1e-9)
