"""Whether many states are worth the time of compiling kernels for them."""

from __future__ import annotations

import threading
from functools import lru_cache

import numpy as np

from stewart_pin.errors import (
    ActuationError,
    InputError,
    MissingExtraError,
    SingularityError,
    UnsupportedError,
)
from stewart_pin.kernels.compile import compile_kernels
from stewart_pin.kernels.instructions import program_from_casadi
from stewart_pin.kernels.kernels import Kernels
from stewart_pin.kernels.preparing import prepare
from stewart_pin.kernels.program import Program
from stewart_pin.kernels.single_state import SingleState
from stewart_pin.model.chain import ClosedChain

MANY_CALLS = 50_000
"""Calls of one state below which compiling, half a second, takes longer than it saves, ten microseconds a call."""
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
    require_choice(wanted)
    if wanted is False or (wanted is None and states < HANDFUL):
        return None
    try:
        return _compiled(chain)
    except (MissingExtraError, UnsupportedError):
        if wanted:
            raise
        return None


def acceleration_kernel(chain: ClosedChain, calls: int, wanted: bool | None = None) -> SingleState | None:
    """Compile the forward dynamics of one state of the whole tree, if it is called often enough.

    Parameters
    ----------
    chain
        Closed chain.
    calls
        How often it will be called.
    wanted
        As in `kernels_for`, with many more calls for None.

    Returns
    -------
    SingleState or None
        Function of (q, v, tau_motor) to (a, lambda_c), for the thread that asks; its results last until the next call.

    Raises
    ------
    MissingExtraError
        If kernels are wanted and CasADi is not installed.
    UnsupportedError
        If kernels are wanted and the chain cannot be compiled.
    InputError
        If `wanted` is neither True, False nor None.
    """
    require_choice(wanted)
    if wanted is False or (wanted is None and calls < MANY_CALLS):
        return None
    try:
        return _compiled_tree(chain, threading.get_ident())
    except (MissingExtraError, UnsupportedError, ActuationError, SingularityError):
        if wanted:
            raise
        return None


def require_choice(wanted: bool | None) -> None:
    """Refuse what is no choice between kernels and the verbs of one state.

    Parameters
    ----------
    wanted
        What the caller passed.

    Raises
    ------
    InputError
        If it is neither True, False nor None.
    """
    if wanted not in (True, False, None):
        raise InputError(f"kernels must be True, False or None (by the number of states), got {wanted!r}")


@lru_cache(maxsize=8)
def _compiled_tree(chain: ClosedChain, thread: int) -> SingleState:
    # Its arguments have fixed places: one for each thread. An interpreter would be slower than Pinocchio.
    return SingleState(_tree_program(chain), (), np.dtype(np.float64), "llvm")


@lru_cache(maxsize=8)
def _tree_program(chain: ClosedChain) -> Program:
    kernels = compile_kernels(chain, coordinates="tree")
    return prepare(program_from_casadi(kernels.casadi("tree_forward_dynamics")))


@lru_cache(maxsize=8)
def _compiled(chain: ClosedChain) -> Kernels:
    return compile_kernels(chain)
