"""Chains whose joints all have a rotor, damping, dry friction, a spring and a constant force, as large as inertia."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.model.description import JointKind, physics_coordinates
from tests.closed_states import robot


@cache
def physical(name: str, *, friction: bool = True, anywhere: bool = False) -> stp.ClosedChain:
    """Give every joint of a robot or kind of closure physics of its own, drawn with a fixed seed."""
    return with_own_physics(robot(name), friction=friction, anywhere=anywhere)


def with_own_physics(
    chain: stp.ClosedChain, *, friction: bool = True, anywhere: bool = False
) -> stp.ClosedChain:
    """Give every joint of a chain physics of its own.

    With `anywhere` only what does not depend on how the chain is told: a loop has it as well, motors keep rotors, and
    floating joints, whose damping is one number for metres and radians, have none.
    """
    rng, told = np.random.default_rng(3), {}
    inertia = pin.crba(chain.model, pin.Data(chain.model), chain.q_home).diagonal() / chain.tangent_scale**2
    usual = float(np.median(inertia[inertia > 0]))

    def own(*without: str, length: float = 1.0) -> dict[str, Any]:
        # Efforts of one usual inertia per s², by lengths in robot sizes.
        size = usual / length
        draw = lambda: float(rng.uniform(0.3, 1.0))  # noqa: E731
        all_of_it = {
            "armature": 0.3 * draw() * size / length,
            "damping": draw() * size / length,
            "friction": friction * draw() * size,
            "stiffness": tuple(k * draw() * size / length ** (n + 1) for n, k in enumerate((5.0, 2.0, 3.0))),
            "rest": 0.2 * rng.normal() * length,
            "force": rng.normal() * size,
        }
        return {key: value for key, value in all_of_it.items() if key not in without}

    for joint in chain.mechanism.joints:
        match joint.kind:
            case JointKind.FIXED:
                pass
            case JointKind.FLOATING if anywhere:
                pass
            case JointKind.FLOATING:
                told[joint.name] = own("armature", "stiffness", "rest", "force", length=chain.length_scale)
            case JointKind.SPHERICAL:
                ball = own("rest", "force", *(("armature", "friction") if anywhere else ()))
                told[joint.name] = ball | {"stiffness": ball["stiffness"][0]}
            case _:
                sliding = joint.kind is JointKind.PRISMATIC
                without = ("armature",) if anywhere and joint.name not in chain.motors else ()
                told[joint.name] = own(*without, length=chain.length_scale if sliding else 1.0)
    for loop in chain.loops:
        words = physics_coordinates(loop.kind)
        for word in words:
            acts = own("armature", length=chain.length_scale if word in ("x", "y", "length") else 1.0)
            if word == "turn":
                acts = {"damping": acts["damping"], "stiffness": acts["stiffness"][0]}
            told[loop.name if len(words) == 1 else f"{loop.name} {word}"] = acts
    return stp.with_joint_physics(chain, told)
