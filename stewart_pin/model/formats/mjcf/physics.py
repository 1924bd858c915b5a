"""What joints do by themselves, in MuJoCo's words: rotors, damping, dry friction and springs.

A joint of the mechanism has all that acts along its coordinate alone: the joint's own words, those of fixed tendons
over no other joint, and rotors and damping of actuators, which count with the square of the gear, whether the file
lets the actuators act or not. Springs are polynomials about a rest in both, of degree three at most in MuJoCo; what is
beyond that, and constant forces, stand in ``<custom>``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lxml import etree
from numpy.polynomial import polynomial

from stewart_pin.model.description import (
    Joint,
    JointKind,
    Mechanism,
    Note,
    Outcome,
    physics_coordinates,
)
from stewart_pin.model.formats.mjcf.compiling import SPRING, given_names, import_mujoco
from stewart_pin.model.formats.mjcf.loops import moved_polynomial, sum_of_joints
from stewart_pin.model.formats.mjcf.tree import MUJOCO_FAR, Tree
from stewart_pin.model.formats.xml import number_text
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Reading
# ----------------------------------------------------------------------------------------------------

_SEVERAL = "left out, as it acts on several joints at once"
_ALONE = "left out, as damping of a joint is linear here"
_YIELDS = "left out, as springs do not yield here"


def read_physics(
    model: Any, tree: Tree, springs: Mapping[str, FloatArray]
) -> tuple[tuple[Joint, ...], tuple[Note, ...]]:
    """Give joints what they do by themselves.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    tree
        Its links and joints.
    springs
        Springs of joints that stand in ``<custom>``: rest, then the constant force and the coefficients of stiffness
        [m or rad, N or N m, and per power of the displacement]; they are added to MuJoCo's.

    Returns
    -------
    joints : tuple of Joint
        All joints of the tree.
    notes : tuple of Note
        What has no counterpart.
    """
    return _PhysicsReader(model, tree, springs).read()


@dataclass(frozen=True, eq=False)
class _Spring:
    """An effort by powers of the displacement from rest, the constant one first."""

    rest: float
    effort: FloatArray


class _PhysicsReader:
    def __init__(self, model: Any, tree: Tree, springs: Mapping[str, FloatArray]) -> None:
        self.model, self.tree = model, tree
        self.mujoco = import_mujoco()
        self.joints = {joint.name: joint for joint in tree.joints}
        self.told: dict[str, list[_Spring]] = {}
        self.found: dict[str, JointPhysics] = {}
        self.notes: list[Note] = []
        off, bits = model.opt.disableflags, self.mujoco.mjtDisableBit
        self.no_springs = bool(off & bits.mjDSBL_SPRING)
        self.no_damping = bool(off & bits.mjDSBL_DAMPER)
        self.no_friction = bool(off & (bits.mjDSBL_FRICTIONLOSS | bits.mjDSBL_CONSTRAINT))
        self.custom = springs

    def read(self) -> tuple[tuple[Joint, ...], tuple[Note, ...]]:
        for k, name in enumerate(self.tree.joint_names):
            self._joint(k, name)
        for k in range(self.model.ntendon):
            self._tendon(k)
        for k in range(self.model.nu):
            self._actuator(k)
        for name, numbers in self.custom.items():
            self._custom(name, numbers)
        for name, told in self.told.items():
            self.found[name] = _with_springs(self.found[name], told)
        joints = tuple(
            replace(joint, physics=self.found[joint.name]) if self.found.get(joint.name) else joint
            for joint in self.tree.joints
        )
        return joints, tuple(self.notes)

    def _add(self, name: str, armature: float, damping: float, friction: float = 0.0) -> None:
        own = self.found.get(name, NO_PHYSICS)
        self.found[name] = replace(
            own,
            armature=own.armature + armature,
            damping=own.damping + damping,
            friction=own.friction + friction,
        )

    def _joint(self, k: int, name: str) -> None:
        model, owner = self.model, f"joint '{name}'"
        first, kind = int(model.jnt_dofadr[k]), self.joints[name].kind
        armature, friction = float(model.dof_armature[first]), float(model.dof_frictionloss[first])
        damping = self._damping(owner, model.dof_damping[first], model.dof_dampingpoly[first])
        friction = self._friction(owner, friction)
        self._add(name, armature, damping, friction)
        if kind is JointKind.FLOATING and (armature or friction):
            text = f"{JointPhysics(armature, friction=friction)}: along its own axes, in MuJoCo along the world's"
            self.notes.append(Note(owner, text, Outcome.CHANGED))
        at = int(model.jnt_qposadr[k])
        stiffness = self._stiffness(owner, model.jnt_stiffness[k], model.jnt_stiffnesspoly[k])
        if stiffness is None:
            return
        self._note_yield(owner, model.jnt_springyield[k])
        if kind is JointKind.FLOATING:
            text = f"stiffness {_shown(stiffness)}: left out, as a floating body has no springs here"
            self.notes.append(Note(owner, text))
        elif kind is JointKind.SPHERICAL:
            # A ball's rest is no number: MuJoCo's is always the configuration of the file, where the ball is at zero.
            if stiffness[1:].any():
                text = f"stiffness {_shown(stiffness)}: a ball has a linear spring here, the first is taken"
                self.notes.append(Note(owner, text, Outcome.CHANGED))
            self.found[name] = replace(self.found[name], stiffness=(float(stiffness[0]),))
        else:
            self._spring(name, float(model.qpos_spring[at]), stiffness)

    def _tendon(self, k: int) -> None:
        model = self.model
        owner = f"tendon '{given_names(model, 'tendon', model.ntendon)[k] or k + 1}'"
        armature, friction = float(model.tendon_armature[k]), float(model.tendon_frictionloss[k])
        own = self._pulled(k)
        if own is None:
            said = {
                "armature": [armature],
                "damping": [model.tendon_damping[k], *model.tendon_dampingpoly[k]],
                "frictionloss": [friction],
                "stiffness": [model.tendon_stiffness[k], *model.tendon_stiffnesspoly[k]],
            }
            self.notes += [
                Note(owner, f"{word} {_shown(values)}: {_SEVERAL}")
                for word, values in said.items()
                if np.any(values)
            ]
            return
        # Length c x: what acts on it acts on the joint c times, at c times its displacement and rate.
        name, factor = own
        damping = self._damping(owner, model.tendon_damping[k], model.tendon_dampingpoly[k])
        friction = abs(factor) * self._friction(owner, friction)
        self._add(name, factor**2 * armature, factor**2 * damping, friction)
        stiffness = self._stiffness(owner, model.tendon_stiffness[k], model.tendon_stiffnesspoly[k])
        if stiffness is None:
            return
        self._note_yield(owner, model.tendon_springyield[k])
        shortest, longest = (float(length) for length in model.tendon_lengthspring[k])
        if shortest != longest:
            text = (
                f"stiffness {_shown(stiffness)} beyond the lengths {shortest:g} to {longest:g}: left out, as a spring "
                "has one rest here"
            )
            self.notes.append(Note(owner, text))
            return
        powers = np.arange(2, 2 + len(stiffness))
        self._spring(name, shortest / factor, stiffness * factor**powers)

    def _pulled(self, tendon: int) -> tuple[str, float] | None:
        """Find the one joint that a tendon moves, and how long it is per unit of that; None: there are several."""
        terms = {
            joint: factor for joint, factor in (sum_of_joints(self.model, tendon) or {}).items() if factor
        }
        if len(terms) != 1:
            return None
        ((joint, factor),) = terms.items()
        return self.tree.joint_names[joint], factor

    def _actuator(self, k: int) -> None:
        """Hand the rotor of an actuator and its damping to the joint behind its gear."""
        model, kinds = self.model, self.mujoco.mjtTrn
        owner = f"actuator '{given_names(model, 'actuator', model.nu)[k] or f'number {k + 1}'}'"
        armature = float(model.actuator_armature[k])
        damping = self._damping(owner, model.actuator_damping[k], model.actuator_dampingpoly[k])
        if not (armature or damping):
            return
        kind, target = int(model.actuator_trntype[k]), int(model.actuator_trnid[k][0])
        gear = float(model.actuator_gear[k][0])
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            own = (self.tree.joint_names[target], 1.0)
        else:
            own = self._pulled(target) if kind == kinds.mjTRN_TENDON else None
        if own is None:
            said = JointPhysics(armature, damping)
            self.notes.append(Note(owner, f"{said}: {_SEVERAL}"))
            return
        name, factor = own
        ratio = (gear * factor) ** 2
        self._add(name, ratio * armature, ratio * damping)

    def _custom(self, name: str, numbers: FloatArray) -> None:
        owner, joint = f"<numeric name='{SPRING}{name}'>", self.joints.get(name)
        if joint is None or not joint.has_axis:
            self.notes.append(Note(owner, "no joint of this name that has one freedom"))
        elif not self.no_springs:
            force, *stiffness = numbers[1:]
            effort = np.array([force, *(-value for value in stiffness)])
            self.told.setdefault(name, []).append(_Spring(float(numbers[0]), effort))

    def _spring(self, name: str, rest: float, stiffness: FloatArray) -> None:
        self.told.setdefault(name, []).append(_Spring(rest, np.array([0.0, *-stiffness])))

    def _stiffness(self, owner: str, linear: float, higher: FloatArray) -> FloatArray | None:
        """(3,) coefficients of a spring, or None where there is none."""
        stiffness = np.array([linear, *higher], dtype=float)
        if not stiffness.any():
            return None
        if self.no_springs:
            self.notes.append(Note(owner, f"stiffness {_shown(stiffness)}: the file disables all springs"))
            return None
        return stiffness

    def _damping(self, owner: str, linear: float, higher: FloatArray) -> float:
        if not (linear or np.any(higher)):
            return 0.0
        if self.no_damping:
            text = f"damping {_shown([linear, *higher])}: the file disables all dampers"
            self.notes.append(Note(owner, text))
            return 0.0
        if np.any(higher):
            # MuJoCo's effort is -(b v + b1 |v| v + b2 v³).
            self.notes.append(
                Note(owner, f"damping {_shown(higher)} by higher powers of the speed: {_ALONE}")
            )
        return float(linear)

    def _friction(self, owner: str, friction: float) -> float:
        if friction and self.no_friction:
            self.notes.append(Note(owner, f"frictionloss {friction:g}: the file disables it"))
            return 0.0
        return friction

    def _note_yield(self, owner: str, limit: float) -> None:
        if limit:
            self.notes.append(Note(owner, f"springyield {float(limit):g}: {_YIELDS}"))


def _with_springs(physics: JointPhysics, springs: Sequence[_Spring]) -> JointPhysics:
    """Add springs up, about the rest of the first."""
    rest = springs[0].rest
    effort = np.zeros(1)
    for spring in springs:
        effort = polynomial.polyadd(effort, moved_polynomial(spring.effort, spring.rest - rest))
    stiffness = tuple(float(-value) for value in np.trim_zeros(effort[1:], "b"))
    return replace(physics, stiffness=stiffness, rest=rest, force=float(effort[0]))


def _shown(values: Any) -> str:
    return " ".join(f"{float(value):g}" for value in np.trim_zeros(np.asarray(values, dtype=float), "b"))


# ----------------------------------------------------------------------------------------------------
# Writing
# ----------------------------------------------------------------------------------------------------

_POWERS = 3
"""Coefficients of stiffness that MuJoCo has."""
_SAME = 1e-13
"""How far a spring may be off, relative to its largest coefficient, that is told about another rest."""


def write_physics(
    element: etree._Element, joint: Joint, custom: etree._Element, *, turned: bool
) -> Iterator[Note]:
    """Write what a joint does by itself.

    MuJoCo's springs push with nothing at their rest, so one with a constant force is told about the position in which
    both are in balance. What MuJoCo cannot say of a spring goes to ``<custom>``, where `load` finds it.

    Parameters
    ----------
    element
        The ``<joint>``.
    joint
        Any joint that moves.
    custom
        The ``<custom>``.
    turned
        Whether the joint's axes are not those of its body in MuJoCo, about which a ball rubs there.

    Yields
    ------
    Note
        What MuJoCo has no word for, or understands otherwise.
    """
    physics = joint.physics
    for word, value in (
        ("armature", physics.armature),
        ("damping", physics.damping),
        ("frictionloss", physics.friction),
    ):
        if value:
            element.set(word, number_text([value]))
    if joint.kind is JointKind.FLOATING and (physics.armature or physics.friction):
        said = JointPhysics(physics.armature, friction=physics.friction)
        text = f"{said}: along its own axes, in MuJoCo along the world's"
        yield Note(f"joint '{joint.name}'", text, Outcome.CHANGED)
    if joint.kind is JointKind.SPHERICAL and physics.friction and turned:
        text = f"friction {physics.friction:g}: about the joint's own axes, in MuJoCo about the body's"
        yield Note(f"joint '{joint.name}'", text, Outcome.CHANGED)
    if not physics.pushes:
        return
    rest, stiffness, lost = _in_words(physics)
    if any(stiffness):
        element.set("stiffness", number_text(np.trim_zeros(np.array(stiffness), "b")))
        if rest and joint.has_axis:
            element.set("springref", number_text([rest]))
    if any(lost):
        # Zeros stand for the powers that MuJoCo knows.
        etree.SubElement(
            custom, "numeric", name=f"{SPRING}{joint.name}", data=number_text([physics.rest, *lost])
        )
        force, *more = lost
        said = JointPhysics(stiffness=tuple(more), rest=physics.rest, force=force)
        text = (
            f"{said}: in <custom> alone, as MuJoCo has no word for constant forces, and none for powers of the "
            f"displacement above {_POWERS}: it moves without"
        )
        yield Note(f"joint '{joint.name}'", text)


def _in_words(physics: JointPhysics) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """Tell rest and stiffness as MuJoCo has them, and what these lack: the constant force and stiffness besides."""
    short = len(np.trim_zeros(np.array(physics.stiffness), "b")) <= _POWERS
    if not physics.force and short:
        return physics.rest, physics.stiffness, ()
    rest = _balance(physics) if short else None
    if rest is not None:
        effort = moved_polynomial(np.array(physics.polynomial), physics.rest - rest)
        back = moved_polynomial(np.array([0.0, *effort[1:]]), rest - physics.rest)
        if np.abs(back - physics.polynomial).max() <= _SAME * np.abs(physics.polynomial).max():
            return rest, tuple(-effort[1:]), ()
    zeros = (0.0,) * min(_POWERS, len(physics.stiffness))
    return physics.rest, physics.stiffness[:_POWERS], (physics.force, *zeros, *physics.stiffness[_POWERS:])


def _balance(physics: JointPhysics) -> float | None:
    """Find the position nearest to rest at which a spring pushes with nothing."""
    if not any(physics.stiffness):
        return None
    roots = polynomial.polyroots(np.trim_zeros(np.array(physics.polynomial), "b"))
    real = roots.real[np.abs(roots.imag) <= 1e-9 * np.abs(roots)]
    if not real.size:
        return None
    root = float(real[np.argmin(np.abs(real))])
    for _ in range(2):  # the roots are eigenvalues: Newton's steps make them exact to the last digit
        slope = polynomial.polyval(root, polynomial.polyder(physics.polynomial))
        root -= float(polynomial.polyval(root, physics.polynomial) / slope) if slope else 0.0
    return physics.rest + root if abs(root) < MUJOCO_FAR else None


def lost_loop_physics(mechanism: Mechanism) -> Iterator[Note]:
    """Tell what joints that close loops do by themselves, for which equality constraints have no word.

    Parameters
    ----------
    mechanism
        What is written.

    Yields
    ------
    Note
        The loop, with its numbers.
    """
    for loop in mechanism.loops:
        for word, physics in zip(physics_coordinates(loop.kind), loop.physics, strict=False):
            if physics:
                text = f"its {word}: {physics}: left out: equality constraints have no word for it"
                yield Note(f"loop '{loop.name}'", text)
