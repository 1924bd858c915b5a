"""A mechanism with every kind of tree joint, and loops of every kind between two of its links."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism


def _unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def _placement(rng: np.random.Generator) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))


def _inertia(rng: np.random.Generator) -> pin.Inertia:
    """Inertia of point masses, so that it is physical."""
    points = rng.normal(0, 0.3, (6, 3))
    com = points.mean(axis=0)
    arms = points - com
    moment = sum((x @ x) * np.eye(3) - np.outer(x, x) for x in arms)
    return pin.Inertia(6.0, com, moment)


def joint_zoo(rng: np.random.Generator) -> Mechanism:
    """Two branches: revolute, prismatic, fixed, spherical; and floating, revolute, prismatic; skew axes."""
    branches = {
        "a": (JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.FIXED, JointKind.SPHERICAL),
        "b": (JointKind.FLOATING, JointKind.REVOLUTE, JointKind.PRISMATIC),
    }
    links, joints = [Link("base")], []
    for branch, kinds in branches.items():
        parent = "base"
        for k, kind in enumerate(kinds):
            name = f"{branch}{k}"
            links.append(Link(name, _inertia(rng)))
            axis = _unit(rng) if k else np.array([0.0, 1.0, 0.0])
            joint = Joint(
                f"joint_{name}", kind, parent, name, _placement(rng), axis,
                independent=kind in (JointKind.REVOLUTE, JointKind.PRISMATIC),
            )  # fmt: skip
            joints.append(joint)
            parent = name
    return Mechanism("zoo", tuple(links), tuple(joints), platform="b2")


def allowed_motion(loop_kind: JointKind, axis, axis2, length: float, rng: np.random.Generator) -> pin.SE3:
    """Draw a relative placement 1M2 that the closure of a loop allows."""
    turn, slide = rng.normal(size=2)
    anywhere = pin.exp3(rng.normal(size=3))
    about, still, here = pin.exp3(turn * axis), np.eye(3), np.zeros(3)
    sideways = np.cross(axis, _unit(rng))
    match loop_kind:
        case JointKind.FIXED:
            return pin.SE3(still, here)
        case JointKind.REVOLUTE:
            return pin.SE3(about, here)
        case JointKind.PRISMATIC:
            return pin.SE3(still, slide * axis)
        case JointKind.SPHERICAL:
            return pin.SE3(anywhere, here)
        case JointKind.UNIVERSAL:
            return pin.SE3(about @ pin.exp3(slide * axis2), here)
        case JointKind.CYLINDRICAL:
            return pin.SE3(about, slide * axis)
        case JointKind.PLANAR:
            return pin.SE3(about, slide * sideways)
        case JointKind.POINT_ON_LINE:
            return pin.SE3(anywhere, slide * axis)
        case JointKind.DISTANCE | JointKind.CABLE:
            return pin.SE3(anywhere, length * _unit(rng))
    raise ValueError(loop_kind)


def close(
    mechanism: Mechanism, model: pin.Model, q: np.ndarray, kind: JointKind, rng: np.random.Generator
) -> Loop:
    """Make a loop of a kind between the ends of the two branches that is closed at q."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    end1, end2 = (data.oMf[model.getFrameId(link)] for link in ("a3", "b2"))
    axis = _unit(rng)
    axis2 = np.cross(axis, _unit(rng))
    axis2 /= np.linalg.norm(axis2)
    length = 0.7
    placement1 = _placement(rng)
    relative = allowed_motion(kind, axis, axis2, length, rng)
    placement2 = end2.inverse() * end1 * placement1 * relative
    return Loop(f"{kind}", kind, "a3", "b2", placement1, placement2, axis, axis2, length)
