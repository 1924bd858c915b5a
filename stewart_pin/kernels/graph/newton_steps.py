"""Steps of Newton's method towards a target, for any equations that give a gap and the move that closes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.kernels.planning.spatial import constant, shared
from stewart_pin.typing import FloatArray

_FORETOLD = 4000.0
"""Four times what the second move is expected to leave, on the scale on which a gap of 1e-11 is closed, so that 1e-14
of it must be left."""
_TINY = 1e-300
"""Added to a divisor that may be zero, and least contraction, since that carries a sign: nothing beside a move."""
_ROUND_OFF = 1e-6
"""Size of a move below which how much the next is smaller is round-off."""
_FAR = 2.4
"""Moves by which a state goes without a change of branch, to which a contraction of one belongs: sines are straight
for 0.6 radians, and a quarter is what a contraction may be."""
_HUGE = 1e300
"""Larger than any sum of numbers here: what is not below it is infinite, or no number."""
_CHANGED = 0.5
"""Change of the matrix, relative to itself, from which on a singularity may lie between two states: at one it is 1."""
_SMALLEST_SHARE = 1e-4
"""Share of Newton's step below which a search is given up."""


@dataclass(frozen=True, eq=False)
class Approach:
    """How a state comes as near as can be to a target that need not be within reach.

    Attributes
    ----------
    close
        Gives the displacement that does it to the first order, from a gap, all at the symbolic state.
    fit
        Gives the displacement that has certain rates of the gap, as nearly as can be in all its entries: where loops
        lose a row, what is asked for may still tell how they go on.
    direction
        (j,) a displacement that it may give, with no other direction special than those that it cannot [m or rad].
    """

    close: Callable[[ca.SX], ca.SX]
    fit: Callable[[ca.SX], ca.SX]
    direction: FloatArray


@dataclass(frozen=True, eq=False)
class NewtonEquations:
    """Equations between a state and a target.

    Attributes
    ----------
    state, target
        (n, 1) and (m, 1) symbols.
    gap
        (k, 1) what is to become zero, in the units of the equations.
    size
        (1, 1) or (j, 1) measure of the gap, in robot sizes and radians.
    close
        Gives the displacement that closes a gap to the first order, all at the symbolic state.
    move
        Displaces a state.
    sizes
        (j,) natural size of each entry of a displacement [m or rad].
    determinant
        (1, 1) changes its sign at singularities.
    direction
        (j,) a displacement that `close` may give, as in `Approach` [m or rad].
    approach
        For targets that need not be within reach; None where `close` does.
    """

    state: ca.SX
    target: ca.SX
    gap: ca.SX
    size: ca.SX
    close: Callable[[ca.SX], ca.SX]
    move: Callable[[ca.SX, ca.SX], ca.SX]
    sizes: FloatArray
    determinant: ca.SX
    direction: FloatArray
    approach: Approach | None = None


def damped_step(name: str, equations: NewtonEquations) -> ca.Function:
    """Write one trial of Newton's method with shorter steps where a full one does not lower the gap.

    A search knows the best state so far, the state on trial, Newton's step from the best, the size of its gap, and the
    share of the step that the trial took. Where the gap of the trial is smaller, it becomes the best, and the next
    trial takes a full step from there; else a quarter of the last share of the old step.

    Parameters
    ----------
    name
        Of the function.
    equations
        What to solve.

    Returns
    -------
    casadi.Function
        ``(search, target) -> (next, gap)``: a search is (2 n + steps + 2, 1), see above. The gap is the best so far,
        or zero for searches to be given up: their share has become too small to be worth a trial.
    """
    e = equations
    step = e.close(e.gap)
    n, k = e.state.shape[0], step.shape[0]
    tried = ca.Function("tried", [e.state, e.target], [step, ca.norm_inf(e.size), _is_number(e.size)])
    search = ca.SX.sym("search", 2 * n + k + 2)
    best, trial, old, least, share = ca.vertsplit(
        search, [0, n, 2 * n, 2 * n + k, 2 * n + k + 1, 2 * n + k + 2]
    )
    new, size, number = tried.call([trial, e.target])
    better = ca.logic_and(number, size < least)
    given_up = ca.logic_and(ca.logic_not(better), share <= _SMALLEST_SHARE)
    best = _chosen(better, trial, best)
    old, least = _chosen(better, new, old), _chosen(better, size, least)
    share = _chosen(better, ca.SX(1), share / 4)
    return shared(
        name,
        {"search": search, "target": e.target},
        {
            "next": ca.vertcat(best, e.move(best, share * old), old, least, share),
            "gap": ca.if_else(given_up, 0, least),
        },
    )


def _is_number(size: ca.SX) -> ca.SX:
    """Whether all entries are numbers: the largest may hide that others are not, their sum does not."""
    return ca.sum1(ca.fabs(size)) < _HUGE


def _chosen(condition: ca.SX, one: ca.SX, other: ca.SX) -> ca.SX:
    """Choose between vectors; what is not chosen need be no number."""
    pairs = zip(ca.vertsplit(one), ca.vertsplit(other), strict=True)
    return ca.vertcat(*(ca.if_else(condition, a, b) for a, b in pairs))


