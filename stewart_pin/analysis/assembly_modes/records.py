"""What the search for all poses answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stewart_pin.brief import Brief
from stewart_pin.typing import FloatArray

Kind = Literal["finite", "positive-dimensional"]


@dataclass(frozen=True, eq=False, repr=False)
class AssemblyModes(Brief):
    """All real poses of a six-legged platform for six leg lengths, highest platform first.

    Attributes
    ----------
    position
        (n, 3) platform origins in the base frame [m].
    rotation
        (n, 3, 3) platform axes in the base frame.
    residual
        (n,) greatest leg-length error of each pose [m].
    certified
        (n,) mask: a solution next to the pose is proven to exist, and to be the only one there.
    n_complex
        Number of different finite complex solutions found, the real ones included.
    kind
        ``"finite"``, or ``"positive-dimensional"`` when the equations hold along a curve: the platform
        moves with all legs locked. The poses are then the isolated ones only.
    complete
        Whether every path was accounted for: the number of solutions is the generic one, or two searches from
        unrelated start systems agree and none of their paths failed. False means that poses may be missing, or
        that one which is nearly double has been counted twice.
    expected
        Finite complex solutions, with multiplicity, that the paths account for; the generic number of the
        geometry when that is known.
    failed_paths
        Paths of the last search whose end could not be decided.
    searches
        Start systems that were used.
    """

    position: FloatArray
    rotation: FloatArray
    residual: FloatArray
    certified: NDArray[np.bool_]
    n_complex: int
    kind: Kind
    complete: bool
    expected: int
    failed_paths: int
    searches: int

    def __len__(self) -> int:
        return len(self.position)
