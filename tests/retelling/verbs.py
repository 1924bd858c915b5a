"""Every public verb that takes a chain, asked of a chain however it is told, its answer brought back to plain terms.

A verb is a function of a `Telling` and a `Case`; it returns arrays by name. What depends on the frames of a loop alone,
as the rows of its gap, is compared by what it does to the joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.model.description import Joint
from tests.retelling.case import TIMES, Case, sway
from tests.retelling.tellings import Telling


@dataclass(frozen=True, eq=False)
class Sized:
    """An answer that may happen to be zero, with what it would usually be."""

    value: Any
    size: float


Answers = dict[str, Any]
Verb = Callable[[Telling, Case], Answers]
VERBS: dict[str, Mapping[str, Verb]] = {}
"""How each public name is asked, by name of the question."""
KINDS: dict[str, str] = {}
"""Kind of each question: quick, slow, or compiled, which takes seconds."""


def asks(*names: str, kind: str = "quick") -> Callable[[Verb], Verb]:
    """Enter a question for the public names that it asks."""

    def enter(verb: Verb) -> Verb:
        question = verb.__name__.strip("_")
        for name in names:
            VERBS[name] = {**VERBS.get(name, {}), question: verb}
        KINDS[question] = kind
        return verb

    return enter


def _of_rows(t: Telling, q: np.ndarray, rows: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Bring back what rows of loops do to the joints, whatever frames they stand in."""
    return t.cotangent(stp.loop_jacobian(t.chain, q).T @ rows(q))


def _pose(t: Telling, c: Case, q: np.ndarray) -> pin.SE3:
    """Tell a pose; printed digits tilt what a planar platform can reach, so that it is asked for its own."""
    if t.exact:
        return t.world * stp.platform_pose(c.chain, q)
    return stp.platform_pose(t.chain, t.state(q)[0])


def _motion(t: Telling, c: Case, scale: float, times: np.ndarray = TIMES) -> stp.PlatformSamples:
    """Tell a motion of the platform, or have the told chain make its own."""
    if t.exact:
        return t.samples(c.motion(scale, tuple(times)))
    return sway(
        t.chain,
        t.readings(stp.motor_positions(c.chain, c.chain.q_home)),
        t.efforts(c.amplitude(scale)),
        t.sizes(c.frequency),
        times,
    )


# --- states, loops, kinematics ---------------------------------------------------------------------------------


@asks("loop_gap", "loop_jacobian", "loop_jacobian_rate", "loop_bias")
def loops(t: Telling, c: Case) -> Answers:
    if not (t.joint_by_joint and t.same_rows):
        return {}
    q, v, _ = t.state(c.q, c.v)
    J, N = stp.loop_jacobian(t.chain, q), t.T @ c.chain.at(c.q).freedom.motions
    is_open = t.q(c.q_open)
    # A gap has no frame to stand in but that of its first end.
    gap = {"gap": _of_rows(t, is_open, lambda q: stp.loop_gap(t.chain, q))} if t.same_gap else {}
    return {
        **gap,
        "jacobian": t.cotangent(t.cotangent(J.T @ J).T),
        # Along motions that keep the loops closed, where frames that turn have no gap to turn.
        "rate": t.cotangent(J.T @ stp.loop_jacobian_rate(t.chain, q, v) @ N),
        "rate of motions": t.cotangent(J.T @ stp.loop_jacobian_rate(t.chain, q, v, N)),
        "bias": _of_rows(t, q, lambda q: stp.loop_bias(t.chain, q, v)),
    }


