"""Gears, cams and threads: every formulation of the dynamics, against each other and against Lagrange's equation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, MechanismError, UnreachableError, UnsupportedError
from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Mechanism
from stewart_pin.model.unfolding import unfold_cylindrical, unfold_planar, unfold_screw, unfold_universal
from tests.closed_states import along, close, derivative, random_configuration, random_motion
from tests.mechanisms import at, body, gear_train, turned
from tests.zoo import table as zoo


@pytest.fixture(params=["pinion", "wheel", "turn"])
def chain(request: pytest.FixtureRequest, rng: np.random.Generator) -> stp.ClosedChain:
    """Return the gear train, driven at each of its joints in turn: two freedoms, two motors."""
    return gear_train(rng, driven=request.param)


def state(chain: stp.ClosedChain, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q = random_configuration(chain, rng, 0.4)
    return q, *random_motion(chain, rng, q)


def test_a_coupling_takes_one_freedom(chain: stp.ClosedChain) -> None:
    assert (chain.nv, chain.nc, stp.mobility(chain).dof) == (5, 3, 2)
    q = dict(zip(chain.tangent_names, chain.q_home, strict=True))
    x = q["pinion"]
    np.testing.assert_allclose(q["wheel"], 0.2 - 0.4 * x + 0.1 * x**2 + 0.05 * x**3, atol=1e-14)
    np.testing.assert_allclose(q["slide"], 0.1 + 0.02 * 3.0 * q["wheel"], atol=1e-14)


# Differences of order 4 at h = 1e-3: 1e-12 times derivatives of a few units.
def test_jacobian_and_bias_by_differences(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    q = pin.integrate(chain.model, chain.q_home, rng.normal(size=chain.nv))
    v = rng.normal(size=chain.nv)
    curve = along(chain, q, v)
    close(stp.loop_jacobian(chain, q) @ v, derivative(lambda t: stp.loop_gap(chain, curve(t))), 1e-10)
    slope = derivative(lambda t: stp.loop_jacobian(chain, curve(t)) @ v)
    close(stp.loop_bias(chain, q, v), slope, 1e-9)


def test_formulations_agree(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    q, v, a = state(chain, rng)
    effort = stp.inverse_dynamics(chain, q, v, a)
    proof = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix")
    close(proof.tau_motor, effort.tau_motor, 1e-11)
    close(proof.lambda_c, effort.lambda_c, 1e-11)
    motion = stp.forward_dynamics(chain, q, v, effort.tau_motor)
    close(motion.a, a, 1e-11)
    close(motion.lambda_c, effort.lambda_c, 1e-10)
    judge = stp.dynamics.closed_chain_articulated_body(chain, q, v, effort.tau_motor)
    close(judge.a, a, 1e-10)
    close(judge.lambda_c, effort.lambda_c, 1e-10)


def test_power(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    """What the motors give is what the energy gains: gears neither give nor take."""
    q, v, a = state(chain, rng)
    effort = stp.inverse_dynamics(chain, q, v, a)

    def energy(t: float) -> float:
        data = pin.Data(chain.model)
        here = pin.integrate(chain.model, q, v * t + a * t**2 / 2)
        rate = v + a * t
        return pin.computeKineticEnergy(chain.model, data, here, rate) + pin.computePotentialEnergy(
            chain.model, data, here
        )

    np.testing.assert_allclose(effort.tau_motor @ v[chain.motor_index], derivative(energy), rtol=1e-8)


def test_a_gear_box_by_hand() -> None:
    """Motor inertia seen through a gear of ratio n is n² of it; the gear carries what accelerates the motor."""
    n, load, rotor = 5.0, 3.0, 0.01
    links = (
        Link("ground"),
        Link("load", pin.Inertia(1.0, np.zeros(3), np.diag([2.0, 2.0, load]))),
        Link("rotor", pin.Inertia(1.0, np.zeros(3), np.diag([rotor, rotor, rotor]))),
    )
    joints = (
        Joint("load", JointKind.REVOLUTE, "ground", "load", at()),
        Joint("rotor", JointKind.REVOLUTE, "ground", "rotor", at(1.0), independent=True),
    )
    gear = Coupling("gear", "rotor", "load", (0.0, n))
    chain = build_chain(Mechanism("box", links, joints, couplings=(gear,), platform="load"))
    a = np.array([2.0, 2.0 * n])
    effort = stp.inverse_dynamics(chain, chain.q_home, np.zeros(2), a)
    # Motor torque: rotor inertia and the n-th part of the load's.
    np.testing.assert_allclose(effort.tau_motor, rotor * 2.0 * n + load * 2.0 / n, rtol=1e-14)
    # M a = Sᵀ τ + J_cᵀ λ: the load's row of J_c is -n.
    np.testing.assert_allclose(effort.lambda_c, -load * 2.0 / n, rtol=1e-14)


def test_a_constant_coupling_locks_a_joint(rng: np.random.Generator) -> None:
    chain = gear_train(rng)
    held = replace(
        chain.mechanism,
        couplings=(*chain.mechanism.couplings, Coupling("brake", "swing", None, (0.3,))),
    )
    braked = build_chain(held)
    assert stp.mobility(braked).dof == 1
    assert braked.q_home[braked.model.joints[braked.model.getJointId("swing")].idx_q] == pytest.approx(0.3)
    q, v, a = state(braked, rng)
    effort = stp.inverse_dynamics(braked, q, v, a)
    proof = stp.inverse_dynamics(braked, q, v, a, method="constraint_matrix")
    close(proof.tau_motor, effort.tau_motor, 1e-10)


@pytest.mark.parametrize("kind", ["universal", "cylindrical", "planar", "screw"])
def test_unfolded_joints_act_as_one(kind: str, rng: np.random.Generator) -> None:
    """A body on the unfolded joint has the freedoms of the joint, along its axes."""
    place, axis = turned(rng), np.array([0.0, 0.6, 0.8])
    match kind:
        case "universal":
            part = unfold_universal("j", "ground", "body", place, axis, np.array([1.0, 0.0, 0.0]))
        case "cylindrical":
            part = unfold_cylindrical("j", "ground", "body", place, axis)
        case "planar":
            part = unfold_planar("j", "ground", "body", place, axis)
        case _:
            part = unfold_screw("j", "ground", "body", place, axis, 0.5)
    links = (Link("ground"), *part.links, Link("body", body(rng)))
    chain = build_chain(
        Mechanism("m", links, part.joints, couplings=part.couplings, platform="body"),
        motors=[part.joints[0].name],
    )
    expected = {"universal": 2, "cylindrical": 2, "planar": 3, "screw": 1}[kind]
    assert stp.mobility(chain).dof == expected
    q, v, a = state(chain, rng)
    twist = derivative(lambda t: stp.platform_pose(chain, along(chain, q, v)(t)).translation)
    here = stp.platform_pose(chain, q)
    spin = derivative(
        lambda t: pin.log3(stp.platform_pose(chain, along(chain, q, v)(t)).rotation @ here.rotation.T)
    )
    along_axis = place.rotation @ axis
    arm = here.translation - place.translation
    match kind:
        case "universal":
            np.testing.assert_allclose(twist, np.cross(spin, arm), atol=1e-9)
        case "cylindrical":
            np.testing.assert_allclose(np.cross(spin, along_axis), 0, atol=1e-9)
            np.testing.assert_allclose(np.cross(twist - np.cross(spin, arm), along_axis), 0, atol=1e-9)
        case "planar":
            assert abs(twist @ along_axis) < 1e-9
            np.testing.assert_allclose(np.cross(spin, along_axis), 0, atol=1e-9)
        case _:
            # A right-hand thread advances by its lead in a turn.
            np.testing.assert_allclose(twist, along_axis * (spin @ along_axis) * 0.5 / (2 * np.pi), atol=1e-9)
    assert part.note.outcome.value == "changed" and kind in part.note.text
    if kind == "screw":
        effort = stp.inverse_dynamics(chain, q, v, a)
        proof = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix")
        close(proof.tau_motor, effort.tau_motor, 1e-11)


def test_free_motion_keeps_couplings_and_energy(rng: np.random.Generator) -> None:
    chain = gear_train(rng)
    q, v, _ = state(chain, rng)
    run = stp.simulate(chain, q, v, duration=0.5, dt=1e-3)
    assert run.success and run.gap.max() <= 1e-12 * chain.length_scale
    # A fourth-order step of 1 ms at rates of a few per second.
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-8)


def test_pinocchio_s_own_solver_is_refused(chain: stp.ClosedChain) -> None:
    with pytest.raises(UnsupportedError, match="coupling 'cam'"):
        stp.forward_dynamics(
            chain, chain.q_home, np.zeros(chain.nv), np.zeros(2), method="constraint_dynamics"
        )


def test_a_state_off_the_coupling_is_refused(chain: stp.ClosedChain) -> None:
    q = chain.q_home + 0.1
    zero = np.zeros(chain.nv)
    for method in ("pinocchio", "constraint_matrix"):
        with pytest.raises(InputError, match=r"cam|belt|thread"):
            stp.inverse_dynamics(chain, q, zero, zero, method=method)
    with pytest.raises(InputError, match=r"cam|belt|thread"):
        stp.dynamics.closed_chain_articulated_body(chain, q, zero, np.zeros(2))


@pytest.mark.parametrize(
    ("coupling", "words"),
    [
        (Coupling("c", "nobody", "wheel", (0.0, 1.0)), "missing joint 'nobody'"),
        (Coupling("c", "wheel", "nobody", (0.0, 1.0)), "missing joint 'nobody'"),
        (Coupling("c", "wheel", "wheel", (0.0, 1.0)), "to itself"),
        (Coupling("c", "wheel", "swing", ()), "finite coefficients"),
        (Coupling("c", "wheel", "swing", (0.0, np.nan)), "finite coefficients"),
        (Coupling("c", "wheel", None, (0.0, 1.0)), "constant alone"),
        (
            Coupling("c", "wheel", "swing", (0.0, 1.0), (("turn", 0.0),)),
            r"coupling 'c' follows joint 'turn' by the ratio 0 .*or leave the joint out",
        ),
        (Coupling("c", "wheel", "swing", (0.0, 1.0), (("turn", np.inf),)), "by the ratio inf"),
        (
            Coupling("c", "wheel", None, (0.0,), (("turn", 2.0),)),
            "follows joint 'turn' beside others, and has no second joint",
        ),
        (Coupling("cam", "wheel", "swing", (0.0, 1.0)), "2 loop or couplings are called 'cam'"),
    ],
)
def test_bad_couplings_are_refused(coupling: Coupling, words: str, rng: np.random.Generator) -> None:
    chain = gear_train(rng)
    with pytest.raises(MechanismError, match=words):
        build_chain(replace(chain.mechanism, couplings=(*chain.mechanism.couplings, coupling)))


def test_limits_of_gears_hold_at_other_whole_turns_of_a_pose() -> None:
    """The left gear may turn from -3 to 2 rad: with the spider at 3 rad it stands at 2.4, a turn back at -2.6."""
    chain = stp.load(zoo.ROWS["bevel_differential"].file, platform="spider")
    limited = stp.with_limits(chain, {"left_turn": {"position": (-3, 2)}})
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(home.rotation @ pin.AngleAxis(3.0, np.array([1.0, 0, 0])).matrix(), home.translation)
    with pytest.raises(
        UnreachableError, match=r"from this guess.*whole turns of coupled joints were not tried.*q_guess"
    ):
        stp.inverse_kinematics(limited, pose)
    told = stp.inverse_kinematics(limited, pose, throw=False)
    assert not told.success and "start there by q_guess" in told.reason
    found = stp.inverse_kinematics(limited, pose, q_guess=[0, -2.4, 2.4, -3.0])
    np.testing.assert_allclose(found.q, np.array([0, -0.8, 0.8, -1]) * (2 * np.pi - 3), atol=1e-12)
    # Motors tell their turns: there, no other ones would do.
    with pytest.raises(UnreachableError) as caught:
        stp.forward_kinematics(limited, [0.0, 3.0])
    assert "whole turns" not in str(caught.value)
