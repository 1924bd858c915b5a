"""Freedoms and singularities."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, asks


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
    counts = stp.loops.generic_freedom(t.chain)
    found = stp.singularities.classify_singularity(t.chain, t.state(c.q)[0])
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
    path = stp.loops.closed_path(t.chain, stops)
    found = stp.singularities.find_singularity(t.chain, path, kinds=["motor"], samples=9)
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
    found = stp.singularities.singularity_map(
        t.chain, at[0] + np.linspace(-0.05, 0.05, 4), at[1] + np.linspace(-0.05, 0.05, 3), axes=("vx", "vy")
    )
    return {str(kind): found.measures[kind] for kind in ("motor", "platform")}