@asks("State", "platform_pose", "motor_positions", "motor_jacobian")
def state(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    told = t.chain.at(q, v, a)
    answers = {
        "pose": t.pose(stp.platform_pose(told)),
        "twist": t.twists(told.twist),
        "acceleration": t.twists(told.P @ a + told.platform_bias),
        "motor positions": t.positions(stp.motor_positions(t.chain, q)),
        "motor rates": t.motors(told.v[t.chain.motor_index]),
        "motor jacobian": t.motors(stp.motor_jacobian(t.chain, q) @ told.twist),
        "energy": v @ told.M @ v,
    }
    if t.same_size:
        answers["all of it"] = t.motors(t.twists(stp.motor_jacobian(t.chain, q)), axis=0)
    if t.joint_by_joint and t.same_rows:
        answers["size"] = t.chain.length_scale
    if t.joint_by_joint:
        answers |= {
            "M": t.cotangent(t.cotangent(told.M).T),
            "nle": t.cotangent(told.nle),
            "coriolis": t.cotangent(told.coriolis @ v) if np.ndim(told.coriolis) == 2 else told.coriolis,
            "weight": Sized(t.cotangent(told.weight), c.effort),
            "platform rows": t.twists(t.cotangent(told.P.T).T, axis=0),
        }
    return answers


@asks("close_loops", "Closure")
def close_loops(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    found = stp.close_loops(t.chain, t.q(c.q_open))
    if not (t.same_rows and t.same_gap):
        return {"success": found.success}  # Newton's steps from open loops are others
    return {"q": t.configuration(found.q), "iterations": found.iterations}


@asks("inverse_kinematics")
def inverse_kinematics(t: Telling, c: Case) -> Answers:
    answers: Answers = {}
    # Home may stand at a limit, which printed digits put on either side.
    for limits in (True, False):
        found = stp.inverse_kinematics(t.chain, _pose(t, c, c.near), limits=limits)
        answers |= _found(t, found, f", limits {limits}")
    return answers


def _found(t: Telling, found: stp.Closure, note: str = "") -> Answers:
    answers = {
        "motors" + note: t.positions(stp.motor_positions(t.chain, found.q)),
        "pose" + note: t.pose(stp.platform_pose(t.chain, found.q)),
    }
    # Idle freedoms are left where Newton's steps from open loops happen to leave them.
    if t.joint_by_joint and (t.same_gap or not stp.mobility(t.chain).idle):
        answers["q" + note] = t.configuration(found.q)
    return answers


@asks("forward_kinematics")
def forward_kinematics(t: Telling, c: Case) -> Answers:
    readings = t.readings(stp.motor_positions(c.chain, c.near))
    return _found(t, stp.forward_kinematics(t.chain, readings))


@asks("all_forward_kinematics", kind="slow")
def all_forward_kinematics(t: Telling, c: Case) -> Answers:
    if c.chain.nv > 4 or not t.joint_by_joint:
        return {}  # few starts find all solutions of a planar chain only
    readings = t.readings(stp.motor_positions(c.chain, c.near))
    found = stp.all_forward_kinematics(t.chain, readings, starts=60)
    poses = np.array([t.pose(pose) for pose in found.poses])
    return {"poses": poses[np.lexsort(poses.reshape(len(poses), -1).round(6).T[::-1])]}


@asks("platform_motion")
def platform_motion(t: Telling, c: Case) -> Answers:
    plain = c.chain.at(c.q, c.v)
    pose, twist, acceleration = (
        t.world * plain.pose,
        t.turned(plain.twist),
        t.turned(plain.P @ c.a + plain.platform_bias),
    )
    if not t.exact:
        q, v, a = t.state(c.q, c.v, c.a)
        told = t.chain.at(q, v)
        pose, twist, acceleration = told.pose, told.twist, told.P @ a + told.platform_bias
    found = stp.platform_motion(
        t.chain,
        pose,
        twist,
        acceleration,
        q_guess=t.state(c.q)[0],
        limits=False,
    )
    answers = {
        "motors": t.positions(found.q[t.chain.motor_q_index]),
        "rates": t.motors(found.v[t.chain.motor_index]),
        "accelerations": t.motors(found.a[t.chain.motor_index]),
    }
    if t.joint_by_joint:
        answers |= {"v": t.tangent(found.v), "a": t.tangent(found.a)}
    return answers


@asks("motion_map", "operational_dynamics")
def operational_dynamics(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.q, c.v)
    motor = stp.operational_dynamics(t.chain, q, v)
    answers = {
        "M": t.motors(t.motors(motor.M, 0), 1),
        "c": t.motors(motor.c),
        "g": Sized(t.motors(motor.g), c.effort),
    }
    if t.joint_by_joint:
        answers |= {
            "G": t.motors(t.tangent(motor.motion.G)),
            "gamma": t.tangent(motor.motion.gamma),
        }
    # Of a platform with fewer freedoms the coordinates are other twists in another world.
    platform = stp.motion_map(t.chain, q, v, coordinates="platform")
    basis = platform.coordinates.basis
    assert basis is not None
    twist = t.twists(basis @ platform.rate)
    answers |= {"platform twist": twist, "share": t.motors(platform.share @ platform.rate)}
    told = stp.operational_dynamics(t.chain, q, v, coordinates="platform")
    answers["kinetic energy"] = platform.rate @ told.M @ platform.rate
    if t.same_size:
        answers["power"] = platform.rate @ told.c
    return answers


@asks("joint_motor_map")
def joint_motor_map(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    q, v, _ = t.state(c.q, c.v)
    # Joints of one freedom have a rate of their own in every telling.
    names = [j.name for j in c.chain.mechanism.joints if j.has_axis][:3]
    found = stp.joint_motor_map(t.chain, q, names, v)
    signs = np.array([t.joints[name].sign if name in t.joints else 1.0 for name in names])
    answers = {"J": signs[:, None] * t.motors(found.J), "bias": signs * found.bias}
    if found.inverse is not None:
        answers["inverse"] = t.motors(found.inverse, 0) * signs
    return answers


@asks("mobility")
def mobility(t: Telling, c: Case) -> Answers:
    found = stp.mobility(t.chain)
    return {
        "counts": np.array([found.dof, found.dof_home, found.surplus_motors, len(found.idle)]),
        **({"rows": np.array([found.redundant_rows, found.lost])} if t.same_rows else {}),
        "said": np.array([found.motors_sufficient, found.home_singular, found.verdict == "sufficient"]),
        "spare": np.array([len(found.spare_motors), len(found.free_joints)]),
    }


@asks("generic_freedom", "classify_singularity")
def classify_singularity(t: Telling, c: Case) -> Answers:
    counts = stp.generic_freedom(t.chain)
    found = stp.classify_singularity(t.chain, t.state(c.q)[0])
    measures = [found.measures[kind] for kind in sorted(found.measures)]
    answers: Answers = {
        "counts": np.array([counts.dof, counts.motor, counts.platform, counts.either]),
    }
    if t.same_size:
        answers["condition"] = found.condition_number
    if t.joint_by_joint and t.same_size:  # a measure counts all joints of the tree
        answers |= {str(kind): found.measures[kind] for kind in ("motor", "platform")}
    if t.joint_by_joint and t.same_size and t.same_rows:
        answers["measures"] = np.array(measures)
    return answers


@asks("closed_path", "find_singularity", "SingularityOnPath", kind="slow")
def find_singularity(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    stops = np.array([t.state(c.chain.q_home)[0], t.state(c.near)[0]])
    path = stp.closed_path(t.chain, stops)
    found = stp.find_singularity(t.chain, path, kinds=["motor"], samples=9)
    # Newton's steps from the straight line, whose gaps are others.
    midway = {"midway": t.pose(stp.platform_pose(t.chain, path(0.5)))} if t.same_gap else {}
    return {
        **midway,
        "found": found.found,
        "distance": found.distance if found.found else 0.0,
    }


@asks("singularity_map", kind="slow")
def singularity_map(t: Telling, c: Case) -> Answers:
    plane = (t.world.rotation == np.eye(3)).all()
    if c.chain.name != "five_bar" or not (plane and t.joint_by_joint and t.same_size and t.exact):
        return {}  # a plane of the world is another one where the base is turned
    at = stp.platform_pose(c.chain, c.chain.q_home).translation
    found = stp.singularity_map(
        t.chain, at[0] + np.linspace(-0.05, 0.05, 4), at[1] + np.linspace(-0.05, 0.05, 3), axes=("vx", "vy")
    )
    return {str(kind): found.measures[kind] for kind in ("motor", "platform")}


# --- dynamics --------------------------------------------------------------------------------------------------


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
        answers |= _moves(t, q, v, a, f", {method}")
    return answers


def _moves(t: Telling, q: np.ndarray, v: np.ndarray, a: np.ndarray, note: str = "") -> Answers:
    told = t.chain.at(q, v)
    answers = {
        "motors" + note: t.motors(a[t.chain.motor_index]),
        "platform" + note: t.twists(told.P @ a + told.platform_bias),
    }
    return answers | ({"a" + note: t.tangent(a)} if t.joint_by_joint else {})


@asks("closed_chain_articulated_body", "articulated_body_acceleration")
def articulated_bodies(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.q, c.v)
    answers = _moves(t, q, v, stp.closed_chain_articulated_body(t.chain, q, v, t.efforts(c.tau_motor)).a)
    if t.joint_by_joint:
        tau = np.linalg.solve(t.T.T, c.chain.at(c.q, c.v).nle)
        answers["tree"] = Sized(
            t.tangent(stp.articulated_body_acceleration(t.chain, q, v, 2 * tau)) / c.chain.tangent_scale, 1.0
        )
    return answers


@asks("inverse_dynamics_derivatives", "forward_dynamics_derivatives")
def derivatives(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    q, v, a = t.state(c.q, c.v, c.a)
    inverse = stp.inverse_dynamics_derivatives(t.chain, q, v, a)
    forward = stp.forward_dynamics_derivatives(t.chain, q, v, t.efforts(c.tau_motor))
    # Along motions that keep the loops closed: what lies across them depends on how a loop is closed.
    N = c.chain.at(c.q).freedom.motions
    answers = {
        name: t.motors(getattr(inverse, name) @ t.T @ N, axis=0) for name in ("tau_q", "tau_v", "tau_a")
    }
    # A velocity keeps the loops closed on the way: v changes by W, with J W + (rate of J along N) v = 0.
    along = np.stack([stp.loop_jacobian_rate(c.chain, c.q, n) @ c.v for n in N.T], axis=1)
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


@asks("platform_stiffness")
def platform_stiffness(t: Telling, c: Case) -> Answers:
    stiffness = t.sizes(1e4 * c.effort * (1 + np.arange(c.chain.nu)))
    found = stp.platform_stiffness(t.chain, t.state(c.near)[0], motor_stiffness=stiffness)
    return {"stiffness": t.twists(t.twists(found, 0), 1)}


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


# --- demand, control, simulation -----------------------------------------------------------------------------------


@asks("motor_demand")
def motor_demand(t: Telling, c: Case) -> Answers:
    return _demand(t, stp.motor_demand(t.chain, _motion(t, c, 1.0), kernels=False))


@asks("motor_demand", kind="compiled")
def demand_by_kernels(t: Telling, c: Case) -> Answers:
    return _demand(t, stp.motor_demand(t.chain, _motion(t, c, 1.0), kernels=True))


def _demand(t: Telling, found: stp.MotorDemand) -> Answers:
    return {
        "positions": t.positions(found.positions),
        "rates": t.motors(found.rates),
        "efforts": t.motors(found.efforts),
    }


@asks("compare_methods", kind="slow")
def compare_methods(t: Telling, c: Case) -> Answers:
    found = stp.compare_methods(t.chain, _motion(t, c, 1.0), kernels=False)
    # The closed form of legs counts their turns from base x.
    answers: Answers = {} if t.turned_base else {"methods": len(found.forces)}
    for title, table in (
        ("forces", found.forces),
        ("simplified", found.simplified),
        ("part", found.contributions),
    ):
        # A part may weigh nothing, as the turning of a point.
        answers |= {f"{title}: {name}": Sized(t.motors(tau), c.effort) for name, tau in table.items()}
    return answers


@asks("sweep_demand")
def sweep_demand(t: Telling, c: Case) -> Answers:
    found = stp.sweep_demand(
        t.chain, lambda scale: _motion(t, c, scale), {"scale": [0.5, 1.0]}, kernels=False
    )
    return {
        name: t.unsigned(found[name])
        for name in ("peak_effort", "rms_effort", "travel", "peak_rate", "peak_power", "mean_power")
    }


@asks("fit_to_limits")
def fit_to_limits(t: Telling, c: Case) -> Answers:
    if not t.same_limits:
        return {}
    found = stp.fit_to_limits(t.chain, lambda scale: _motion(t, c, 5 * scale), margin=0.1)
    answers: Answers = {"scale": found.scale, "efforts": t.motors(found.demand.efforts)}
    if found.binding is not None:
        # A tie between motors, or samples, is decided by round-off.
        answers |= {"use": found.binding.use, "limit": found.binding.limit}
    answers |= {f"unscaled {b.limit}": b.use for b in found.unscaled}
    return answers


@asks("ComputedTorque")
def computed_torque(t: Telling, c: Case) -> Answers:
    reference = lambda times: _motion(t, c, 1.0, times)  # noqa: E731
    q, v, _ = t.state(c.near, _keeps(c, c.near))
    if not t.same_size:
        return {}  # what is left of a correction that the platform cannot do
    return {"efforts": t.motors(stp.ComputedTorque(t.chain, reference)(0.1, q, v))}


@asks("Feedforward", "LegPID", "GravityCompensation", "SampledController")
def control(t: Telling, c: Case) -> Answers:
    reference = lambda times: _motion(t, c, 1.0, times)  # noqa: E731
    q, v, _ = t.state(c.near, _keeps(c, c.near))
    pid = stp.LegPID(t.chain, reference, kp=1e3 * c.effort, kd=10 * c.effort)
    answers: Answers = {
        "feedforward": stp.Feedforward(t.chain, reference)(0.1, q, v),
        "pid": pid(0.1, q, v),
        "integral": stp.LegPID(t.chain, reference, ki=1e3 * c.effort).state_rate(
            0.1, q, v, np.zeros(t.chain.nu)
        ),
        "gravity": stp.GravityCompensation(t.chain)(0.1, q, v),
        "sampled": stp.SampledController(t.chain, pid)(0.1, q, v),
    }
    return {
        name: Sized(t.motors(tau), c.effort if name != "integral" else 0.0) for name, tau in answers.items()
    }


@asks("Feedforward", "ComputedTorque")
def control_by_a_point(t: Telling, c: Case) -> Answers:
    reference = lambda times: _motion(t, c, 1.0, times)  # noqa: E731
    q, v, _ = t.state(c.near, _keeps(c, c.near))
    return {
        make.__name__: t.motors(make(t.chain, reference, model="point_mass")(0.1, q, v))
        for make in (stp.Feedforward, stp.ComputedTorque)
    }


def _keeps(c: Case, q: np.ndarray) -> np.ndarray:
    """Draw a velocity that keeps the loops closed."""
    return stp.motion_map(c.chain, q).G @ c.v[c.chain.motor_index]


@asks("simulate", "resume", "Simulation", kind="slow")
def simulate(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.near, 0.1 * _keeps(c, c.near))
    hold = stp.GravityCompensation(t.chain)
    first = stp.simulate(t.chain, q, v, hold, duration=0.01, dt=2e-3, kernels=False)
    found = stp.resume(t.chain, first.final_state, hold, duration=0.01, kernels=False)
    return {
        "efforts": Sized(t.motors(found.tau_motor), c.effort),
        "positions": t.positions(found.q[:, t.chain.motor_q_index]),
        "rates": t.motors(found.v[:, t.chain.motor_index]),
        "platform": t.twists(found.platform.twist),
        "gained": Sized(found.energy[-1] - found.energy[0], c.effort * c.chain.length_scale),
    }


# --- capability -------------------------------------------------------------------------------------------------


@asks("velocity_polytope", "wrench_polytope", kind="slow")
def polytopes(t: Telling, c: Case) -> Answers:
    if not t.same_size:
        return {}
    q, rng, L = t.state(c.near)[0], np.random.default_rng(5), c.chain.length_scale
    answers: Answers = {}
    moves = c.chain.at(c.near).P @ stp.motion_map(c.chain, c.near).G
    limit = t.sizes(1.0 + 0.2 * np.arange(c.chain.nu))
    for name, found in (
        ("velocity", stp.velocity_polytope(t.chain, q, rate_limit=limit)),
        ("wrench", stp.wrench_polytope(t.chain, q, effort_limit=c.effort * limit, gravity=True)),
    ):
        answers[f"{name} ball"] = stp.inscribed_ball(found).radius
        if found.vertices.shape[1] == 6:
            along = moves @ rng.normal(size=(c.chain.nu, 4))
            along = along / np.where(np.arange(6) < 3, L, 1.0)[:, None]
            answers[name] = np.array([stp.polytope_support(found, t.turned(x)) for x in along.T])
    return answers


# --- closed forms -------------------------------------------------------------------------------------------------


@asks("assembly_modes", kind="slow")
def assembly_modes(t: Telling, c: Case) -> Answers:
    readings = t.readings(stp.motor_positions(c.chain, c.near))
    found = stp.assembly_modes(t.chain, readings, engine="numpy")
    poses = [t.pose(pin.SE3(R, p)) for R, p in zip(found.rotation, found.position, strict=True)]
    answers: Answers = {"poses": np.array(sorted(poses, key=lambda pose: tuple(pose.ravel().round(4))))}
    # Points that lie in one plane to few digits only have more complex poses.
    return answers | ({"complex": found.n_complex} if t.exact else {})


@asks("hexapod_bodies")
def hexapod_bodies(t: Telling, c: Case) -> Answers:
    found = stp.hexapod_bodies(t.chain)
    answers: Answers = {"joint": found.lower_joint == "universal"}
    lower, upper = (part if isinstance(part, tuple) else (part,) * 6 for part in (found.lower, found.upper))
    legs = [(lower[k], upper[k]) for k in t.order]
    for name, parts in (("platform", [(found.platform,)]), ("legs", legs)):
        answers[f"{name}: mass"] = np.array([[body.mass for body in bodies] for bodies in parts])
        answers[f"{name}: com"] = np.array([[body.com for body in bodies] for bodies in parts])
        answers[f"{name}: inertia"] = np.array([[body.inertia for body in bodies] for bodies in parts])
    return answers


@asks("Hexapod.from_chain")
def hexapod(t: Telling, c: Case) -> Answers:
    found = stp.Hexapod.from_chain(t.chain)
    back = t.world.inverse()
    return {
        "base": np.array([back * p for p in found.base_points])[t.order],
        "platform": found.platform_points[t.order],
    }


@asks("planar_rpr")
def planar_rpr(t: Telling, c: Case) -> Answers:
    found = stp.planar_rpr(t.chain)
    back = t.world.inverse()
    anchors = np.array([back * np.append(p, 0.0) for p in found.anchors])
    return {"anchors": anchors[t.order], "corners": found.corners[t.order]}


@asks("rotary_legs")
def rotary_legs(t: Telling, c: Case) -> Answers:
    found = stp.rotary_legs(t.chain)
    back = t.world.inverse()
    return {
        "base": np.array([back * p for p in found.base_points])[t.order],
        "axes": t.twists(found.axes)[t.order] * t.signs[:, None],
        "platform": found.platform_points[t.order],
        "cranks": found.cranks[t.order],
        "rods": found.rods[t.order],
    }


# --- kernels ---------------------------------------------------------------------------------------------------------


@asks("compile_kernels", kind="compiled")
def kernels_of_the_tree(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    many = stp.compile_kernels(t.chain, coordinates="tree", engine="numpy")
    answers = _moves(t, q, v, many.forward_dynamics(q[None], v[None], t.efforts(c.tau_motor)[None])[0])
    return answers | {"efforts": t.motors(many.inverse_dynamics(q[None], v[None], a[None])[0])}


@asks("compile_kernels", kind="compiled")
def kernels_of_motors(t: Telling, c: Case) -> Answers:
    chain = c.chain
    x, rates = stp.motor_positions(chain, c.near)[None], c.v[None, chain.motor_index]
    accelerations = c.a[None, chain.motor_index]
    many = stp.compile_kernels(t.chain, coordinates="motor", engine="numpy")
    state = t.readings(x), t.efforts(rates)
    tau = many.inverse_dynamics(*state, t.efforts(accelerations))
    return {
        "efforts": t.motors(tau),
        "accelerations": t.motors(many.forward_dynamics(*state, t.efforts(c.tau_motor[None]))),
    }


@asks("compile_kernels", kind="compiled")
def kernel_derivatives(t: Telling, c: Case) -> Answers:
    if c.chain.nv > 12:
        return {}  # long programs
    x, index = stp.motor_positions(c.chain, c.near)[None], c.chain.motor_index
    many = stp.compile_kernels(t.chain, coordinates="motor", engine="numpy")
    state = t.readings(x), t.efforts(c.v[None, index]), t.efforts(c.a[None, index])
    found = many.inverse_dynamics_derivatives(*state)
    names = ("position", "rate", "acceleration")
    return {name: t.motors(t.motors(d[0], axis=0)) for name, d in zip(names, found, strict=True)}


@asks("compile_kernels", "Kernels", kind="compiled")
def kernels_of_the_platform(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.near, _keeps(c, c.near))
    told = t.chain.at(q, v)
    pose, twist = _xyzquat(t, c.near, c), told.twist[None]
    acceleration = (told.P @ stp.motion_map(told).gamma + told.platform_bias)[None]
    many = stp.compile_kernels(t.chain, coordinates="platform", engine="numpy")
    readings = t.readings(stp.motor_positions(c.chain, c.near))[None]
    home = _xyzquat(t, c.chain.q_home, c)
    return {
        "efforts": t.motors(many.inverse_dynamics(pose, twist, acceleration)),
        "acceleration": t.twists(many.forward_dynamics(pose, twist, t.efforts(c.tau_motor[None]))),
        "motors": t.positions(many.inverse_kinematics(pose)),
        "rates": t.motors(many.motor_jacobian(pose)[0] @ twist[0]),
        "pose": t.pose(pin.XYZQUATToSE3(many.forward_kinematics(readings, home)[0])),
    }


def _xyzquat(t: Telling, q: np.ndarray, c: Case) -> np.ndarray:
    return np.asarray(pin.SE3ToXYZQUAT(_pose(t, c, q)))[None]


# --- other chains of a chain, files -------------------------------------------------------------------------------


def _holds(t: Telling, c: Case, other: stp.ClosedChain, note: str) -> Answers:
    """Ask what a chain that was made of a told one needs to hold still: the efforts of all its masses."""
    q = stp.close_loops(other, t.state(c.near)[0]).q
    rest = np.zeros(other.nv)
    return {note: Sized(t.motors(stp.inverse_dynamics(other, q, rest, rest).tau_motor), c.effort)}


@asks("attach_payload", "massless_legs", "replace_inertias", "with_motors", "with_platform")
def other_chains(t: Telling, c: Case) -> Answers:
    mass = sum(body.mass for body in c.chain.model.inertias)
    L = c.chain.length_scale
    box = pin.Inertia(mass, L * np.array([0.1, 0.2, 0.05]), 0.01 * mass * L**2 * np.eye(3))
    answers = _holds(t, c, stp.attach_payload(t.chain, box), "payload")
    reversed_motors = stp.with_motors(t.chain, t.chain.motors[::-1])
    q = t.state(c.near)[0]
    answers["motors"] = t.positions(stp.motor_positions(reversed_motors, q)[::-1])
    place = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), L * np.array([0.1, 0, 0.2]))
    other = stp.with_platform(t.chain, t.chain.platform, placement=place, name="tip")
    return answers | {"tip": t.pose(stp.platform_pose(other, t.state(c.near)[0]))}


@asks("massless_legs")
def massless_legs(t: Telling, c: Case) -> Answers:
    answers: Answers = {}
    for point in (False, True):
        other = stp.massless_legs(t.chain, point_platform=point)
        answers |= _holds(t, c, other, f"point {point}")
    return answers


@asks("replace_inertias")
def replace_inertias(t: Telling, c: Case) -> Answers:
    # The platform's frame is told as it is.
    body = t.chain.mechanism.link(t.chain.platform).inertia
    if body is None:
        return {}
    heavy = pin.Inertia(2 * body.mass, body.lever, 2 * body.inertia)
    return _holds(t, c, stp.replace_inertias(t.chain, {t.chain.platform: heavy}), "heavy")


@asks("lock_joints")
def lock_joints(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    name = c.chain.motors[0]
    locked = stp.lock_joints(t.chain, [name], t.state(c.near)[0])
    rest = np.zeros(locked.nv)
    if not locked.nu:
        return {"dof": stp.mobility(locked).dof}
    tau = stp.inverse_dynamics(locked, locked.q_home, rest, rest).tau_motor
    by_name = dict(zip(locked.motors, tau, strict=True))
    left = [(k, motor) for k, motor in enumerate(c.chain.motors) if motor != name]
    return {"efforts": Sized(np.array([t.signs[k] * by_name[motor] for k, motor in left]), c.effort)}


@asks("loops_by_balls")
def loops_by_balls(t: Telling, c: Case) -> Answers:
    return _holds(t, c, stp.loops_by_balls(t.chain), "balls")


@asks("on_floating_base")
def on_floating_base(t: Telling, c: Case) -> Answers:
    mass, L = sum(body.mass for body in c.chain.model.inertias), c.chain.length_scale
    if t.chain.mechanism.root != c.chain.mechanism.root:
        return {}  # what is given to the ground link comes on top of what the base weighs
    # A ball about the origin of the plain world; the base's frame is the told one.
    base = pin.Inertia(mass, np.zeros(3), mass * L**2 * np.eye(3)).se3Action(t.world)
    free = stp.on_floating_base(t.chain, base)
    q = np.concatenate([free.q_home[:7], t.state(c.near)[0]])
    v = np.zeros(free.nv)
    a = stp.forward_dynamics(free, q, v, t.efforts(c.tau_motor)).a[6:]
    return {"motors": t.motors(a[t.chain.motor_index])}


@asks("write_urdf", "export")
def export(t: Telling, c: Case) -> Answers:
    answers: Answers = {}
    with TemporaryDirectory() as folder:
        for format in ("urdf+", "drake", "isaac", "gepetto", "mjcf"):
            path = Path(folder) / f"again.{'xml' if format == 'mjcf' else 'urdf'}"
            try:
                stp.export(t.chain, path, format=format)
            except stp.errors.UnsupportedError:
                continue  # the told one may have other loops
            again = stp.load(path)
            assert again.motors == t.chain.motors
            answers |= _holds(t, c, again, format)
    return answers


QUESTIONS: dict[str, Verb] = {name: verb for table in VERBS.values() for name, verb in table.items()}
"""Every question by its name."""
