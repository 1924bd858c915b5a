"""What joints do by themselves, on an OpenUSD stage: rotors, damping, dry friction and springs.

UsdPhysics itself has no word for them: its drives are servos, which move to a target, and are read as motors. Schemas
of engines have, for all coordinates of a joint alike: Newton's, in which angular damping is per degree, MuJoCo's, which
also knows linear springs, and PhysX' for rotors. The first of these that says something is believed. Rotors, damping
and friction of joints of one coordinate are written in Newton's words, rotors in PhysX' as well; words of our own hold
everything, per coordinate, and are believed where they round to those.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stewart_pin.model.description import JointKind, Outcome, physics_coordinates
from stewart_pin.model.formats.usd.stage import PHYSICS, Stage, meant, same_single
from stewart_pin.model.joint_physics import JointPhysics
from stewart_pin.typing import FloatArray

_WORDS = {
    "armature": ("newton:armature", "mjc:armature", "physxJoint:armature"),
    "damping": ("newton:damping", "mjc:damping"),
    "friction": ("newton:friction", "mjc:frictionloss"),
}
"""Words of engines, those before others that are believed first."""
SPRINGS = ("mjc:stiffness", "mjc:springref", "mjc:ref")
"""Words of a linear spring: the rest is as far from the drawn position as the second from the third."""
_UNREAD = {
    "physxJoint:jointFriction": "a share of the load on the joint, which is no dry friction here: left out",
    "mjc:springdamper": "a spring by how fast it swings, which needs MuJoCo's inertias: left out",
}
_AXES = "physxJointAxis:"
_LENGTHS = ("length", "x", "y")
_SPRUNG = (JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.SPHERICAL)
"""Kinds of joints that MuJoCo has."""
_DEGREE = float(np.radians(1.0))


def coordinates_with_physics(kind: JointKind) -> tuple[str, ...]:
    """Name what of a joint may have damping, friction and springs.

    Parameters
    ----------
    kind
        What it leaves free.

    Returns
    -------
    tuple of str
        Its coordinates, a ball as a whole; those of a floating joint are alike, and one.
    """
    return ("all",) if kind is JointKind.FLOATING else physics_coordinates(kind)


def read_physics(
    stage: Stage, prim: Any, path: str, kind: JointKind
) -> tuple[tuple[JointPhysics, ...], bool]:
    """Read what a joint does by itself, in words of engines.

    Parameters
    ----------
    stage
        The stage.
    prim
        The joint.
    path
        Its path.
    kind
        What it leaves free.

    Returns
    -------
    physics : tuple of JointPhysics
        In the order of `coordinates_with_physics`; empty: it does nothing.
    drawn : bool
        Whether the rests of springs are counted from where the stage places the bodies, as MuJoCo does.
    """
    _note_unread(stage, prim, path)
    words = coordinates_with_physics(kind)
    turns = not words or words[-1] not in _LENGTHS
    told = {quantity: _first(stage, prim, path, quantity, turns=turns) for quantity in _WORDS}
    stiffness = _number(stage, prim, SPRINGS[0])
    if not words:
        said = [word for word, value in told.values() if value] + (["mjc:stiffness"] if stiffness else [])
        if said:
            stage.note(path, f"{', '.join(said)}: a {kind} joint has no coordinate for it")
        return (), False
    found = []
    for word in words:
        angular = word not in _LENGTHS
        per = stage.kilogram * (stage.metre**2 if angular else 1.0)
        armature, damping = (told[quantity][1] * per for quantity in ("armature", "damping"))
        if angular and told["damping"][0].startswith("newton"):
            damping /= _DEGREE
        friction = told["friction"][1] * stage.kilogram * stage.metre * (stage.metre if angular else 1.0)
        found.append(JointPhysics(armature, damping, friction))
    if stiffness and kind in _SPRUNG:
        (one,) = found
        one = replace(one, stiffness=(stiffness * stage.kilogram * (stage.metre**2 if turns else 1.0),))
        if kind is not JointKind.SPHERICAL:
            unit = _angle_of_mujoco(stage) if turns else stage.metre
            apart = _number(stage, prim, SPRINGS[1]) - _number(stage, prim, SPRINGS[2])
            one = replace(one, rest=unit * apart)
        return (one,), True
    if stiffness:
        stage.note(path, f"mjc:stiffness {stiffness:g}: left out, as MuJoCo has no {kind} joints")
    return (tuple(found) if any(found) else ()), False


def _first(stage: Stage, prim: Any, path: str, quantity: str, *, turns: bool) -> tuple[str, float]:
    """Find the first word for a quantity that says something, in units of the stage."""
    said = [(word, _number(stage, prim, word)) for word in _WORDS[quantity] if prim.HasAttribute(word)]
    given = [(word, value) for word, value in said if value]
    if not given:
        return "", 0.0
    first = given[0]
    # By which a number is larger per degree than per radian.
    units = {word: _DEGREE if word == "newton:damping" and turns else 1.0 for word, _ in given}
    for word, value in given[1:]:
        if not same_single(np.array([value * units[first[0]]]), np.array([first[1] * units[word]])):
            text = f"{word} {value:g} is another {quantity} than {first[0]} {first[1]:g}, which is taken"
            stage.note(path, text, Outcome.CHANGED)
    return first


def _number(stage: Stage, prim: Any, word: str) -> float:
    value = float(stage.value(prim, word, 0.0))
    return float(meant([value])[0]) if np.float32(value) == value else value


def _angle_of_mujoco(stage: Stage) -> float:
    """Angles in MuJoCo's words are degrees unless the scene says otherwise [rad]."""
    said = {str(stage.value(prim, "mjc:compiler:angle", "degree")) for prim in stage.prims()}
    return 1.0 if "radian" in said else _DEGREE


