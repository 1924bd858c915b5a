"""What of a motion is held while the geometry changes, and the conditions by which the rest follows.

Of the platform's motion as many components are held as it has freedoms, of the motors' as many motors, of a whole
state as many joint coordinates as are independent. With g the displacements, a motion obeys

    gap(q, g) = 0,   J(q, g) v = rates held,   J a + J̇ v = accelerations held,

loop rows above rows of what is held. All are chosen on samples.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.loop_gaps import loop_gaps
from stewart_pin.kernels.graph.platform_frame import platform_bias, platform_columns, platform_placement
from stewart_pin.kernels.graph.whole_tree import ClosedTree, motor_columns, tree_bias
from stewart_pin.kernels.planning.elimination import Elimination
from stewart_pin.kernels.planning.pivots import plan_pivots
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.typing import FloatArray

_ZERO = 1e-9
"""Singular values below this, in robot sizes and radians, are round-off."""
_NEARLY = 0.2
"""Share of the largest safety with which earlier coordinates are preferred: position before rotation."""
_CHOICES = 10_000
"""Largest number of choices that are compared."""


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """Independent rows of loops and of what is held, eliminated.

    Attributes
    ----------
    closed
        The chain as it is.
    names
        Readable name of each coordinate that is held.
    output
        (nv, n) transpose of the accelerations that forward dynamics gives.
    on_platform
        Whether the held rows, and those accelerations, depend on the geometry: those of the platform do.
    idle
        (nv, n) motions that neither loops nor what is held see; they carry no momentum.
    reduced
        Independent rows, transposed and eliminated.
    places
        Place of each of these rows among all loop rows and, after them, six rows of the platform; -1 for rows that
        the geometry does not change.
    """

    closed: ClosedTree
    names: tuple[str, ...]
    output: ca.SX
    on_platform: bool
    idle: ca.SX
    reduced: Elimination
    places: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of rows that may depend on the geometry."""
        return self.closed.tree.nc + 6 * self.on_platform

    def multipliers(self, right: ca.SX) -> ca.SX:
        """Solve the transposed rows.

        Parameters
        ----------
        right
            (nv, k) combinations of rows.

        Returns
        -------
        casadi.SX
            (size, k) the multipliers of the rows that may depend on the geometry.
        """
        found = self.reduced.back(self.reduced.forward(right), {})
        result = ca.SX.zeros(self.size, right.shape[1])
        for column, place in enumerate(self.places):
            if place >= 0:
                result[place, :] = found[column]
        return result


def hold(closed: ClosedTree, driven: DrivenTree | None) -> HeldMotion:
    """Hold the motion of what drives a chain, or that of its independent joint coordinates.

    Parameters
    ----------
    closed
        The chain, its loop rows eliminated.
    driven
        The same chain driven, or None: whole states are given.

    Returns
    -------
    HeldMotion
        The rows.

    Raises
    ------
    UnsupportedError
        If these rows are too nearly dependent.
    """
    tree, chain = closed.tree, closed.chain
    if driven is None:
        rows = ca.SX.eye(tree.nv)
        names, sizes, kept = chain.tangent_names, chain.tangent_scale, list(closed.reduced.pivots.rows)
        return _held(closed, rows, sizes, names, sorted(kept), False, ca.SX(tree.nv, 0))
    on_platform = driven.coordinates == "platform"
    if on_platform:
        names = tuple(f"platform {axis}" for axis in TWIST_AXES)
        sizes = np.repeat([chain.length_scale, 1.0], 3)
    else:
        names, sizes = chain.motors, chain.tangent_scale[list(tree.motors)]
    kept = _independent(closed, driven.drive, sizes)
    return _held(closed, driven.drive, sizes, names, kept, on_platform, driven.idle)


def hold_motors(closed: ClosedTree) -> HeldMotion:
    """Hold the motors of a chain whose whole state is given: what its idle freedoms do not change.

    Parameters
    ----------
    closed
        The chain, its loop rows eliminated.

    Returns
    -------
    HeldMotion
        The rows.

    Raises
    ------
    UnsupportedError
        If these rows are too nearly dependent.
    """
    tree, chain = closed.tree, closed.chain
    rows, sizes = motor_columns(tree), chain.tangent_scale[list(tree.motors)]
    kept = _independent(closed, rows, sizes)
    return _held(closed, rows, sizes, chain.motors, kept, False, ca.SX(tree.nv, 0))


