"""Other choices of pivots of a chain, each made when one is wanted that the others do not give."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.planning.pivots import REGULAR
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.generic import regularity
from stewart_pin.state.newton import close_loops
from stewart_pin.typing import Configuration, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet

_MOST, _LOOKED_AT = 8, 8
"""Choices besides the usual one, and states that are looked at for another."""
_BESIDE = 1e-3
"""How far a state that is looked at may be from closed loops. It must be `REGULAR`: where pivots are judged by the
states around which they were chosen, these must be nothing special."""
_BETTER = 10.0
"""How much more regular than the best choice so far makes of it a state must be, for another choice to be worth it."""

Kernels = TypeVar("Kernels")


class OtherPivots(Generic[Kernels]):
    """Kernels of one chain by other pivots than the usual ones; iterates over those that have been made.

    Parameters
    ----------
    functions
        Functions by the usual pivots.
    make
        Makes kernels of functions.
    """

    def __init__(self, functions: FunctionSet, make: Callable[[FunctionSet], Kernels]) -> None:
        self._functions, self._make = functions, make
        self._made: list[Kernels] = []

    def __iter__(self) -> Iterator[Kernels]:
        return iter(self._made)

    def at_home(self) -> Kernels:
        """Return kernels of the whole tree, pivots chosen around home.

        Returns
        -------
        Kernels
            The first that have been made.
        """
        if not self._made:
            self._made.append(self._make(self._functions.around(self._functions.chain.q_home)))
        return self._made[0]

    def around_one_of(self, states: FloatArray, served: FloatArray | None = None) -> bool:
        """Choose pivots around one of several configurations, at which the chain itself is regular.

        Parameters
        ----------
        states
            (k, nq) configurations where no choice serves [m, rad, unit quaternions].
        served
            (k,) best conditioning so far, dimensionless; None where there is none.

        Returns
        -------
        bool
            Whether another choice has been made.
        """
        if len(self._made) >= _MOST:
            return False
        for k in np.unique(np.linspace(0, len(states) - 1, _LOOKED_AT).astype(int)):
            found = 0.0 if served is None else float(np.nan_to_num(served[k]))
            # On the way of a platform motors may stand at a dead centre.
            motors = served is not None or self._functions.coordinates != "platform"
            q = _regular(self._functions.chain, states[k], max(REGULAR, _BETTER * found), motors=motors)
            if q is None:
                continue
            try:
                other = self._functions.around(q)
            except UnsupportedError:
                continue
            if other.freedoms != self._functions.freedoms:  # round-off of closed loops taken for a pivot
                continue
            self._made.append(self._make(other))
            return True
        return False


def _regular(chain: ClosedChain, q: FloatArray, least: float, *, motors: bool) -> Configuration | None:
    """Close the loops of a configuration, if that leads to a regular one beside it."""
    if not np.isfinite(q).all():
        return None
    q = pin.normalize(chain.model, np.array(q, dtype=float))
    closure = close_loops(chain, q, throw=False)
    moved = np.abs(pin.difference(chain.model, q, closure.q) / chain.tangent_scale).max(initial=0.0)
    good = closure.success and moved < _BESIDE and regularity(closure.state, motors=motors) >= least
    return closure.q if good else None
