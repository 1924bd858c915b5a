"""Leg lengths of a chain at one orientation, point by point, where no closed form stands for its legs; closed paths."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.mechanics.kinematics import inverse_kinematics, motor_jacobian
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_chain, as_configuration
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import ArrayLike, Configuration, FloatArray


class ChainLegs:
    """Legs of a chain that are read off it as nearly as printed digits allow, and measured by inverse kinematics.

    Parameters
    ----------
    chain
        Closed chain of six legs.
    hexapod
        Its leg ends, nearly.
    rotation
        (3, 3) platform axes in the world frame.
    stroke
        (6, 2) least and greatest length of each leg [m].
    """

    def __init__(
        self, chain: ClosedChain, hexapod: Hexapod, rotation: FloatArray, stroke: FloatArray
    ) -> None:
        self._chain, self._hexapod, self._rotation, self._stroke = chain, hexapod, rotation, stroke
        self._found: dict[bytes, FloatArray | None] = {}
        self._last: FloatArray | None = None

    def lengths(self, position: FloatArray, reach: float) -> FloatArray:
        """Measure the legs where they may be within their strokes.

        Parameters
        ----------
        position
            (n, 3) platform origins in the world frame [m].
        reach
            How far outside the strokes a leg may be and still count [m].

        Returns
        -------
        numpy.ndarray
            (n, 6) lengths; as read off further outside, infinite where the chain does not reach [m].
        """
        sign, offset = self._chain.leg_readings
        lengths = leg_lengths(self._hexapod, position, self._rotation)
        slack = reach + 10 * PRINTED * self._chain.length_scale
        near = (lengths > self._stroke[:, 0] - slack) & (lengths < self._stroke[:, 1] + slack)
        for k in np.flatnonzero(near.all(axis=1)):
            q = self._configuration(position[k])
            lengths[k] = np.inf if q is None else offset + sign * q[self._chain.motor_q_index]
        return lengths

    def jacobian(self, position: FloatArray) -> FloatArray:
        """Measure how the legs change with the platform's motion.

        Parameters
        ----------
        position
            (n, 3) platform origins that the chain reaches, in the world frame [m].

        Returns
        -------
        numpy.ndarray
            (n, 6, 6) leg rates per twist [1 and m].
        """
        sign = self._chain.leg_readings[0][:, None]
        rows = np.zeros((len(position), 6, 6))
        for k, at in enumerate(position):
            q = self._configuration(at)
            if q is not None:
                rows[k] = sign * motor_jacobian(self._chain, q)
        return rows

    def _configuration(self, position: FloatArray) -> FloatArray | None:
        key = position.tobytes()
        if key not in self._found:
            pose = pin.SE3(self._rotation, position)
            closure = inverse_kinematics(self._chain, pose, q_guess=self._last, limits=False, throw=False)
            if not closure.success and self._last is not None:
                closure = inverse_kinematics(self._chain, pose, limits=False, throw=False)
            self._found[key] = self._last = closure.q if closure.success else None
        return self._found[key]


# ----------------------------------------------------------------------------------------------------
# Paths between configurations on which the loops stay closed
# ----------------------------------------------------------------------------------------------------

Path = Callable[[float], Configuration]
"""Configuration (nq,) as a function of one parameter."""


def closed_path(chain: ClosedChain, configurations: ArrayLike) -> Path:
    """Join closed configurations by a path whose every point has closed loops.

    Parameters
    ----------
    chain
        Closed chain.
    configurations
        (n, nq) two or more configurations, the loops nearly closed [m, rad, unit quaternions].

    Returns
    -------
    callable
        Configuration (nq,) of a parameter from 0 to n - 1: the tangent's straight line between neighbours, moved to
        the nearest configuration with closed loops.

    Raises
    ------
    InputError
        If there are fewer than two.
    ClosureError
        When called: if the loops do not close in between; give more configurations.
    """
    as_chain(chain)
    stops = as_array("configurations", configurations, (None, chain.nq))
    if len(stops) < 2:
        raise InputError(f"configurations must be two or more, got {len(stops)}")
    stops = [close_loops(chain, as_configuration(chain, "configurations", q)).q for q in stops]

    def path(s: float) -> Configuration:
        k = min(max(int(np.floor(s)), 0), len(stops) - 2)
        if s == k or s == k + 1:
            return stops[k + int(s != k)]
        return close_loops(chain, pin.interpolate(chain.model, stops[k], stops[k + 1], s - k)).q

    return path
