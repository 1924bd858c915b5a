"""MJCF, the native format of MuJoCo, read through MuJoCo's own compiler (extra ``mjcf``).

The tree, its loops and couplings, the motors and the home configuration are those of the compiled model: defaults,
units, frames and inertias from shapes mean what they mean in MuJoCo. Constraints become rigid. The world is the
ground; bodies on free joints hang on it by floating joints. What the model holds besides the mechanism is noted.

References
----------
.. [1] MuJoCo documentation, "XML reference" and "Modeling: kinematic tree".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Mechanism, Note, Outcome
from stewart_pin.model.formats.mjcf.compiling import (
    HOME,
    PLATFORM,
    SPEED,
    compile_mjcf,
    given_names,
    import_mujoco,
)
from stewart_pin.model.formats.mjcf.loops import read_ties
from stewart_pin.model.formats.mjcf.motors import read_motors
from stewart_pin.model.formats.mjcf.tree import Tree, read_tree
from stewart_pin.model.formats.words import meant_word
from stewart_pin.model.formats.xml import UNLIMITED

# ----------------------------------------------------------------------------------------------------
# What MuJoCo's model holds besides the mechanism: named aloud, with its value where it would act on the motion
# ----------------------------------------------------------------------------------------------------


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


def _of_custom(strangers: Sequence[str]) -> Iterable[Note]:
    """Tell names that look like ours; others are for programs of their own."""
    for name in strangers:
        word = name.partition(":")[0] + (":" if ":" in name else "")
        meant = meant_word(word, (PLATFORM, HOME, SPEED))
        if meant:
            text = "unknown; it takes one number or two" if word == meant else f"unknown, is '{meant}' meant?"
            yield Note("<custom>", f"the name '{name}': {text}")


def _of_the_world(model: Any) -> Iterable[Note]:
    if np.any(np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)):
        yield Note("<geom>", "shapes give bodies their inertia where the file says so; there are no contacts")
    if model.nsite:
        yield Note(
            "<site>",
            "a site counts where a loop or a tendon of the mechanism names it; the others are left out",
        )
    for tag, number in (("<sensor>", model.nsensor), ("<light>", model.nlight), ("<camera>", model.ncam)):
        if number:
            yield Note(tag, f"{number} of them: left out, as they move nothing")
    medium = (model.opt.density, model.opt.viscosity)
    if np.any(medium):
        wind = f", wind {_shown(model.opt.wind)}" if np.any(model.opt.wind) else ""
        yield Note("<option>", f"density {medium[0]:g}, viscosity {medium[1]:g}{wind}: {_FORCE}")


def _shown(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):g}" for value in values)


# ----------------------------------------------------------------------------------------------------

_USED = (
    "body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "jnt_pos", "jnt_axis", "jnt_range",
    "site_pos", "site_quat", "eq_data", "qpos0", "key_qpos", "key_mpos", "key_mquat", "tendon_length0", "wrap_prm",
    "actuator_gear", "actuator_gainprm", "actuator_forcerange", "actuator_ctrlrange", "jnt_actfrcrange",
    "geom_pos", "geom_quat",
)  # fmt: skip
"""Arrays of the compiled model that the mechanism is made of."""


def read_mjcf(path: Path) -> Mechanism:
    """Read an MJCF file.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    Mechanism
        Description, not yet validated. Home is the keyframe ``home``, or else the first, or else the configuration
        in which the file draws the bodies; the platform is the body or the site that ``<text name="platform">`` of
        ``<custom>`` names, or else the one called ``platform``.

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.
    FileFormatError
        If MuJoCo refuses the file, or it holds what has no counterpart.
    """
    model, asides, warned = compile_mjcf(path)
    _require_numbers(model, str(path))
    key, key_notes = _home_key(model)
    tree = read_tree(model, asides, key=key, source=str(path))
    ties = read_ties(model, tree, source=str(path))
    drive = read_motors(model, tree)
    off = import_mujoco().mjtDisableBit.mjDSBL_GRAVITY
    x, y, z = (0.0 if model.opt.disableflags & off else float(value) for value in model.opt.gravity)
    said = [Note("MuJoCo", f"warns: {text}") for text in warned]
    name = str(model.names[: model.names.index(b"\0")].decode("utf-8", "replace"))
    return Mechanism(
        name=name if name not in ("", "MuJoCo Model") else path.stem,
        links=tree.links,
        joints=drive.joints,
        motor_hints=drive.hints,
        loops=ties.loops,
        couplings=ties.couplings,
        platform=tree.platform,
        home=tree.home,
        home_is_guess=not asides.assembled,
        source=str(path),
        notes=(
            *said,
            *tree.notes,
            *ties.notes,
            *drive.notes,
            *key_notes,
            *left_out(model, tree),
            *_of_custom(asides.strangers),
        ),
        gravity=(x, y, z),
        assembled=asides.assembled,
    )


def _require_numbers(model: Any, source: str) -> None:
    for array in _USED:
        if not (np.abs(np.asarray(getattr(model, array))) <= UNLIMITED).all():
            raise FileFormatError(
                f"the compiled model holds numbers in '{array}' that are not finite, or beyond {UNLIMITED:g}; "
                "correct the numbers of the file",
                path=source,
                culprit=array,
            )


def _home_key(model: Any) -> tuple[int | None, list[Note]]:
    """Choose the keyframe that is home."""
    names = given_names(model, "key", model.nkey)
    if not names:
        return None, []
    chosen = names.index("home") if "home" in names else 0
    notes = [
        Note(f"keyframe '{name or k + 1}'", "only one keyframe is home")
        for k, name in enumerate(names)
        if k != chosen
    ]
    if names[chosen] != "home":
        text = "taken as home, as none is called 'home'"
        notes.insert(0, Note(f"keyframe '{names[chosen] or 1}'", text, Outcome.KEPT))
    return chosen, notes
