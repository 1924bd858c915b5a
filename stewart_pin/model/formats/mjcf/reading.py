"""MJCF, the native format of MuJoCo, read through MuJoCo's own compiler (extra ``mjcf``).

The tree, its loops and couplings, the motors, what joints do by themselves and the home configuration are those of the
compiled model: defaults, units, frames and inertias from shapes mean what they mean in MuJoCo. Constraints become
rigid. The world is the ground; bodies on free joints hang on it by floating joints. What the model holds besides the
mechanism is noted.

References
----------
.. [1] MuJoCo documentation, "XML reference" and "Modeling: kinematic tree".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Joint, Mechanism, Note, Outcome, Span
from stewart_pin.model.formats.mjcf.compiling import (
    HOME,
    PLATFORM,
    SPEED,
    SPRING,
    compile_mjcf,
    given_names,
    import_mujoco,
)
from stewart_pin.model.formats.mjcf.loops import read_ties
from stewart_pin.model.formats.mjcf.physics import read_physics
from stewart_pin.model.formats.mjcf.tree import MUJOCO_FAR, Tree, read_tree
from stewart_pin.model.formats.words import meant_word
from stewart_pin.model.formats.xml import UNLIMITED

# ----------------------------------------------------------------------------------------------------
# What MuJoCo's model holds besides the mechanism: named aloud, with its value where it would act on the motion
# ----------------------------------------------------------------------------------------------------


_DEFORMABLE = "left out: a deformable body that hangs on no link meets the mechanism by contacts alone"
_FORCE = "left out, as a mechanism has no forces but those of gravity, inertia, motors and its joints"


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
        Bodies first, then tendons, contacts and the medium.
    """
    return (
        *_of_bodies(model, tree),
        *_of_tendons(model),
        *_of_the_world(model),
    )


def _of_bodies(model: Any, tree: Tree) -> Iterable[Note]:
    for k, name in enumerate(tree.bodies):
        if model.body_gravcomp[k]:
            yield Note(f"body '{name}'", f"gravcomp {float(model.body_gravcomp[k]):g}: {_FORCE}")
    if model.nplugin:
        yield Note("<plugin>", f"{model.nplugin} plugins: {_FORCE}")


def _of_tendons(model: Any) -> Iterable[Note]:
    for k, given in enumerate(given_names(model, "tendon", model.ntendon)):
        owner = f"tendon '{given or k + 1}'"
        if model.tendon_limited[k]:
            yield Note(
                owner, f"range {_shown(model.tendon_range[k])}: a tendon that may go slack holds nothing"
            )
        if model.tendon_actfrclimited[k]:
            yield Note(owner, "actuatorfrcrange: actuators of tendons are no motors")


def _of_custom(strangers: Sequence[str]) -> Iterable[Note]:
    """Tell names that look like ours; others are for programs of their own."""
    for name in strangers:
        word = name.partition(":")[0] + (":" if ":" in name else "")
        meant = meant_word(word, (PLATFORM, HOME, SPEED, SPRING))
        if meant:
            takes = "two numbers or more" if word == SPRING else "one number or two"
            text = f"unknown; it takes {takes}" if word == meant else f"unknown, is '{meant}' meant?"
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
    "geom_pos", "geom_quat", "dof_armature", "dof_damping", "dof_frictionloss", "jnt_stiffness", "jnt_stiffnesspoly",
    "qpos_spring", "tendon_armature", "tendon_damping", "tendon_frictionloss", "tendon_stiffness",
    "tendon_stiffnesspoly", "tendon_lengthspring", "actuator_armature", "actuator_damping",
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
    joints, lost = read_physics(model, tree, asides.springs)
    tree = replace(tree, joints=joints)
    drive = read_motors(model, tree)
    off = import_mujoco().mjtDisableBit.mjDSBL_GRAVITY
    x, y, z = (0.0 if model.opt.disableflags & off else float(value) for value in model.opt.gravity)
    said = [Note("MuJoCo", f"warns: {text}") for text in warned]
    said += [Note(f"flexcomp '{name}'", _DEFORMABLE) for name in asides.deformable]
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
            *lost,
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


# ----------------------------------------------------------------------------------------------------
# Actuators of MuJoCo's compiled model as motors
# ----------------------------------------------------------------------------------------------------

_NONE: Span = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class Drive:
    """Joints with their motors.

    Attributes
    ----------
    joints
        All joints of the tree; the motors stand in the order of the actuators.
    notes
        What was made of the actuators.
    hints
        Joints that actuators pull at by tendons.
    """

    joints: tuple[Joint, ...]
    notes: tuple[Note, ...]
    hints: tuple[str, ...] = ()


def read_motors(model: Any, tree: Tree) -> Drive:
    """Mark the joints that actuators drive.

    An actuator of a hinge or a slide makes it a motor, whatever signal it follows: the coordinates, efforts and
    rates of motors are those of the joint, with the gear taken out. Its largest effort is what force range, control
    range and the joint's ``actuatorfrcrange`` leave of it.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    tree
        Its links and joints.

    Returns
    -------
    Drive
        Joints, motors marked.
    """
    return _MotorReader(model, tree).read()