def _note_unread(stage: Stage, prim: Any, path: str) -> None:
    for word, why in _UNREAD.items():
        value = stage.value(prim, word)
        if value is not None and np.any(value):
            stage.note(path, f"{word} {value}: {why}")
    for prop in prim.GetAuthoredProperties():
        name = str(prop.GetName())
        if name.startswith(_AXES) and np.any(stage.value(prim, name)):
            stage.note(path, f"{name} {stage.value(prim, name)}: words of PhysX for one axis are left out")


# ----------------------------------------------------------------------------------------------------
# Words of our own
# ----------------------------------------------------------------------------------------------------


def own_physics(
    stage: Stage, prim: Any, path: str, kind: JointKind, found: Sequence[JointPhysics]
) -> tuple[tuple[JointPhysics, ...], bool]:
    """Read words of our own, or find that they do not round to those of an engine.

    Parameters
    ----------
    stage
        The stage.
    prim
        The joint.
    path
        Its path.
    kind
        What it leaves free.
    found
        What words of engines say.

    Returns
    -------
    physics : tuple of JointPhysics
        As of `read_physics`.
    ours : bool
        Whether there are words of our own.
    """
    count = len(coordinates_with_physics(kind))
    told = {word: stage.own(prim, word) for word in PHYSICS}
    if all(value is None for value in told.values()):
        return tuple(found), False
    tables: dict[str, FloatArray] = {}
    for word, numbers in told.items():
        table = np.zeros((count, 1)) if numbers is None else np.array(numbers, dtype=float)
        if count == 0 or table.size % count or (word != "stiffness" and table.size != count):
            raise stage.error(path, f"has {table.size} numbers of its {word}, and {count} coordinates for it")
        tables[word] = table.reshape(count, -1)
    mine = []
    for k in range(count):
        numbers = {word: float(table[k, 0]) for word, table in tables.items() if word != "stiffness"}
        stiffness = tuple(map(float, np.trim_zeros(tables["stiffness"][k], "b")))
        mine.append(JointPhysics(stiffness=stiffness, **numbers))
    if count == 1 and kind is not JointKind.FLOATING:
        there = found[0] if found else JointPhysics()
        changed = {
            word: getattr(there, word)
            for word in _WORDS
            if not same_single(np.array([getattr(mine[0], word)]), np.array([getattr(there, word)]))
        }
        if changed:
            text = f"its {' and '.join(changed)}: changed since words of our own were written, which are passed over"
            stage.note(path, text, Outcome.CHANGED)
            mine = [replace(mine[0], **changed)]
    return (tuple(mine) if any(mine) else ()), True


def own_words(physics: Sequence[JointPhysics]) -> dict[str, FloatArray]:
    """Tell what a joint does by itself in words of our own.

    Parameters
    ----------
    physics
        Of each coordinate.

    Returns
    -------
    dict
        Numbers of every word, one per coordinate, of stiffness all coefficients of each [SI, per m or rad and powers].
    """
    powers = max((len(one.stiffness) for one in physics), default=0)
    told = {
        word: np.array([getattr(one, word) for one in physics]) for word in PHYSICS if word != "stiffness"
    }
    told["stiffness"] = np.array(
        [[*one.stiffness, *(0.0,) * (powers - len(one.stiffness))] for one in physics]
    )
    return {word: numbers for word, numbers in told.items() if numbers.any()}


def engine_words(kind: JointKind, physics: JointPhysics) -> tuple[dict[str, float], dict[str, float]]:
    """Tell what a joint of one coordinate does by itself in words of engines.

    Parameters
    ----------
    kind
        What it leaves free.
    physics
        What it does.

    Returns
    -------
    newton, physx : dict
        Attributes of ``NewtonJointAPI`` and of ``PhysxJointAPI`` [SI, angular damping per degree].
    """
    angular = coordinates_with_physics(kind)[0] not in _LENGTHS
    newton = {
        "newton:armature": physics.armature,
        "newton:damping": physics.damping * (_DEGREE if angular else 1.0),
        "newton:friction": physics.friction,
    }
    physx = {"physxJoint:armature": physics.armature} if physics.armature else {}
    return {word: value for word, value in newton.items() if value}, physx
