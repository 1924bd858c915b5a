"""The same mechanism with every loop closed by balls, for software that knows no other loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_positive
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import JointKind, Loop, Note
from stewart_pin.model.loop_table import orthonormal_triad
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain
from stewart_pin.typing import FloatArray

_SHARE = 0.25
"""Distance of the balls, as a part of the robot's size: far enough apart for good conditioning."""


def loops_by_balls(chain: ClosedChain, *, distance: float | None = None) -> ClosedChain:
    """Hold hinges by two balls on their axis, and rigid closures by three, so that all loops are spherical.

    The motions are the same. A hinge gets one row more than it has conditions, a rigid closure three: the reactions of
    these balls are not unique.

    Parameters
    ----------
    chain
        Closed chain.
    distance
        Distance between the balls of one loop [m]; default: a quarter of the robot's size.

    Returns
    -------
    ClosedChain
        Balls of a loop are called after it, with a number; spherical loops, tree, motors and home stay.

    Raises
    ------
    InputError
        If the distance is not positive.
    UnsupportedError
        If a loop slides, or keeps a distance or angle only: no set of balls does the same.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> by_balls = loops_by_balls(stp.load("five_bar"))
    >>> [(loop.name, str(loop.kind)) for loop in by_balls.loops]
    [('tip_pin_1', 'spherical'), ('tip_pin_2', 'spherical')]
    """
    as_chain(chain)
    apart = as_positive("distance", _SHARE * chain.length_scale if distance is None else distance)
    loops = tuple(ball for loop in chain.loops for ball in _balls(loop, apart))
    lost = tuple(
        Note(f"loop '{loop.name}'", "its limits: the balls that stand for it have other coordinates")
        for loop in chain.loops
        if loop.bounds and loop.kind is not JointKind.SPHERICAL
    )
    notes = (*chain.mechanism.notes, *lost)
    return replace(chain, mechanism=replace(chain.mechanism, loops=loops, notes=notes))


def _balls(loop: Loop, distance: float) -> list[Loop]:
    axis, across, _ = orthonormal_triad(loop.axis)
    points: list[FloatArray]
    match loop.kind:
        case JointKind.SPHERICAL:
            return [loop]
        case JointKind.REVOLUTE:
            points = [axis * distance / 2, -axis * distance / 2]
        case JointKind.FIXED:
            points = [np.zeros(3), axis * distance, across * distance]
        case _:
            raise UnsupportedError(
                f"loop '{loop.name}' is of type '{loop.kind}', which no balls replace; cut it at a hinge or a ball"
            )
    # The same coordinates in both frames: the points meet where the frames do.
    shifts = [pin.SE3(np.eye(3), point) for point in points]
    return [
        replace(
            loop,
            name=f"{loop.name}_{number}",
            kind=JointKind.SPHERICAL,
            placement1=loop.placement1 * shift,
            placement2=loop.placement2 * shift,
            bounds=(),
        )
        for number, shift in enumerate(shifts, start=1)
    ]
