"""States at which a chain's matrices are looked at before its kernels are written."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.generic import regularity
from stewart_pin.state.newton import close_loops
from stewart_pin.typing import Configuration, FloatArray

_REGULAR = 1e-3
"""Share of the usual regularity that a home must have for pivots to be chosen on it."""
_SPREAD, _SPREAD_BESIDE = 0.15, 0.03
"""Largest displacement of a joint from home, and from a configuration far from it, in robot sizes and radians."""


def closed_samples(
    chain: ClosedChain, *, count: int = 8, seed: int = 0, around: Configuration | None = None
) -> FloatArray:
    """Draw configurations with closed loops around home, or around another.

    Parameters
    ----------
    chain
        Closed chain.
    count
        How many.
    seed
        Of the displacements.
    around
        (nq,) configuration instead of home [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (count, nq) configurations [m, rad, unit quaternions]; home itself, often symmetric, is not among them.

    Raises
    ------
    UnsupportedError
        If the loops close at no displacement.
    """
    rng = np.random.default_rng(seed)
    found: list[FloatArray] = []
    spread, centre = (_SPREAD, chain.q_home) if around is None else (_SPREAD_BESIDE, around)
    for _ in range(20 * count):
        step = rng.uniform(-spread, spread, chain.nv) * chain.tangent_scale
        closure = close_loops(chain, pin.integrate(chain.model, centre, step), throw=False)
        if closure.success:
            found.append(closure.q)
        else:
            spread *= 0.9
        if len(found) == count:
            return np.array(found)
    raise UnsupportedError(
        f"the loops of {chain.name} close at {len(found)} of {20 * count} displacements of home; "
        "kernels need closed states to look at"
    )


def pivot_samples(chain: ClosedChain, around: Configuration | None = None) -> FloatArray:
    """Return the configurations on which pivots are chosen: around home, and home itself where it is regular.

    Parameters
    ----------
    chain
        Closed chain.
    around
        (nq,) regular configuration instead of home [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (samples, nq) configurations with closed loops [m, rad, unit quaternions].
    """
    samples, centre = closed_samples(chain, around=around), chain.q_home if around is None else around
    return np.vstack([samples, centre]) if regularity(chain.at(centre)) >= _REGULAR else samples


def at_samples(inputs: Sequence[ca.SX], samples: Sequence[FloatArray], matrix: ca.SX) -> FloatArray:
    """Evaluate a matrix of expressions at samples.

    Parameters
    ----------
    inputs
        (n, 1) symbols each.
    samples
        (samples, n) values of each input, in any unit.
    matrix
        (m, n) expressions.

    Returns
    -------
    numpy.ndarray
        (samples, m, n) values, in the same unit as the matrix.
    """
    function = ca.Function("sample", list(inputs), [ca.densify(matrix)])
    rows = zip(*samples, strict=True)
    return np.array([np.array(function(*row)).reshape(matrix.shape) for row in rows])
