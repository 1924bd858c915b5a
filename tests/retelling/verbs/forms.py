"""Capability, and geometry for closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, Sized, asks


@asks("velocity_polytope", "wrench_polytope", kind="slow")
def polytopes(t: Telling, c: Case) -> Answers:
    if not t.same_size:
        return {}
    q, rng, L = t.state(c.near)[0], np.random.default_rng(5), c.chain.length_scale
    answers: Answers = {}
    moves = c.chain.at(c.near).P @ stp.dynamics.motion_map(c.chain, c.near).G
    limit = t.sizes(1.0 + 0.2 * np.arange(c.chain.nu))
    for name, found in (
        ("velocity", stp.polytopes.velocity_polytope(t.chain, q, rate_limit=limit)),
        ("wrench", stp.polytopes.wrench_polytope(t.chain, q, effort_limit=c.effort * limit, gravity=True)),
    ):
        answers[f"{name} ball"] = stp.polytopes.inscribed_ball(found).radius
        if found.vertices.shape[1] == 6:
            along = moves @ rng.normal(size=(c.chain.nu, 4))
            along = along / np.where(np.arange(6) < 3, L, 1.0)[:, None]
            answers[name] = np.array([stp.polytopes.polytope_support(found, t.turned(x)) for x in along.T])
    return answers


@asks("wrench_closure", "wrench_feasible", "wrench_path", "WrenchClosure", "WrenchFeasibility", "WrenchPath")
def wrenches_of_motors(t: Telling, c: Case) -> Answers:
    """Motors that give half of what they hold and up, each to its own side, whichever side the telling counts."""
    if not t.same_size:
        return {}
    q = t.state(c.near)[0]
    rest = np.zeros(c.chain.nv)
    held = stp.inverse_dynamics(c.chain, c.near, rest, rest, throw=False).tau_motor
    size = np.abs(held) + c.effort / c.chain.tangent_scale[c.chain.motor_index]
    ends = np.sort([t.efforts(held - size), t.efforts(held + size)], axis=0).T
    both = stp.polytopes.wrench_closure(t.chain, q, effort_limit=ends)
    state = t.chain.at(q, np.zeros(t.chain.nv), np.zeros(t.chain.nv))
    found = stp.polytopes.wrench_feasible(state, wrenches=np.zeros(6), effort_limit=ends)
    path = stp.polytopes.wrench_path([state], wrenches=np.zeros(6), effort_limit=ends)
    return {
        "closure": both.holds,
        "feasible": found.holds and path.holds,
        "margin": Sized(found.margin, c.effort),
    }


@asks("assembly_modes", kind="slow")
def assembly_modes(t: Telling, c: Case) -> Answers:
    readings = t.readings(stp.motor_positions(c.chain, c.near))
    found = stp.assembly_modes(t.chain, readings, engine="numpy")
    poses = [t.pose(pin.SE3(R, p)) for R, p in zip(found.rotation, found.position, strict=True)]
    answers: Answers = {"poses": np.array(sorted(poses, key=lambda pose: tuple(pose.ravel().round(4))))}
    # Points that lie in one plane to few digits only have more complex poses.
    return answers | ({"complex": found.n_complex} if t.exact else {})


@asks("sample_workspace", kind="slow")
def sample_workspace(t: Telling, c: Case) -> Answers:
    """Ask it in a world that stands as before: the grid goes along its axes."""
    if (t.world.rotation != np.eye(3)).any():
        return {}
    if not t.exact and c.chain.generic.count.platform < 6:
        return {}  # by its digits such a platform turns a little as it shifts: a workspace without turning is refused
    rotation = stp.platform_pose(c.chain, c.chain.q_home).rotation
    found = stp.workspaces.sample_workspace(t.chain, rotation, spacing=c.chain.length_scale)
    answers: Answers = {"length": found.length, "clearance": found.clearance.max(initial=0.0)}
    if t.exact:  # few digits put points on either side of a boundary
        answers |= {"volume": found.volume, "pieces": found.pieces, "points": len(found.position)}
    return answers | {"best": found.dexterity.max(initial=0.0)}


@asks("hexapod_bodies")
def hexapod_bodies(t: Telling, c: Case) -> Answers:
    found = stp.hexapods.hexapod_bodies(t.chain)
    answers: Answers = {"joint": found.lower_joint == "universal"}
    lower, upper = (part if isinstance(part, tuple) else (part,) * 6 for part in (found.lower, found.upper))
    # An axis has two senses: what is measured along x and y of a leg changes sign with it.
    axes = t.twists(found.first_axes)[t.order]
    plain = np.asarray(stp.hexapods.hexapod_bodies(c.chain).first_axes)
    senses = np.sign(np.einsum("ij,ij->i", axes, plain))
    answers["first axes"] = senses[:, None] * axes
    legs = [(lower[k], upper[k]) for k in t.order]
    for name, parts, turns in (("platform", [(found.platform,)], [1.0]), ("legs", legs, senses)):
        turned = [np.diag([sense, sense, 1.0]) for sense in turns]
        pairs = list(zip(parts, turned, strict=True))
        answers[f"{name}: mass"] = np.array([[body.mass for body in bodies] for bodies, _ in pairs])
        answers[f"{name}: com"] = np.array([[R @ body.com for body in bodies] for bodies, R in pairs])
        answers[f"{name}: inertia"] = np.array(
            [[R @ body.inertia @ R for body in bodies] for bodies, R in pairs]
        )
    return answers


@asks("closed_forms")
def closed_forms(t: Telling, c: Case) -> Answers:
    """Few digits bend the axes of legs by more than a closed form may differ; what it differs by is the digits'.

    Rods that few digits leave round no more have a spin of their own, and no closed form on balls. By how much one
    differs that does not stand for the chain hangs on the states at which it was tried.
    """
    found = stp.dynamics.closed_forms(t.chain)
    admitted: Answers = {f"{form.form} admitted": form.admitted for form in found} if t.exact else {}
    told = [form for form in found if np.isfinite(form.miss) and (form.admitted or not t.exact)]
    return admitted | {form.form: Sized(form.miss, 1.0) for form in told}


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
    found = stp.planar.planar_rpr(t.chain)
    plane, back = pin.SE3(np.asarray(found.plane)), t.world.inverse()
    anchors = np.array([back * (plane * np.append(p, 0.0)) for p in found.anchors])
    corners = np.array([found.turned @ np.append(p, 0.0) for p in found.corners])
    sign, offset = t.chain.leg_readings
    home = offset + sign * t.state(c.near)[0][t.chain.motor_q_index]
    return {"anchors": anchors[t.order], "corners": corners[t.order], "lengths": home[t.order]}


@asks("rotary_legs")
def rotary_legs(t: Telling, c: Case) -> Answers:
    found = stp.rotary.rotary_legs(t.chain)
    back = t.world.inverse()
    return {
        "base": np.array([back * p for p in found.base_points])[t.order],
        "axes": t.twists(found.axes)[t.order] * t.signs[:, None],
        "platform": found.platform_points[t.order],
        "cranks": found.cranks[t.order],
        "rods": found.rods[t.order],
    }
