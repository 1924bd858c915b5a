"""All verbs of a chain for arrays of states in one object, how it is made, and what it tells of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.brief import Brief
from stewart_pin.errors import InputError, MissingExtraError, UnsupportedError
from stewart_pin.kernels.verbs.dynamics import DerivativeVerbs, DynamicsVerbs, GeometryVerbs
from stewart_pin.kernels.verbs.kinematics import KinematicsVerbs
from stewart_pin.programs.array_kernel import Engine
from stewart_pin.programs.arrays import as_real
from stewart_pin.programs.symbolic import writing
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.state import as_chain

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet
    from stewart_pin.kernels.graph.legs import PlacedLeg
    from stewart_pin.kernels.planning.elimination import Pivots


class Kernels(DynamicsVerbs, KinematicsVerbs, DerivativeVerbs, GeometryVerbs):
    """Verbs of a chain for arrays of states; made by `compile_kernels`.

    Arguments are (N, size), or (size,) for a value that holds for all states. A state that cannot be answered (out of
    reach, at a singularity, a demand that the chain cannot follow, a quaternion that is not of unit length, nan) comes
    out as nan, with its `StateStatus` code in the array ``status``; its neighbours do not notice.

    What a state is depends on the coordinates:

    ============ ======================================= =========================== ===========================
    coordinates  pose                                    twist                       acceleration
    ============ ======================================= =========================== ===========================
    "platform"   (N, 7) position, unit quaternion xyzw   (N, 6) [v; ω], world axes   (N, 6) [dv/dt; dω/dt]
    "motor"      (N, nu) motor positions                 (N, nu) motor rates         (N, nu) motor accelerations
    "tree"       (N, nq) q with closed loops             (N, nv) v                   (N, nv) a
    ============ ======================================= =========================== ===========================

    Kernels that were compiled for `wrenches` on k links take them after these, (N, 6 k) or (6 k,): [force; moment] on
    each link, at the origin of its frame, world axes, link by link. A wrench on the ground does nothing. Kernels that
    were compiled without take none. What spins an idle link that has no inertia has no answer; nor has it, in platform
    and motor coordinates, where it tells how the link stands, as of a thin rod that is round to six digits.

    Kernels that were compiled with `base_motion` take it by that name: a `dynamics.BaseMotion` for all states, one per
    state, or (N, 16) or (16,) of them: unit quaternion xyzw, twist, acceleration, all in inertial axes, which are those
    of the wrenches, too [rad, m/s, rad/s, m/s², rad/s²]. States stay relative to the ground. They take the way of the
    whole tree, and know no derivatives and no `single_state` of dynamics.

    What joints do by themselves (`with_joint_physics`) is in all verbs, as it was when the kernels were compiled; where
    armature, damping or friction of the model have been changed since, the verbs say so. Dry friction opposes the
    motion, of a joint at rest the one that `acceleration` starts; forward dynamics of a state in which a joint with dry
    friction is at rest has the code ``RESTING``: that is for the verb of one state. In platform and motor coordinates
    hinges with springs stand where the way from home leads, which a motion of several turns does not.

    Every verb takes, of the kernels' own type:

    ============== ===============================================================================================
    option         meaning
    ============== ===============================================================================================
    out            array for the result, a sequence of them where there are several; None makes them. Together with
                   `status` nothing is allocated where poses or whole states are taken as they are
    status         (N,) int8 array for the `StateStatus` of each state
    conditioning   (N,) array for the conditioning of each state, dimensionless: the smallest of the pivots that the
                   verb divides by, each relative to its median around home. Near one all digits are good, at 1e-6 six
                   of them are lost. Below 1e-6 (1e-4 in single precision) a state counts as singular, as for the
                   verbs of one state. Of configurations that are looked for, c, it is c² where that is less: they have
                   lost digits before
    threads        number of threads, each for a range of states; the results are the same, bit for bit
    ============== ===============================================================================================

    A verb that first has to look for the pose (motor coordinates) or the whole configuration (legs without closed form)
    does so by Newton steps from home, on the way there followed in stretches where a step leaves a doubt: the branch of
    home is kept. What is met on another branch alone has the code ``BRANCH_LOST``.

    Parameters
    ----------
    functions
        Functions of the chain.
    dtype
        numpy.float64 or numpy.float32.
    engine
        ``"llvm"``, ``"numpy"`` or None.

    Notes
    -----
    Pickles as the chain, and is written and compiled again where it is loaded.
    """

    def __repr__(self) -> str:
        return f"<Kernels of {self.chain.name!r} in {self.coordinates} coordinates, {self._dtype}>"

    def __reduce__(self) -> tuple[Any, ...]:
        made = (self.chain, self.coordinates, self._dtype, self._engine, self.wrenches, self.ground_moves)
        return _rebuilt, made

    @property
    def report(self) -> KernelReport:
        """How the kernels were made."""
        with writing():
            return self._report()

    def _report(self) -> KernelReport:
        functions = self._functions
        return KernelReport(
            coordinates=self.coordinates,
            wrenches=self.wrenches,
            route="tree" if functions.placed is None else "legs",
            why_tree=functions.why_whole_tree,
            freedoms=functions.freedoms,
            pivot_score=functions.pivot_score,
            blocks=plan_blocks(functions),
            operations={name: count_operations(function) for name, function in self._written.items()},
        )


def _rebuilt(
    chain: ClosedChain,
    coordinates: Any,
    dtype: DTypeLike,
    engine: Engine | None,
    wrenches: tuple[str, ...],
    ground_moves: bool,
) -> Kernels:
    from stewart_pin.kernels.graph.function_set import FunctionSet  # noqa: PLC0415 - needs CasADi

    functions = FunctionSet(chain, coordinates, wrenches=wrenches, ground_moves=ground_moves)
    return Kernels(functions, dtype, engine)


# ----------------------------------------------------------------------------------------------------
# How the kernels of a chain were made, in numbers
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class PlanBlock(Brief):
    """Equations that are eliminated together, always in the same order.

    Attributes
    ----------
    name
        "leg of" its first joint; "loops" of the whole tree; "loops and drive": with the rows of the coordinates.
    joints
        Kinds of the joints of a leg from its root, and of its ends behind a dash: R hinge, P slide, S ball.
    pivots
        ``(coordinate, equation)`` of each pivot, in order.
    score
        Smallest pivot relative to the largest entry of its column, over sampled states.
    smallest
        Smallest pivot relative to the largest entry of all, at the median of the sampled states.
    """

    name: str
    joints: str
    pivots: tuple[tuple[str, str], ...]
    score: float
    smallest: float

    def __str__(self) -> str:
        """Name, template, and how good the pivots are."""
        joints = f" {self.joints}" if self.joints else ""
        quality = f"smallest {self.score:.2g} of its column, {self.smallest:.2g} of all"
        return f"{self.name}{joints}: {len(self.pivots)} pivots, {quality}"


@dataclass(frozen=True, repr=False)
class KernelReport(Brief):
    """How the kernels of a chain were made.

    Attributes
    ----------
    coordinates
        ``"platform"``, ``"motor"`` or ``"tree"``.
    wrenches
        Links on which wrenches act from outside.
    route
        ``"legs"``: leg by leg, in closed form, in motor coordinates from a pose found by Newton steps; ``"tree"``: the
        whole tree, its configuration found by Newton steps.
    why_tree
        Why not leg by leg.
    freedoms
        Number of freedoms that the coordinates determine.
    pivot_score
        Smallest pivot relative to its column, over sampled states; near zero where a fixed order of elimination loses
        digits; infinite where nothing is eliminated.
    blocks
        What is eliminated, leg by leg or in one.
    operations
        Floating-point operations of each function that has been written.
    """

    coordinates: str
    wrenches: tuple[str, ...]
    route: str
    why_tree: str
    freedoms: int
    pivot_score: float
    blocks: tuple[PlanBlock, ...]
    operations: dict[str, int]

    def __str__(self) -> str:
        """One fact a line."""
        way = "leg by leg"
        if self.route == "tree":
            steps = "" if self.coordinates == "tree" else f" by Newton steps ({self.why_tree})"
            way = f"the whole tree{steps}"
        counts = [f"{name}: {count} operations" for name, count in self.operations.items()]
        loads = f", wrenches on {', '.join(self.wrenches)}" if self.wrenches else ""
        head = f"{self.freedoms} freedom(s) in {self.coordinates} coordinates, {way}{loads}"
        return "\n".join([head, *map(str, self.blocks), *counts])


def plan_blocks(functions: FunctionSet) -> tuple[PlanBlock, ...]:
    """List what the functions of a chain eliminate.

    Parameters
    ----------
    functions
        Functions of the chain.

    Returns
    -------
    tuple of PlanBlock
        A block a leg, or those of the whole tree.
    """
    if functions.placed is not None:
        return tuple(_leg_block(functions, leg) for leg in functions.placed.legs)
    chain = functions.chain
    rows, equations = chain.tangent_names, list(chain.loop_table.names)
    blocks = [_block("loops", "", functions.closed.reduced.pivots, rows, equations)] if chain.nc else []
    if functions.coordinates == "tree":
        return tuple(blocks)
    drive = [f"platform {axis}" for axis in TWIST_AXES]
    drive = drive if functions.coordinates == "platform" else list(chain.motors)
    pivots = functions.driven.reduced.pivots
    return (*blocks, _block("loops and drive", "", pivots, rows, [*equations, *drive]))


def _leg_block(functions: FunctionSet, placed: PlacedLeg) -> PlanBlock:
    leg, chain = placed.leg, functions.chain
    tree_joints = (
        [functions.placed.plan.tree.joints[body - 1] for body in leg.bodies] if functions.placed else []
    )
    entries = np.concatenate([np.arange(joint.v.start, joint.v.stop) for joint in tree_joints])
    letters = "".join(joint.kind.name[0] for joint in leg.joints)
    ends = "".join("R" if end.hinge is not None else "S" for end in leg.ends)
    equations = [f"{end.loop.name} {axis}" for end in leg.ends for axis in "xyz"]
    names = [chain.tangent_names[k] for k in entries]
    return _block(f"leg of {leg.name}", f"{letters}-{ends}", placed.reduced.pivots, names, equations)


def _block(
    name: str, joints: str, pivots: Pivots, rows: Sequence[str], equations: Sequence[str]
) -> PlanBlock:
    places = tuple((rows[i], equations[j]) for i, j in pivots.places)
    return PlanBlock(name, joints, places, pivots.score, min(pivots.sizes, default=1.0))


def count_operations(function: Any) -> int:
    """Count the floating-point operations of a CasADi function.

    Parameters
    ----------
    function
        `casadi.Function` of scalar symbols.

    Returns
    -------
    int
        Operations, without reading inputs and constants and writing outputs.
    """
    import casadi as ca  # noqa: PLC0415 - optional; there is a function already

    with writing():
        kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    return sum(kind not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST) for kind in kinds)


# ----------------------------------------------------------------------------------------------------
# From a chain to its verbs for arrays of states
# ----------------------------------------------------------------------------------------------------


def compile_kernels(
    chain: ClosedChain,
    *,
    coordinates: Literal["platform", "motor", "tree"] = "platform",
    wrenches: Sequence[str] = (),
    base_motion: bool = False,
    dtype: DTypeLike = np.float64,
    engine: Engine | None = None,
) -> Kernels:
    """Prepare the verbs of a chain for arrays of states.

    Parameters
    ----------
    chain
        Closed chain.
    coordinates
        ``"platform"``: states are poses, twists and accelerations of the platform; ``"motor"``: positions, rates and
        accelerations of the motors; ``"tree"``: q, v and a of the whole spanning tree, for any chain.
    wrenches
        Links on which something acts from outside, ``(chain.platform,)`` for example. The verbs of dynamics then take
        `wrenches` as a further array, (N, 6) or (6,) for each link in this order: see `Kernels`.
    base_motion
        Whether the ground moves, as a ship does. The verbs of dynamics then take `base_motion` as well: see `Kernels`.
    dtype
        numpy.float64 or numpy.float32, the type of every operation.
    engine
        ``"llvm"`` for machine code, ``"numpy"`` to interpret the same program; None takes llvm when it is installed.

    Returns
    -------
    Kernels
        The verbs; each is written and compiled when it is first called.

    Raises
    ------
    MissingExtraError
        If CasADi is not installed.
    UnsupportedError
        If the chain cannot be compiled, with the reason; or a wrench acts at a point that idle freedoms move, of which
        poses and motors do not tell where they stand; or a joint that they move has a spring, damping or friction.
    InputError
        If an option or a link is unknown, or a link is named twice.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> kernels = stp.compile_kernels(stp.load("stewart"))
    >>> pose, rest = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 6))
    >>> kernels.inverse_dynamics(pose, rest, rest).round(2)
    array([[49.99, 49.99, 49.99, 49.99, 49.99, 49.99]])

    >>> loaded, weight = stp.compile_kernels(stp.load("stewart"), wrenches=("platform",)), [0, 0, -60, 0, 0, 0]
    >>> loaded.inverse_dynamics(pose, rest, rest, weight).round(2)
    array([[60.52, 60.52, 60.52, 60.52, 60.52, 60.52]])
    """
    as_chain(chain)
    if coordinates not in ("platform", "motor", "tree"):
        raise InputError(f"coordinates must be 'platform', 'motor' or 'tree', got {coordinates!r}")
    try:
        from stewart_pin.kernels.graph.function_set import FunctionSet  # noqa: PLC0415 - needs CasADi
    except ImportError as error:
        if error.name != "casadi":
            raise
        raise MissingExtraError("casadi", "kernels") from None
    if not isinstance(base_motion, bool):
        raise InputError(
            f"base_motion must be True or False here, got {type(base_motion).__name__}; the verbs take the motions"
        )
    functions = FunctionSet(chain, coordinates, wrenches=_links(wrenches), ground_moves=base_motion)
    if as_real(dtype) == np.float32 and functions.rubs:
        raise UnsupportedError(
            f"joints of {chain.name} have dry friction, and float32 does not tell a joint at rest from one that moves "
            "beside faster ones; use dtype=float64"
        )
    return Kernels(functions, dtype, engine)


def _links(wrenches: Sequence[str]) -> tuple[str, ...]:
    """Take names of links, each once."""
    if isinstance(wrenches, str) or not isinstance(wrenches, Sequence):
        raise InputError(f"wrenches must be a sequence of names of links, as ('platform',), got {wrenches!r}")
    twice = [name for k, name in enumerate(wrenches) if name in wrenches[:k]]
    if twice:
        raise InputError(f"wrenches names {twice[0]!r} twice; give the sum of what acts on a link")
    return tuple(wrenches)