def double_step(name: str, equations: NewtonEquations) -> ca.Function:
    """Write a full step, and another from where it leads with the matrix of the first.

    The second needs no elimination of its own, and makes the order of convergence three: with c the curvature, a gap g
    becomes c g² and then 2 c² g³ (Potra and Pták, 1984). How much shorter it is than the first bounds the curvature: up
    to a quarter there is one solution in reach of the start and of every target on the way to this one (Newton and
    Kantorovich; Deuflhard, Newton Methods for Nonlinear Problems, 2011, section 2.1), so that the branch is kept.

    Parameters
    ----------
    name
        Of the function.
    equations
        What to solve.

    Returns
    -------
    casadi.Function
        ``(state, target, contraction) -> (next, gap, largest)``. The contraction is the largest so far, zero at first,
        or what a far move counts as, with the sign of the determinant, or 1 where that changes: straight on leads to
        another branch where two of them nearly meet. The gap is that between the moves, h, where it was g before them;
        or, if less, a thousand times the 4 h² / g that the second move may leave, twice what it is expected to.
    """
    e = equations
    worst = ca.SX.sym("contraction")
    first = e.close(e.gap)
    between = e.move(e.state, first)
    measured = ca.Function("gap", [e.state, e.target], [e.gap, ca.norm_inf(e.size), _is_number(e.size)])
    gap, size, number = measured.call([between, e.target])
    before = ca.norm_inf(e.size)
    foretold = _FORETOLD * size * size / (before + _TINY)
    second = e.close(gap)
    one, two = (ca.norm_inf(x / constant(e.sizes)) for x in (first, second))
    contraction = ca.fmax(ca.fmax(two / (one + _ROUND_OFF), one / _FAR), _TINY)
    turned = worst * e.determinant < 0
    signed = ca.if_else(turned, 1, ca.copysign(ca.fmax(ca.fabs(worst), contraction), e.determinant))
    return shared(
        name,
        {"state": e.state, "target": e.target, "contraction": worst},
        {
            "next": e.move(between, second),
            "gap": ca.if_else(number, ca.fmin(size, foretold), 1),
            "largest": signed,
        },
    )


def stretch_step(name: str, equations: NewtonEquations) -> ca.Function:
    """Write a double step towards a target between two others, which need not be within reach.

    What is solved for has closed where the moves end: a pose between two that a platform of few freedoms can take is
    none that it can take. It is approached in all its entries, as the verbs of one state do: of those that the pivots
    stand for, one may turn back, as a crank's height does, and no step would be left to take. Two singularities that
    are passed at once leave the sign of the determinant: it is also seen how the matrix changes by the first move.

    Parameters
    ----------
    name
        Of the function.
    equations
        What to solve.

    Returns
    -------
    casadi.Function
        As `double_step`; the gap is the second move, and where that is to come as near as can be both moves have a
        matrix of their own.
    """
    e, near = equations, equations.approach
    close, side = (e.close, e.determinant) if near is None else (near.close, ca.SX(1))
    fit = (lambda rates: -e.close(rates)) if near is None else near.fit
    worst = ca.SX.sym("contraction")
    first = close(e.gap)
    between = e.move(e.state, first)
    measured = ca.Function("gap", [e.state, e.target], [e.gap, side, close(e.gap)])
    gap, other_side, own = measured.call([between, e.target])
    # What is out of reach leaves a gap that the matrix of the first move does not see.
    second = close(gap) if near is None else own
    one, two = (ca.norm_inf(x / constant(e.sizes)) for x in (first, second))
    contraction = ca.fmax(ca.fmax(two / (one + _ROUND_OFF), one / _FAR), _TINY)
    turned = ca.logic_or(worst * side < 0, side * other_side < 0)
    turned = ca.logic_or(turned, _changed(e, between, fit, (e if near is None else near).direction))
    return shared(
        name,
        {"state": e.state, "target": e.target, "contraction": worst},
        {
            "next": e.move(between, second),
            "gap": ca.if_else(_is_number(second), two, 1),
            "largest": ca.if_else(turned, 1, ca.copysign(ca.fmax(ca.fabs(worst), contraction), side)),
        },
    )


def _changed(e: NewtonEquations, other: ca.SX, fit: Callable[[ca.SX], ca.SX], direction: FloatArray) -> ca.SX:
    """Whether the matrix at another state is so different that a singularity may lie on the way there.

    With M the matrix here and M' that there, C = M⁻¹ M' - 1 has an eigenvalue beyond -1 for every singularity on the
    way. Applied twice to any direction it shows the largest one, others being small as the way is short.
    """
    along, eps = ca.SX.sym("along", len(e.sizes)), ca.SX.sym("eps")
    gap = ca.Function("gap", [e.state, e.target], [e.gap])
    moved = ca.jacobian(gap.call([e.move(e.state, eps * along), e.target])[0], eps)
    rates = ca.Function("rates", [e.state, e.target, along], [ca.substitute(moved, eps, ca.SX(0))])

    def change(x: ca.SX) -> ca.SX:
        return fit(rates.call([other, e.target, x])[0]) - x

    once = change(constant(direction))
    twice = change(once)
    square, before = (ca.sumsqr(x / constant(e.sizes)) for x in (twice, once))
    least = _ROUND_OFF**2 * float(np.sum((direction / e.sizes) ** 2))
    return ca.logic_and(square > _CHANGED**2 * before, before > least)


def any_direction(sizes: FloatArray, basis: FloatArray | None = None) -> FloatArray:
    """Draw a displacement.

    Parameters
    ----------
    sizes
        (j,) natural size of each entry [m or rad].
    basis
        (j, k) of the displacements that there are, in natural units; None for all, dimensionless.

    Returns
    -------
    numpy.ndarray
        (j,) always the same [m or rad].
    """
    rng = np.random.default_rng(0)
    entries = rng.normal(size=len(sizes)) if basis is None else basis @ rng.normal(size=basis.shape[1])
    return sizes * entries
