r"""How motions go that nobody asks for: idle freedoms, such as the spin of a rod between two balls.

Loops, platform and motors do not determine them, so that something has to be chosen, and the choice has to belong to
the mechanism and not to the joints by which it is told. With R a basis of these motions, M the inertia of the tree and
h its efforts without acceleration,

.. math:: R^\top M v = 0, \qquad R^\top (M a + h) = 0:

they carry no momentum, and follow their own inertia. A rod that is round about its axis u then does not turn about it,
:math:`u \cdot \omega = 0` and :math:`u \cdot \dot\omega = 0`, as textbooks have it. Of motions without inertia, R₀, on
which no effort depends, the links turn least: with the angular velocities :math:`\omega_i = J_i v` of all links in the
world,

.. math:: R_0^\top \sum_i J_i^\top \omega_i = 0, \qquad R_0^\top \sum_i J_i^\top \dot\omega_i = 0.

What turns no link either, a massless slide, moves least in the coordinates of its joints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stewart_pin.tolerances import NO_INERTIA
from stewart_pin.typing import FloatArray

if TYPE_CHECKING:
    from stewart_pin.state.state import State


class OwnMotion:
    """Motions that nobody asks for, at one state.

    Parameters
    ----------
    state
        The state.
    rest
        (nv, k) basis of these motions, R, lengths in robot sizes, dimensionless.
    """

    def __init__(self, state: State, rest: FloatArray) -> None:
        self._state = state
        self._heavy = self._light = rest
        if rest.shape[1]:
            weight = NO_INERTIA * np.abs(state.inertia).max(initial=0.0)
            self._heavy, light = _orthonormal(rest, state.inertia, weight)
            self._light = _orthonormal(light, state.turning, NO_INERTIA)[0] if light.shape[1] else light

    def velocity(self, motion: FloatArray) -> FloatArray:
        """Let the motions carry no momentum.

        Parameters
        ----------
        motion
            (nv,) or (nv, n) velocities, lengths in robot sizes, dimensionless.

        Returns
        -------
        numpy.ndarray
            Like `motion`, changed along R only, dimensionless.
        """
        if self._heavy.shape[1]:
            motion = motion - self._heavy @ (self._heavy.T @ (self._state.inertia @ motion))
        if self._light.shape[1]:
            motion = motion - self._light @ (self._light.T @ (self._state.turning @ motion))
        return motion

    def acceleration(self, motion: FloatArray) -> FloatArray:
        """Let the motions follow their own inertia, under weight and gyroscopic effects.

        Parameters
        ----------
        motion
            (nv,) acceleration, lengths in robot sizes, dimensionless.

        Returns
        -------
        numpy.ndarray
            (nv,) changed along R only, dimensionless.
        """
        state = self._state
        if self._heavy.shape[1]:
            pull = state.inertia @ motion + state.nle * state.chain.tangent_scale
            motion = motion - self._heavy @ (self._heavy.T @ pull)
        if self._light.shape[1]:
            turning = state.turning @ motion + state.turning_bias
            motion = motion - self._light @ (self._light.T @ turning)
        return motion


def _orthonormal(basis: FloatArray, metric: FloatArray, nothing: float) -> tuple[FloatArray, FloatArray]:
    """Split a space into a basis that is orthonormal in a metric, and what has no length in it."""
    lengths, axes = np.linalg.eigh(basis.T @ metric @ basis)
    some = lengths > nothing
    return basis @ (axes[:, some] / np.sqrt(lengths[some])), basis @ axes[:, ~some]
