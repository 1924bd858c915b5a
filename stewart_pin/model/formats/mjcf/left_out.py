"""What MuJoCo's model holds besides the mechanism: named aloud, with its value where it would act on the motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from stewart_pin.model.description import Note
from stewart_pin.model.formats.mjcf.compiling import import_mujoco
from stewart_pin.model.formats.mjcf.names import given_names
from stewart_pin.model.formats.mjcf.tree import Tree

_FORCE = "left out, as a mechanism has no forces but those of gravity, inertia and motors"

_ROTOR = "left out, as rotors are no bodies; simulate takes it for motors, as Motors(inertia=...)"


def left_out(model: Any, tree: Tree) -> tuple[Note, ...]:
    """List what is left out.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    tree
        Its links and joints.

    Returns
    -------
    tuple of Note
        Joints first, then bodies, tendons, contacts and the medium.
    """
    return (
        *_of_joints(model, tree),
        *_of_bodies(model, tree),
        *_of_tendons(model),
        *_of_actuators(model),
        *_of_the_world(model),
    )


def _of_joints(model: Any, tree: Tree) -> Iterable[Note]:
    one_freedom = [
        int(kind) for kind in (import_mujoco().mjtJoint.mjJNT_HINGE, import_mujoco().mjtJoint.mjJNT_SLIDE)
    ]
    for k, name in enumerate(tree.joint_names):
        first, owner = int(model.jnt_dofadr[k]), f"joint '{name}'"
        armature = float(model.dof_armature[first])
        if armature:
            yield Note(owner, f"armature {armature:g}: {_ROTOR}")
        damping = [model.dof_damping[first], *model.dof_dampingpoly[first]]
        if np.any(damping):
            yield Note(owner, f"damping {_shown(damping)}: {_FORCE}")
        friction = float(model.dof_frictionloss[first])
        if friction:
            yield Note(owner, f"frictionloss {friction:g}: {_FORCE}")
        stiffness = [model.jnt_stiffness[k], *model.jnt_stiffnesspoly[k]]
        if np.any(stiffness):
            at = int(model.jnt_qposadr[k])
            about = f" about {float(model.qpos_spring[at]):g}" if model.jnt_type[k] in one_freedom else ""
            yield Note(owner, f"stiffness {_shown(stiffness)}{about}: {_FORCE}")


def _of_bodies(model: Any, tree: Tree) -> Iterable[Note]:
    for k, name in enumerate(tree.bodies):
        if model.body_gravcomp[k]:
            yield Note(f"body '{name}'", f"gravcomp {float(model.body_gravcomp[k]):g}: {_FORCE}")
    if model.nplugin:
        yield Note("<plugin>", f"{model.nplugin} plugins: {_FORCE}")


def _of_tendons(model: Any) -> Iterable[Note]:
    for k, given in enumerate(given_names(model, "tendon", model.ntendon)):
        owner = f"tendon '{given or k + 1}'"
        for attribute in ("armature", "damping", "frictionloss", "stiffness"):
            value = float(getattr(model, f"tendon_{attribute}")[k])
            if value:
                yield Note(owner, f"{attribute} {value:g}: {_FORCE}")
        if model.tendon_limited[k]:
            yield Note(
                owner, f"range {_shown(model.tendon_range[k])}: a tendon that may go slack holds nothing"
            )
        if model.tendon_actfrclimited[k]:
            yield Note(owner, "actuatorfrcrange: actuators of tendons are no motors")


def _of_actuators(model: Any) -> Iterable[Note]:
    for k, given in enumerate(given_names(model, "actuator", model.nu)):
        owner = f"actuator '{given or f'number {k + 1}'}'"
        armature, damping = float(model.actuator_armature[k]), float(model.actuator_damping[k])
        if armature:
            yield Note(owner, f"armature {armature:g}: {_ROTOR}")
        if damping:
            yield Note(owner, f"damping {damping:g}: {_FORCE}")


def _of_the_world(model: Any) -> Iterable[Note]:
    if np.any(np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)):
        yield Note("<geom>", "shapes give bodies their inertia where the file says so; there are no contacts")
    medium = (model.opt.density, model.opt.viscosity)
    if np.any(medium):
        wind = f", wind {_shown(model.opt.wind)}" if np.any(model.opt.wind) else ""
        yield Note("<option>", f"density {medium[0]:g}, viscosity {medium[1]:g}{wind}: {_FORCE}")


def _shown(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):g}" for value in values)
