"""Actuators of MuJoCo's compiled model as motors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stewart_pin.model.description import Joint, Note, Span
from stewart_pin.model.formats.mjcf.compiling import given_names, import_mujoco
from stewart_pin.model.formats.mjcf.tree import MUJOCO_FAR, Tree

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
