"""How the kernels of a chain were made, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.state.freedom import TWIST_AXES

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet
    from stewart_pin.kernels.graph.legs import PlacedLeg
    from stewart_pin.kernels.planning.pivots import Pivots


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
        head = f"{self.freedoms} freedom(s) in {self.coordinates} coordinates, {way}"
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

    kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    return sum(kind not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST) for kind in kinds)
