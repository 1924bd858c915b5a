"""Whether many states are worth the time of compiling kernels for them; leg lengths on large grids among these."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stewart_pin.errors import (
    ActuationError,
    InputError,
    MissingExtraError,
    SingularityError,
    UnsupportedError,
)
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.kernels.kernels import Kernels, compile_kernels
from stewart_pin.kernels.planning.joint_physics import first_effect
from stewart_pin.model.description import Coupling, JointKind
from stewart_pin.model.joint_physics import fields_key
from stewart_pin.programs.arrays import SingleState
from stewart_pin.programs.passes import prepare
from stewart_pin.programs.program import Program
from stewart_pin.programs.status import StateBound
from stewart_pin.programs.symbolic import program_from_casadi, writing
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import CLOSED
from stewart_pin.typing import FloatArray

MANY_CALLS = 100_000
"""Calls of one state below which compiling, a second and a half, takes longer than it saves: 15 microseconds a call, of
62 a step."""
_NEARLY_CLOSED = CLOSED**0.5
"""Gap in robot sizes up to which one factorisation serves position and velocity: one step leaves `CLOSED` of it."""
HANDFUL = 300
"""States below which the verbs of one state, at a few milliseconds each, are through before kernels are compiled."""


def kernels_for(
    chain: ClosedChain,
    states: int,
    wanted: bool | None = None,
    wrenches: tuple[str, ...] = (),
    ground_moves: bool = False,
) -> Kernels | None:
    """Compile kernels in platform coordinates, if there are enough states and they can be had.

    Chains do not change but for armature, damping and friction of their models: the kernels of the last few are kept.

    Parameters
    ----------
    chain
        Closed chain.
    states
        Number of states.
    wanted
        False: never; True: always, or the error that says why not; None: for more than a handful of states, and where
        CasADi is installed, the chain can be compiled and its poses tell its states.
    wrenches
        Links on which something acts from outside, as in `compile_kernels`.
    ground_moves
        Whether the ground moves, as `base_motion` there.

    Returns
    -------
    Kernels or None
        The verbs for arrays, or None where those of one state are to be used.

    Raises
    ------
    MissingExtraError
        If kernels are wanted and CasADi is not installed.
    UnsupportedError
        If kernels are wanted and the chain cannot be compiled, or has a coupling or a spring that counts turns.
    InputError
        If `wanted` is neither True, False nor None.
    """
    require_choice(wanted)
    if wanted is False or (wanted is None and states < HANDFUL):
        return None
    try:
        counting = _counts_turns(chain)
        if counting is not None:
            raise UnsupportedError(
                f"coupling '{counting.name}' counts whole turns, which a pose does not tell: a motion is followed "
                "from state to state"
            )
        turning = _turning_spring(chain)
        if turning is not None:
            raise UnsupportedError(
                f"the spring of joint '{turning}' counts whole turns, which a pose does not tell: a motion is followed "
                "from state to state; limits of position within a turn would tell"
            )
        return _compiled(chain, fields_key(chain.model), wrenches, ground_moves)
    except (MissingExtraError, UnsupportedError):
        if wanted:
            raise
        return None


def _counts_turns(chain: ClosedChain) -> Coupling | None:
    """Find a coupling by which a whole turn of one joint is something else than whole turns of the others.

    A loop sees sines and cosines alone. But a gear of 2.6 stands elsewhere after a turn, and a screw after many: the
    state at a pose is then that of the way there, where kernels go from home.
    """
    for coupling in chain.mechanism.couplings:
        if coupling.joint2 is None:
            continue
        kinds = [chain.mechanism.joint(name).kind for name in coupling.joints]
        ratio = np.trim_zeros(coupling.polynomial[1:], "b")
        # A turn of a sum is only a part of a turn of each of its parts.
        one_to_one = not coupling.others and [*map(abs, ratio)] == [1.0] and len(set(kinds)) == 1
        if (len(ratio) or coupling.others) and JointKind.REVOLUTE in kinds and not one_to_one:
            return coupling
    return None


def _turning_spring(chain: ClosedChain) -> str | None:
    """Find a hinge with a spring whose limits do not keep it within a turn."""
    for joint in chain.mechanism.joints:
        if joint.kind is JointKind.REVOLUTE and any(joint.physics.stiffness):
            entry = chain.model.joints[chain.model.getJointId(joint.name)].idx_v
            (least, most), *_ = chain.limits.bounds("position", np.array([entry]))
            if not most - least <= 2 * np.pi:
                return joint.name
    return None


@dataclass(frozen=True, eq=False)
class SimulationKernels:
    """Functions of one state of the whole tree, for the thread that asked; their results last until the next call.

    Attributes
    ----------
    acceleration
        Of (q, v, tau_motor) to (a, lambda_c).
    projection
        Of (q, v), all but closed, to (q, v, gap) with closed loops; other states are out of bounds. None for a chain
        without loops.
    """

    acceleration: SingleState
    projection: SingleState | None


def simulation_kernels(
    chain: ClosedChain, calls: int, wanted: bool | None = None
) -> SimulationKernels | None:
    """Compile what a simulation calls for one state after the other, if it is called often enough.

    Parameters
    ----------
    chain
        Closed chain.
    calls
        How often the acceleration will be called.
    wanted
        As in `kernels_for`, with many more calls for None.

    Returns
    -------
    SimulationKernels or None
        The functions.

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
        return _compiled_tree(chain, fields_key(chain.model), threading.get_ident())
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
def _compiled_tree(chain: ClosedChain, fields: bytes, thread: int) -> SimulationKernels:
    # Their arguments have fixed places: one for each thread. An interpreter would be slower than Pinocchio.
    dtype = np.dtype(np.float64)
    acceleration = SingleState(_tree_program(chain, fields, "tree_forward_dynamics"), (), dtype, "llvm")
    if not chain.nc:
        return SimulationKernels(acceleration, None)
    bounds = [StateBound("before", upper=_NEARLY_CLOSED), StateBound("left", upper=CLOSED)]
    projection = SingleState(_tree_program(chain, fields, "tree_projection"), bounds, dtype, "llvm")
    return SimulationKernels(acceleration, projection)


