"""Capability, and geometry for closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, asks


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
    found = stp.hexapods.hexapod_bodies(t.chain)
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
    found = stp.planar.planar_rpr(t.chain)
    back = t.world.inverse()
    anchors = np.array([back * np.append(p, 0.0) for p in found.anchors])
    return {"anchors": anchors[t.order], "corners": found.corners[t.order]}


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
