"""Steps of Newton's method towards a target, for any equations that give a gap and the move that closes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from stewart_pin.kernels.graph.functions import shared

_FORETOLD = 4000.0
"""Four times what the second move is expected to leave, on the scale on which a gap of 1e-11 is closed, so that 1e-14
of it must be left."""
_TINY = 1e-300


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
    """

    state: ca.SX
    target: ca.SX
    gap: ca.SX
    size: ca.SX
    close: Callable[[ca.SX], ca.SX]
    move: Callable[[ca.SX, ca.SX], ca.SX]


def damped_step(name: str, equations: NewtonEquations) -> ca.Function:
    """Write a share of one step.

    Parameters
    ----------
    name
        Of the function.
    equations
        What to solve.

    Returns
    -------
    casadi.Function
        ``(state, target, share) -> (next, gap)``; the gap is the size of that before the step.
    """
    e, share = equations, ca.SX.sym("share")
    following = e.move(e.state, share * e.close(e.gap))
    return shared(
        name,
        {"state": e.state, "target": e.target, "share": share},
        {"next": following, "gap": e.size},
    )


def double_step(name: str, equations: NewtonEquations) -> ca.Function:
    """Write a full step, and another from where it leads with the matrix of the first.

    The second needs no elimination of its own, and makes the order of convergence three: with c the curvature, a gap g
    becomes c g² and then 2 c² g³ (Potra and Pták, 1984).

    Parameters
    ----------
    name
        Of the function.
    equations
        What to solve.

    Returns
    -------
    casadi.Function
        ``(state, target) -> (next, gap)``. The gap is that between the moves, h, where it was g before them; or, if
        less, a thousand times the 4 h² / g that the second move may leave, twice what it is expected to.
    """
    e = equations
    between = e.move(e.state, e.close(e.gap))
    measured = ca.Function("gap", [e.state, e.target], [e.gap, ca.norm_inf(e.size)])
    gap, size = measured.call([between, e.target])
    before = ca.norm_inf(e.size)
    foretold = _FORETOLD * size * size / (before + _TINY)
    return shared(
        name,
        {"state": e.state, "target": e.target},
        {"next": e.move(between, e.close(gap)), "gap": ca.fmin(size, foretold)},
    )