class _MotorReader:
    def __init__(self, model: Any, tree: Tree) -> None:
        self.model, self.tree = model, tree
        self.mujoco = import_mujoco()
        given = given_names(model, "actuator", model.nu)
        self.names = [name or f"number {k + 1}" for k, name in enumerate(given)]
        self.notes: list[Note] = []
        self.hints: dict[str, None] = {}

    def read(self) -> Drive:
        efforts: dict[str, Span] = {}
        for k in range(self.model.nu):
            joint = self._driven(k)
            if joint is not None:
                before, more = efforts.get(joint, (0.0, 0.0)), self._effort(k)
                efforts[joint] = before[0] + more[0], before[1] + more[1]
        joints = {joint.name: joint for joint in self.tree.joints}
        for number, name in enumerate(self.tree.joint_names):
            if joints[name].has_axis:
                least, most = _clamped(efforts.get(name, _NONE), self._joint_effort(number))
                effort = most if least == -most else (least, most)
                joints[name] = replace(joints[name], effort=effort, independent=name in efforts)
        motors = iter([joints[name] for name in efforts])
        ordered = tuple(next(motors) if joint.name in efforts else joint for joint in joints.values())
        return Drive(ordered, tuple(self.notes), tuple(self.hints))

    def _driven(self, k: int) -> str | None:
        """Find the joint that an actuator drives; None, with a note: it is no motor."""
        if self._is_off(k):
            self._note(k, "the file disables it: no motor")
            return None
        transmissions = self.mujoco.mjtTrn
        kind = transmissions(int(self.model.actuator_trntype[k]))
        if kind not in (transmissions.mjTRN_JOINT, transmissions.mjTRN_JOINTINPARENT):
            what = kind.name.removeprefix("mjTRN_").lower()
            self._note(k, f"acts on a {what}, not on a joint: no motor")
            if kind == transmissions.mjTRN_TENDON:
                self.hints |= dict.fromkeys(self._pulled(int(self.model.actuator_trnid[k][0])))
            return None
        name = self.tree.joint_names[int(self.model.actuator_trnid[k][0])]
        if not next(joint for joint in self.tree.joints if joint.name == name).has_axis:
            self._note(k, f"acts on joint '{name}', which has not one freedom: no motor")
            return None
        if self.model.actuator_gear[k][0] == 0:
            self._note(k, f"gear 0: it does not reach joint '{name}'")
            return None
        if self._is_brake(k):
            self._note(k, f"a brake on joint '{name}': no motor")
            return None
        if not self._is_plain(k):
            text = "its gains and dynamics: here a motor gives the effort that it is told to give"
            self._note(k, text)
        return name

    def _pulled(self, tendon: int) -> list[str]:
        """Joints of one freedom that a fixed tendon combines."""
        model, start = self.model, int(self.model.tendon_adr[tendon])
        joints = {joint.name: joint for joint in self.tree.joints}
        names = [
            self.tree.joint_names[int(model.wrap_objid[k])]
            for k in range(start, start + int(model.tendon_num[tendon]))
            if int(model.wrap_type[k]) == int(self.mujoco.mjtWrap.mjWRAP_JOINT)
        ]
        return [name for name in names if joints[name].has_axis]

    def _is_off(self, k: int) -> bool:
        group, option = int(self.model.actuator_group[k]), self.model.opt
        disabled = group >= 0 and option.disableactuator >> group & 1
        return bool(disabled or option.disableflags & self.mujoco.mjtDisableBit.mjDSBL_ACTUATION)

    def _is_plain(self, k: int) -> bool:
        gains, biases, dynamics = self.mujoco.mjtGain, self.mujoco.mjtBias, self.mujoco.mjtDyn
        return (
            self.model.actuator_gaintype[k] == gains.mjGAIN_FIXED
            and self.model.actuator_biastype[k] == biases.mjBIAS_NONE
            and self.model.actuator_dyntype[k] == dynamics.mjDYN_NONE
        )

    def _is_brake(self, k: int) -> bool:
        """Tell a <damper>, which only resists a motion."""
        gain = self.model.actuator_gainprm[k]
        return bool(
            self.model.actuator_gaintype[k] == self.mujoco.mjtGain.mjGAIN_AFFINE
            and self.model.actuator_biastype[k] == self.mujoco.mjtBias.mjBIAS_NONE
            and gain[0] == 0
            and gain[1] == 0
        )

    def _effort(self, k: int) -> Span:
        """Return the least and the greatest effort that an actuator exerts on its joint [N or N m]."""
        model, gear = self.model, float(self.model.actuator_gear[k][0])
        effort = _NONE
        if model.actuator_forcelimited[k]:
            effort = _span(model.actuator_forcerange[k])
        clamp_off = model.opt.disableflags & self.mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
        if model.actuator_ctrllimited[k] and self._is_plain(k) and not clamp_off:
            gain = float(model.actuator_gainprm[k][0])
            effort = _clamped(_times(gain, _span(model.actuator_ctrlrange[k])), effort)
        return _times(gear, effort)

    def _joint_effort(self, number: int) -> Span:
        return _span(self.model.jnt_actfrcrange[number]) if self.model.jnt_actfrclimited[number] else _NONE

    def _note(self, k: int, text: str) -> None:
        self.notes.append(Note(f"actuator '{self.names[k]}'", text))


def _span(limits: Any) -> Span:
    least, most = (float(value) for value in limits)
    return -np.inf if least <= -MUJOCO_FAR else least, np.inf if most >= MUJOCO_FAR else most


def _clamped(span: Span, by: Span) -> Span:
    """Clamp the values of a range, as MuJoCo does."""
    least, most = (min(max(end, by[0]), by[1]) for end in span)
    return least, most


def _times(factor: float, span: Span) -> Span:
    ends = sorted(factor * end if factor else 0.0 for end in span)
    return ends[0], ends[1]
