"""What a run watches between its records: loops that come near a singularity of theirs."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.typing import Configuration, Tangent

_LEAST_SLOPE = 0.05
"""Least change of the distance per way that is reckoned with: it may be steeper than before."""
_HALVINGS = 12
"""Thirds by which the nearest point of one step is found: to a hundredth of the step."""


class LoopNearness:
    """Distance of the loops to a singularity of theirs, looked at as often as the motion asks for.

    Singular values of rows of natural size change no faster than the configuration, so a look is due when it has gone
    a part of the last distance.

    Parameters
    ----------
    chain
        Closed chain.
    threshold
        Share of the usual distance that is near.
    """

    def __init__(self, chain: ClosedChain, threshold: float) -> None:
        self._chain = chain
        self._usual = chain.generic.usual_loops if chain.nc and chain.generic.rank else math.inf
        self.limit = threshold * self._usual if math.isfinite(self._usual) else 0.0
        self.near = False
        self._left, self._seen, self._slope, self._gone = 0.0, math.inf, 1.0, 0.0

    @property
    def memory(self) -> tuple[bool, float, float, float, float]:
        """What a run that goes on has to know."""
        return self.near, self._left, self._seen, self._slope, self._gone

    @memory.setter
    def memory(self, memory: tuple[bool, float, float, float, float]) -> None:
        self.near, self._left, self._seen, self._slope, self._gone = memory

    def passed(
        self, h: float, q: Configuration, v: Tangent, q_next: Configuration
    ) -> tuple[float, str] | None:
        """Look at a step.

        Parameters
        ----------
        h
            Its length [s].
        q
            (nq,) configuration at its start [m, rad, unit quaternions].
        v
            (nv,) velocity there [m/s, rad/s].
        q_next
            (nq,) configuration at its end [m, rad, unit quaternions].

        Returns
        -------
        tuple or None
            Smallest singular value of the loops in the step, where it has come near a singularity that the step before
            was not near to, and the joint that moves most in the motion that is gained.
        """
        if not self.limit or not np.isfinite(q_next).all():
            return None
        way = h * float(np.linalg.norm(v / self._chain.tangent_scale))
        self._left -= way
        self._gone += way
        if self._left > 0.0:
            return None
        state = State(self._chain, q_next)
        here, before = state.motions.smallest, self._seen
        # A large step may jump over the singularity, if the distance falls on as before: look between its ends.
        if here > self.limit and here + before < 2 * self._slope * self._gone:
            state = self._nearest(q, q_next)
        if math.isfinite(before) and self._gone:
            self._slope = max(_LEAST_SLOPE, abs(here - before) / self._gone)
        self._seen, self._left, self._gone = here, here / 2, 0.0
        reached = state.motions.smallest
        began, self.near = reached < self.limit and not self.near, reached < self.limit
        if not began:
            return None
        gained = state.motions.gained
        return reached, str(self._chain.tangent_names[int(np.argmax(np.abs(gained)))])

    def _nearest(self, q: Configuration, q_next: Configuration) -> State:
        chain, lower, upper = self._chain, 0.0, 1.0

        def at(share: float) -> State:
            return State(chain, pin.interpolate(chain.model, q, q_next, share))

        for _ in range(_HALVINGS):
            third = (upper - lower) / 3
            if at(lower + third).motions.smallest < at(upper - third).motions.smallest:
                upper -= third
            else:
                lower += third
        return at((lower + upper) / 2)
