"""How redundant motors share loads within limits, for arrays of states and for one at a time.

By numba where it is installed, else state by state by the solver of the verb of one state, which also takes what
exchanges of limits bring to no end; to the same efforts.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from stewart_pin.errors import EffortLimitError, UnsupportedError
from stewart_pin.mechanics.sharing import Sharer, middle_of, sharer
from stewart_pin.model.tree import Limits
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.verbs.calling import Caller
    from stewart_pin.kernels.verbs.searching import SearchingState
    from stewart_pin.programs.arrays import SingleState

_LEAST_SHARE = 256
"""States that are worth a thread."""


class LimitedSharing:
    """Limits and rule by which efforts of one chain are shared.

    Parameters
    ----------
    chain
        Closed chain.
    effort_limit, sharing
        As in `inverse_dynamics`, but for ``"least_peak"`` [N or N m].

    Raises
    ------
    UnsupportedError
        If the least peak is asked for.
    InputError
        If an option is unknown, or limits have the wrong shape.
    """

    def __init__(self, chain: ClosedChain, effort_limit: ArrayLike | Limits | None, sharing: Any) -> None:
        by = sharer(chain, effort_limit, sharing)
        assert by is not None
        if by.sharing == "least_peak":
            raise UnsupportedError(
                "kernels share by 'least_norm' or 'mid_range'; for sharing='least_peak' ask inverse_dynamics or "
                "motor_demand, state by state"
            )
        self._sharer: Sharer = by
        self.rank = chain.generic.count.motor
        sizes = chain.tangent_scale[chain.motor_index].astype(float)
        bounds = by.bounds * sizes[:, None]
        lower, upper = np.ascontiguousarray(bounds[:, 0]), np.ascontiguousarray(bounds[:, 1])
        middle = middle_of(lower, upper) if by.sharing == "mid_range" else np.zeros(chain.nu)
        self._constants = sizes, lower, upper, middle, self.rank
        self._compiled = _compiled()
        self._code = np.zeros(1, dtype=np.int8)

    def apply(self, share: FloatArray, efforts: FloatArray, threads: int = 1) -> np.ndarray:
        """Replace least efforts by those within limits.

        Parameters
        ----------
        share
            (N, d, nu) what efforts in natural units contribute, dimensionless.
        efforts
            (N, nu) least efforts, to be replaced; nan where there are none within the limits [N or N m].
        threads
            Number of threads, each for a range of states.

        Returns
        -------
        numpy.ndarray
            (N,) of bool, dimensionless: states that have no efforts within the limits.
        """
        n = len(efforts)
        if self._compiled is None:
            lost = np.flatnonzero(np.isfinite(efforts).all(axis=1))
            out = np.zeros(n, dtype=bool)
        else:
            codes = np.zeros(n, dtype=np.int8)
            ends = [n * k // threads for k in range(threads + 1)] if n >= threads * _LEAST_SHARE else [0, n]
            workers = [
                threading.Thread(
                    target=self._compiled, args=(share, efforts, *self._constants, begin, end, codes)
                )
                for begin, end in itertools.pairwise(ends[1:])
            ]
            for worker in workers:
                worker.start()
            self._compiled(share, efforts, *self._constants, ends[0], ends[1], codes)
            for worker in workers:
                worker.join()
            out, lost = codes == 1, np.flatnonzero(codes == 2)
        for k in lost:
            load = share[k] @ (efforts[k] * self._constants[0])
            try:
                efforts[k] = self._sharer.efforts(share[k], load, self.rank)
            except EffortLimitError:
                efforts[k], out[k] = np.nan, True
        return out

    def apply_to_one(self, share: FloatArray, efforts: FloatArray) -> bool:
        """Replace the least efforts of one state, as `apply` does, with less overhead.

        Parameters
        ----------
        share
            (d, nu) what efforts in natural units contribute, dimensionless.
        efforts
            (nu,) least efforts, to be replaced [N or N m].

        Returns
        -------
        bool
            Whether there are any within the limits.
        """
        if self._compiled is not None and efforts.dtype == float:
            self._compiled(share[None], efforts[None], *self._constants, 0, 1, self._code)
            if self._code[0] == 0:
                return True
            if self._code[0] == 1:
                return False
        one = efforts[None].astype(float)
        within = not self.apply(share[None].astype(float), one)[0]
        efforts[:] = one[0]
        return within


def _compiled() -> Callable[..., None] | None:
    try:
        from stewart_pin.kernels.verbs.active_limits import share_all  # noqa: PLC0415 - optional
    except ImportError as error:
        if error.name != "numba":
            raise
        return None
    return share_all


class SharingState:
    """Inverse dynamics within limits for one state at a time; made by `Kernels.single_state`.

    One thread at a time: each thread makes its own.

    Parameters
    ----------
    caller
        Kernels.
    effort_limit, sharing
        As in `Kernels.inverse_dynamics` [N or N m].
    """

    def __init__(self, caller: Caller, effort_limit: ArrayLike | Limits | None, sharing: Any) -> None:
        self._made_from = (caller, effort_limit, sharing)
        self._sharing = LimitedSharing(caller.chain, effort_limit, sharing)
        self._state: SingleState | SearchingState = caller.single_share()
        self.status = StateStatus.OK

    def __reduce__(self) -> tuple[Any, ...]:
        return SharingState, self._made_from

    def __call__(self, *inputs: ArrayLike, out: FloatArray | None = None) -> FloatArray:
        """Evaluate the verb.

        Parameters
        ----------
        *inputs
            The verb's arrays, each of one state [any unit].
        out
            (nu,) array to write to, or None, which makes one [N or N m].

        Returns
        -------
        numpy.ndarray
            (nu,) efforts; nan unless ``status`` is OK [N or N m].

        Raises
        ------
        InputError
            If number, shape or type of an argument does not fit.
        """
        found, share = self._state(*inputs)
        self.status = self._state.status
        if self.status is StateStatus.OK and not self._sharing.apply_to_one(share, found):
            self.status = StateStatus.OUT_OF_LIMITS
        if out is None:
            return found
        out[...] = found
        return out