def _independent(closed: ClosedTree, rows: ca.SX, sizes: FloatArray) -> list[int]:
    """Choose coordinates that together determine all, the first ones where these are nearly as safe as any others."""
    share = closed.values(closed.motions.T @ rows) * closed.motion_scale[:, None] / sizes
    rank = int(np.linalg.matrix_rank(share, tol=_ZERO).max())
    if rank == len(sizes):
        return list(range(rank))
    choices = list(itertools.islice(itertools.combinations(range(len(sizes)), rank), _CHOICES))
    safety = [np.linalg.svd(share[:, :, choice], compute_uv=False)[:, -1].min() for choice in choices]
    best = max(safety)
    return list(next(c for c, s in zip(choices, safety, strict=True) if s >= _NEARLY * best))


def _held(
    closed: ClosedTree,
    rows: ca.SX,
    sizes: FloatArray,
    names: tuple[str, ...],
    kept: list[int],
    on_platform: bool,
    idle: ca.SX,
) -> HeldMotion:
    chain = closed.chain
    loops = sorted(column for _, column in closed.reduced.pivots.places)
    matrix = ca.horzcat(closed.columns.transpose[:, loops], rows[:, kept])
    scale = np.concatenate([chain.row_sizes[loops], sizes[kept]])
    values = closed.values(matrix) * chain.tangent_scale[:, None] / scale
    pivots = plan_pivots(values, list(range(matrix.shape[1])))
    if pivots.columns:
        raise UnsupportedError(
            f"what would be held of {chain.name} ({', '.join(names[k] for k in kept)}) does not determine its motion "
            "to enough digits, so there are no derivatives by its geometry; use other coordinates"
        )
    reduced = Elimination(matrix, pivots)
    held = [chain.nc + k if on_platform else -1 for k in kept]
    return HeldMotion(
        closed, tuple(names[k] for k in kept), rows, on_platform, idle, reduced, (*loops, *held)
    )


def condition_columns(closed: ClosedTree, on_platform: bool) -> ca.SX:
    """Write all rows that may depend on the geometry.

    Parameters
    ----------
    closed
        The chain, as it is or displaced.
    on_platform
        Whether the platform's rows are among them.

    Returns
    -------
    casadi.SX
        (nv, nc or nc + 6) transpose of the rows.
    """
    loops = closed.columns.transpose
    return ca.horzcat(loops, platform_columns(closed)) if on_platform else loops


def condition_bias(closed: ClosedTree, on_platform: bool, v: ca.SX) -> ca.SX:
    """Write the accelerations of these rows that are there without joint acceleration.

    Parameters
    ----------
    closed
        The chain, as it is or displaced.
    on_platform
        Whether the platform's rows are among them.
    v
        (nv, 1) tangent velocity.

    Returns
    -------
    casadi.SX
        (nc or nc + 6, 1).
    """
    loops = tree_bias(closed, v)
    return ca.vertcat(loops, platform_bias(closed, v)) if on_platform else loops


def condition_gaps(displaced: ClosedTree, closed: ClosedTree, on_platform: bool) -> ca.SX:
    """Write how displacements open the loops and carry the platform away.

    Parameters
    ----------
    displaced
        The displaced chain.
    closed
        The chain as it is.
    on_platform
        Whether the platform's rows are among them.

    Returns
    -------
    casadi.SX
        (nc or nc + 6, 1) gaps of the rows as they are turned, and shift and rotation vector of the platform in world
        axes to the first order.
    """
    gaps = closed.columns.turn.T @ loop_gaps(displaced.tree, displaced.at, closed.q)
    if not on_platform:
        return gaps
    position, rotation = platform_placement(displaced)
    start, before = platform_placement(closed)
    turn = rotation @ before.T
    half = ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]) / 2
    return ca.vertcat(gaps, position - start, half)
