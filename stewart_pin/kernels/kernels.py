"""All verbs of a chain for arrays of states in one object."""

from __future__ import annotations

from typing import Any

from numpy.typing import DTypeLike

from stewart_pin.kernels.report import KernelReport, count_operations, plan_blocks
from stewart_pin.kernels.verbs.derivatives import DerivativeVerbs
from stewart_pin.kernels.verbs.dynamics import DynamicsVerbs
from stewart_pin.kernels.verbs.geometry import GeometryVerbs
from stewart_pin.kernels.verbs.kinematics import KinematicsVerbs
from stewart_pin.programs.array_kernel import Engine
from stewart_pin.state.chain import ClosedChain


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
        return _rebuilt, (self.chain, self.coordinates, self._dtype, self._engine)

    @property
    def report(self) -> KernelReport:
        """How the kernels were made."""
        functions = self._functions
        return KernelReport(
            coordinates=self.coordinates,
            route="tree" if functions.placed is None else "legs",
            why_tree=functions.why_whole_tree,
            freedoms=functions.freedoms,
            pivot_score=functions.pivot_score,
            blocks=plan_blocks(functions),
            operations={name: count_operations(function) for name, function in self._written.items()},
        )


def _rebuilt(chain: ClosedChain, coordinates: Any, dtype: DTypeLike, engine: Engine | None) -> Kernels:
    from stewart_pin.kernels.graph.function_set import FunctionSet  # noqa: PLC0415 - needs CasADi

    return Kernels(FunctionSet(chain, coordinates), dtype, engine)
