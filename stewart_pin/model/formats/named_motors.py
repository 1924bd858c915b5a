"""Motors that a file names beside its joints: taken where no joint is marked independent and nothing is ambiguous."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stewart_pin.model.description import Mechanism, Note, Outcome
from stewart_pin.model.motors import mark_motors

_MARKED = "motors are the joints marked independent"


def choose_motors(mechanism: Mechanism, named: Sequence[tuple[str, str, tuple[str, ...]]]) -> Mechanism:
    """Let tags that name joints mark the motors, if they can only mean one thing.

    Parameters
    ----------
    mechanism
        What the rest of the file says.
    named
        Per tag of the file: its kind, how the report calls it, and the joints that it names.

    Returns
    -------
    Mechanism
        With motors in the order of the tags, where no joint was marked independent, every named joint exists, has one
        freedom and is named once, and all kinds of tags name the same joints; else as it was. The notes say which.
    """
    if not named:
        return mechanism
    fault = _MARKED if any(joint.independent for joint in mechanism.joints) else _ambiguity(mechanism, named)
    if fault:
        ignored = tuple(Note(subject, fault) for _, subject, _ in named)
        movable = {joint.name for joint in mechanism.joints if joint.has_axis}
        hints = dict.fromkeys(joint for _, _, joints in named for joint in joints if joint in movable)
        return replace(mechanism, notes=mechanism.notes + ignored, motor_hints=tuple(hints))
    first = named[0][0]
    motors = [joint for kind, _, joints in named for joint in joints if kind == first]
    kept = tuple(Note(subject, "names the motors", Outcome.KEPT) for _, subject, joints in named if joints)
    return replace(mark_motors(mechanism, motors), notes=mechanism.notes + kept)


def _ambiguity(mechanism: Mechanism, named: Sequence[tuple[str, str, tuple[str, ...]]]) -> str:
    """Say why named joints cannot be taken for the motors; empty: they can."""
    movable = {joint.name for joint in mechanism.joints if joint.has_axis}
    by_kind: dict[str, list[str]] = {}
    for kind, subject, joints in named:
        if kind == "transmission" and len(joints) != 1:
            return f"not taken for motors: {subject} leads to {len(joints)} joints; pass motors=[...]"
        by_kind.setdefault(kind, []).extend(joints)
    for joints in by_kind.values():
        for joint in joints:
            if joint not in movable:
                return f"not taken for motors: joint '{joint}' is missing or has not one freedom; pass motors=[...]"
            if joints.count(joint) > 1:
                return f"not taken for motors: joint '{joint}' is named twice; pass motors=[...]"
    if len({frozenset(joints) for joints in by_kind.values()}) > 1:
        return (
            f"not taken for motors: {' and '.join(f'<{kind}>' for kind in by_kind)} differ; pass motors=[...]"
        )
    return ""
