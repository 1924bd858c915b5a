"""Whether many states are worth the time of compiling kernels for them."""

from __future__ import annotations

from functools import lru_cache

from stewart_pin.errors import InputError, MissingExtraError, UnsupportedError
from stewart_pin.kernels.compile import Kernels, compile_kernels
from stewart_pin.model.chain import ClosedChain

HANDFUL = 300
"""States below which the verbs of one state, at a few milliseconds each, are through before kernels are compiled."""


def kernels_for(chain: ClosedChain, states: int, wanted: bool | None = None) -> Kernels | None:
    """Compile kernels in platform coordinates, if there are enough states and they can be had.

    Chains do not change, so the kernels of the last few are kept.

    Parameters
    ----------
    chain
        Closed chain.
    states
        Number of states.
    wanted
        False: never; True: always, or the error that says why not; None: for more than a handful of states, and where
        CasADi is installed and the chain can be compiled.

    Returns
    -------
    Kernels or None
        The verbs for arrays, or None where those of one state are to be used.

    Raises
    ------
    MissingExtraError
        If kernels are wanted and CasADi is not installed.
    UnsupportedError
        If kernels are wanted and the chain cannot be compiled.
    InputError
        If `wanted` is neither True, False nor None.
    """
    if wanted not in (True, False, None):
        raise InputError(f"kernels must be True, False or None (by the number of states), got {wanted!r}")
    if wanted is False or (wanted is None and states < HANDFUL):
        return None
    try:
        return _compiled(chain)
    except (MissingExtraError, UnsupportedError):
        if wanted:
            raise
        return None


@lru_cache(maxsize=8)
def _compiled(chain: ClosedChain) -> Kernels:
    return compile_kernels(chain)
