"""How the kernels of a chain were made, in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class KernelReport:
    """How the kernels of a chain were made.

    Attributes
    ----------
    coordinates
        ``"platform"``, ``"motor"`` or ``"tree"``.
    route
        ``"legs"``: leg by leg, in closed form; ``"tree"``: the whole tree, its configuration found by Newton steps.
    why_tree
        Why not leg by leg.
    freedoms
        Number of freedoms that the coordinates determine.
    pivot_score
        Smallest pivot relative to its column, over sampled states; near zero where a fixed order of elimination loses
        digits.
    operations
        Floating-point operations of each function that has been written.
    """

    coordinates: str
    route: str
    why_tree: str
    freedoms: int
    pivot_score: float
    operations: dict[str, int]

    def __str__(self) -> str:
        """One fact a line."""
        way = "leg by leg" if self.route == "legs" else f"the whole tree by Newton steps ({self.why_tree})"
        lines = [
            f"{self.freedoms} freedom(s) in {self.coordinates} coordinates, {way}",
            f"smallest pivot {self.pivot_score:.3g} of its column",
        ]
        return "\n".join(
            [*lines, *(f"{name}: {count} operations" for name, count in self.operations.items())]
        )


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
