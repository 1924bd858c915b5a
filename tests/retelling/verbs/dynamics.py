"""Dynamics of one state."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from stewart_pin.model.description import Joint
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, Sized, asks, moves, told_wrenches


@asks("inverse_dynamics", "Effort")
def inverse_dynamics(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    answers: Answers = {}
    for method in ("pinocchio", "constraint_matrix"):
        found = stp.inverse_dynamics(t.chain, q, v, a, method=method)
        answers[method] = t.motors(found.tau_motor)
        if t.joint_by_joint:
            answers[f"{method}, a"] = t.tangent(found.a)
            answers[f"{method}, loops"] = t.cotangent(t.chain.at(q).J_c.T @ found.lambda_c)
    bounded = stp.inverse_dynamics(t.chain, q, v, a, effort_limit=1e3 * c.effort)
    return answers | {"bounded": t.motors(bounded.tau_motor)}


@asks("forward_dynamics", "Motion")
def forward_dynamics(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.q, c.v)
    tau = t.efforts(c.tau_motor)
    answers: Answers = {}
    for method in (None, "projection"):
        a = stp.forward_dynamics(t.chain, q, v, tau, method=method).a
        answers |= moves(t, q, v, a, f", {method}")
    return answers


@asks("closed_chain_articulated_body", "articulated_body_acceleration")
def articulated_bodies(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.q, c.v)
    answers = moves(
        t, q, v, stp.dynamics.closed_chain_articulated_body(t.chain, q, v, t.efforts(c.tau_motor)).a
    )
    if t.joint_by_joint:
        tau = np.linalg.solve(t.T.T, c.chain.at(c.q, c.v).nle)
        answers["tree"] = Sized(
            t.tangent(stp.articulated_body_acceleration(t.chain, q, v, 2 * tau)) / c.chain.tangent_scale, 1.0
        )
    return answers


@asks("inverse_dynamics", "forward_dynamics", "closed_chain_articulated_body", "joint_reactions")
def wrenches(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    outside = told_wrenches(t, c, c.q)
    answers: Answers = {}
    for method in ("pinocchio", "constraint_matrix"):
        found = stp.inverse_dynamics(t.chain, q, v, a, wrenches=outside, method=method)
        answers[method] = t.motors(found.tau_motor)
    tau = t.efforts(c.tau_motor)
    answers |= moves(t, q, v, stp.forward_dynamics(t.chain, q, v, tau, wrenches=outside).a)
    bodies = stp.dynamics.closed_chain_articulated_body(t.chain, q, v, tau, wrenches=outside)
    answers |= moves(t, q, v, bodies.a, ", articulated bodies")
    parts = stp.joint_reactions(t.chain.at(q, v, a), wrenches=outside)
    if t.joint_by_joint:
        # Those that no choice among redundant rows loads.
        own = [part for part in parts if part.name in t.plain.motors and part.unique]
        answers |= {f"force on {part.name}": Sized(np.linalg.norm(part.force), c.effort) for part in own}
    return answers


@asks("inverse_dynamics_derivatives", "forward_dynamics_derivatives")
def derivatives(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    q, v, a = t.state(c.q, c.v, c.a)
    inverse = stp.dynamics.inverse_dynamics_derivatives(t.chain, q, v, a)
    forward = stp.dynamics.forward_dynamics_derivatives(t.chain, q, v, t.efforts(c.tau_motor))
    # Along motions that keep the loops closed: what lies across them depends on how a loop is closed.
    N = c.chain.at(c.q).freedom.motions
    answers = {
        name: t.motors(getattr(inverse, name) @ t.T @ N, axis=0) for name in ("tau_q", "tau_v", "tau_a")
    }
    # A velocity keeps the loops closed on the way: v changes by W, with J W + (rate of J along N) v = 0.
    along = np.stack([stp.loops.loop_jacobian_rate(c.chain, c.q, n) @ c.v for n in N.T], axis=1)
    scale = c.chain.tangent_scale[:, None]
    W = -scale * np.linalg.lstsq(c.chain.at(c.q).J_c * scale.T, along, rcond=1e-10)[0]
    changes = {
        "a_q": forward.a_q @ t.T @ N + forward.a_v @ t.T @ W,
        "a_v": forward.a_v @ t.T @ N,
        "a_tau": t.motors(forward.a_tau),
    }
    driven = t.chain.motor_index
    answers |= {f"{name} of motors": t.motors(rows[driven], axis=0) for name, rows in changes.items()}
    if t.exact:  # a thin rod spins as the last digits of its inertia will have it
        answers |= {name: t.tangent(rows) for name, rows in changes.items()}
    return answers


@asks("joint_reactions")
def joint_reactions(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    q, v, a = t.state(c.q, c.v, c.a)
    found = {part.name: part for part in stp.joint_reactions(t.chain.at(q, v, a))}
    answers: Answers = {}
    for joint in (*c.chain.mechanism.joints, *c.chain.loops):
        if joint.name not in found or not found[joint.name].unique:
            continue
        part = found[joint.name]
        source = joint.parent if isinstance(joint, Joint) else joint.link1
        sign = -1.0 if part.target == source else 1.0
        # About the plain world's origin: the point of a joint may stand elsewhere on its axis.
        arm = t.world.inverse() * part.point
        force, moment = t.twists(part.force), t.twists(part.moment)
        moment = (moment + np.cross(arm, force)) / c.chain.length_scale
        answers[joint.name] = Sized(sign * np.concatenate([force, moment]), c.effort)
    return answers


@asks("platform_stiffness", "platform_compliance")
def platform_stiffness(t: Telling, c: Case) -> Answers:
    stiffness = t.sizes(1e4 * c.effort * (1 + np.arange(c.chain.nu)))
    state = t.state(c.near)[0]
    soft = stp.dynamics.platform_compliance(t.chain, state, motor_stiffness=stiffness)
    answers: Answers = {"compliance": t.twists(t.twists(soft, 0), 1)}
    if (
        c.chain.generic.count.platform == 6
    ):  # of fewer freedoms the least wrench depends on the size of the robot
        stiff = stp.dynamics.platform_stiffness(t.chain, state, motor_stiffness=stiffness)
        answers["stiffness"] = t.twists(t.twists(stiff, 0), 1)
    return answers


@asks("frequency_response")
def frequency_response(t: Telling, c: Case) -> Answers:
    stiffness = t.sizes(1e4 * c.effort * (1 + np.arange(c.chain.nu)))
    found = stp.dynamics.frequency_response(
        t.chain,
        t.state(c.near)[0],
        frequency=[0.7],
        motor_stiffness=stiffness,
        motor_damping=0.02 * stiffness,
    )
    values = t.motors(t.twists(np.stack([found.values[0].real, found.values[0].imag]), 1))
    return {"response": values}


@asks("linearise", "natural_frequencies")
def vibration(t: Telling, c: Case) -> Answers:
    q = t.state(c.near)[0]
    stiffness = t.sizes(1e4 * c.effort * (1 + np.arange(c.chain.nu)))
    found = stp.natural_frequencies(t.chain, q, motor_stiffness=stiffness)
    answers = {
        "frequencies": np.sort(
            found.frequency[np.abs(found.frequency) > 1e-3 * np.abs(found.frequency).max()]
        ),
    }
    system = stp.linearise(t.chain, q)
    # Answer of the joints to efforts at a frequency: the coordinates drop out.
    n, w = system.motions.shape[1], 3.0 + 2.0j
    response = np.linalg.solve(w * np.eye(2 * n) - system.A, system.B)[:n]
    response = t.motors(system.motions @ response)
    if t.joint_by_joint:
        response = t.tangent(response)
        answers["response"] = np.stack([response.real, response.imag])
    return answers


@asks("with_joint_physics", "joint_efforts")
def joint_physics(t: Telling, c: Case) -> Answers:
    """Springs, damping, friction and rotors of the motors; a spring of odd powers pulls alike to both sides."""
    unit = c.effort / c.chain.tangent_scale[c.chain.motor_index]
    rest = t.readings(c.q[c.chain.motor_q_index] - 0.1 * c.chain.tangent_scale[c.chain.motor_index])
    linear, cubic, damping, friction = (
        t.sizes(share * unit * (1 + np.arange(c.chain.nu))) for share in (0.7, 0.3, 0.2, 0.1)
    )
    own = {
        name: {
            "stiffness": (linear[k], 0.0, cubic[k] / c.chain.length_scale**2),
            "rest": rest[k],
            "damping": damping[k],
            "friction": friction[k],
        }
        for k, name in enumerate(t.chain.motors)
    }
    chain = stp.with_joint_physics(t.chain, own)
    q, v, a = t.state(c.q, c.v, c.a)
    given = stp.dynamics.joint_efforts(chain, q, v)
    return {
        "efforts": t.motors(stp.inverse_dynamics(chain, q, v, a, throw=False).tau_motor),
        "own": t.motors((given.elastic + given.viscous + given.dry)[chain.motor_index]),
        "energy": np.array([given.energy, given.dissipation]),
    }


@asks("constraint_matrix_system")
def constraint_matrix_system(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    system = stp.constraint_matrix_system(t.chain, q, v, a)
    # Rows and columns of many units, each brought near one; redundant ones have no say in the motors.
    matrix = system.matrix.toarray()
    scale = 1 / np.sqrt(np.linalg.norm(matrix, axis=0))
    scale /= np.sqrt(np.linalg.norm(scale[:, None] * matrix * scale, axis=0))
    scaled = scale[:, None] * matrix * scale
    x = scale * np.linalg.lstsq(scaled, scale * system.right_hand_side, rcond=1e-12)[0]
    size = system.I.shape[0]
    tau = {
        name: x[size:][columns]
        for name, kind, columns in zip(system.joints, system.kinds, system.columns, strict=True)
        if kind == "motor"
    }
    assert len(tau) == t.chain.nu
    motors = np.concatenate(list(tau.values()))
    return {"motors": t.motors(motors)} if c.chain.nu == stp.mobility(c.chain).dof else {}
