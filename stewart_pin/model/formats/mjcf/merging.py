"""Loops that make one joint together: MJCF writes a hinge as two points, a universal joint as a point and a rod."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import JointKind, Loop, Note, Outcome
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.typing import FloatArray

_SAME_LENGTH = 1e-9
"""How far two lengths may differ, relative to their size, and count as equal."""
_ROUNDED = 1e-4
"""The same for the two points of a hinge, printed with few digits: rigid links could not meet in both otherwise."""
_Z = np.array([0.0, 0.0, 1.0])


def merge_loops(loops: Sequence[Loop]) -> tuple[tuple[Loop, ...], list[Note]]:
    """Merge loops between the same two links where they allow exactly the motions of one joint.

    Two spherical loops whose points are equally far apart on both links hold the line through them: a revolute loop,
    with five rows where the two have six of rank five. Lengths that differ by their printed digits count as equal: as
    two loops, rigid links would never close. A spherical loop and a rod between points that stand square
    above its centre keep two directions perpendicular: a universal loop.

    Parameters
    ----------
    loops
        All loops of a file.

    Returns
    -------
    loops : tuple of Loop
        In the order of the file; a merged loop bears the name and place of its first.
    notes : list of Note
        What was merged.
    """
    merged, notes = list(loops), []
    for first in loops:
        if first.kind is not JointKind.SPHERICAL or first not in merged:
            continue
        for second in loops:
            if second is first or second not in merged:
                continue
            joined, misfit = _join(first, second)
            if joined is not None:
                merged[merged.index(first)] = joined
                merged.remove(second)
                rounded = f"; its points are {misfit:.3g} m farther apart on one link" if misfit else ""
                text = f"one {joined.kind} loop together with '{second.name}'{rounded}"
                notes.append(Note(f"loop '{first.name}'", text, Outcome.CHANGED))
                break
    return tuple(merged), notes


def _join(first: Loop, second: Loop) -> tuple[Loop | None, float]:
    """Merge two loops if they make one joint; tell by how much the points of a hinge miss each other [m]."""
    if {first.link1, first.link2} != {second.link1, second.link2}:
        return None, 0.0
    ends = [second.placement1.translation, second.placement2.translation]
    if second.link1 != first.link1:
        ends.reverse()
    arm1, arm2 = ends[0] - first.placement1.translation, ends[1] - first.placement2.translation
    length1, length2 = float(np.linalg.norm(arm1)), float(np.linalg.norm(arm2))
    size = max(length1, length2)
    far = max(float(np.linalg.norm(end)) for end in ends)
    if min(length1, length2) <= _ROUNDED * far:
        return None, 0.0
    misfit = abs(length1 - length2)
    if second.kind is JointKind.SPHERICAL and misfit <= _ROUNDED * size:
        hinge = _hinge(first, arm1 / length1, arm2 / length2)
        return hinge, misfit if misfit > _SAME_LENGTH * size else 0.0
    # Pythagoras: the rod spans the hypotenuse while the arms stand square.
    excess = second.length**2 - length1**2 - length2**2
    if second.kind is JointKind.DISTANCE and abs(excess) <= _SAME_LENGTH * second.length**2:
        return _cross(first, arm1 / length1, arm2 / length2), 0.0
    return None, 0.0


def _hinge(loop: Loop, axis1: FloatArray, axis2: FloatArray) -> Loop:
    """Turn the loop's frames so that z is the shared axis."""
    return replace(
        loop,
        kind=JointKind.REVOLUTE,
        placement1=pin.SE3(_frame_along(axis1), loop.placement1.translation),
        placement2=pin.SE3(_frame_along(axis2), loop.placement2.translation),
        axis=_Z,
    )


def _cross(loop: Loop, axis1: FloatArray, axis2: FloatArray) -> Loop:
    return replace(
        loop,
        kind=JointKind.UNIVERSAL,
        axis=loop.placement1.rotation.T @ axis1,
        axis2=loop.placement2.rotation.T @ axis2,
    )


def _frame_along(axis: FloatArray) -> FloatArray:
    n, x, y = orthonormal_triad(axis)
    return np.column_stack([x, y, n])