@lru_cache(maxsize=16)
def _tree_program(chain: ClosedChain, fields: bytes, name: str) -> Program:
    return prepare(program_from_casadi(_tree_kernels(chain, fields).casadi(name)))


@lru_cache(maxsize=8)
def _tree_kernels(chain: ClosedChain, fields: bytes) -> Kernels:
    kernels = compile_kernels(chain, coordinates="tree")
    from stewart_pin.kernels.planning.tree import tree_of  # noqa: PLC0415 - needs CasADi

    effect = first_effect(tree_of(chain))
    if effect is not None:
        raise UnsupportedError(f"simulation takes no kernels of {chain.name}: {effect}")
    return kernels


@lru_cache(maxsize=8)
def _compiled(chain: ClosedChain, fields: bytes, wrenches: tuple[str, ...], ground_moves: bool) -> Kernels:
    return compile_kernels(chain, wrenches=wrenches, base_motion=ground_moves)


# ----------------------------------------------------------------------------------------------------
# Leg lengths of a six-legged platform that does not turn, as a kernel: for grids of many millions of points
# ----------------------------------------------------------------------------------------------------

_WORTH = 2_000_000
"""Points below which compiling takes longer than it saves, a tenth of a microsecond a point."""


def lengths_at(
    hexapod: Hexapod, rotation: FloatArray, points: int, wanted: bool | None = None
) -> Callable[[FloatArray], FloatArray]:
    """Choose how to compute leg lengths at one orientation.

    Parameters
    ----------
    hexapod
        Geometry.
    rotation
        (3, 3) platform axes in the base frame.
    points
        Number of points to come.
    wanted
        False: NumPy; True: a kernel, or the error that says why not; None: a kernel for many points, where CasADi is
        installed.

    Returns
    -------
    callable
        Positions (n, 3) to leg lengths (n, 6) [m].

    Raises
    ------
    MissingExtraError
        If a kernel is wanted and CasADi is not installed.
    InputError
        If `wanted` is neither True, False nor None.
    """
    require_choice(wanted)
    if wanted or (wanted is None and points >= _WORTH):
        try:
            return _compiled_lengths(hexapod, rotation)
        except MissingExtraError:
            if wanted:
                raise
    return lambda position: leg_lengths(hexapod, position, rotation)


def _compiled_lengths(hexapod: Hexapod, rotation: FloatArray) -> Callable[[FloatArray], FloatArray]:
    try:
        import casadi as ca  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("casadi", "kernels") from None
    from stewart_pin.programs.array_kernel import compile_function  # noqa: PLC0415 - optional

    # At one orientation leg i is as long as the platform origin is away from B_i - R P_i.
    centres = hexapod.base_points - hexapod.platform_points @ np.asarray(rotation).T
    with writing():
        position = ca.SX.sym("position", 3)
        lengths = [ca.norm_2(position - ca.DM(centre)) for centre in centres]
        kernel = compile_function(ca.Function("lengths", [position], [ca.vertcat(*lengths)]))
        del position, lengths
    return lambda points: np.asarray(kernel(points))
