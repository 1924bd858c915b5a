r"""Explicit maps from the rates of chosen coordinates to the motion of the whole chain.

With J_c the loop Jacobian and A the rows of the coordinates, :math:`\dot x = A v`, the map G solves

.. math:: J_c G = 0, \qquad A G = 1, \qquad R^\top M G = 0,

where R spans the motions that the coordinates leave at rest: idle freedoms, for motors that hold the robot. The last
equation says that these carry no momentum of their own, so that they drop out of the equation of motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy.linalg

from stewart_pin.closure.equations import row_sizes
from stewart_pin.closure.newton import RANK
from stewart_pin.errors import ActuationError, SingularityError
from stewart_pin.mechanics.constrained import (
    NO_INERTIA,
    ClosedState,
    closed_state,
    joint_space_inertia,
    named_motion,
)
from stewart_pin.mechanics.coordinates import Coordinates, choose_coordinates, rows_bias
from stewart_pin.mechanics.freedom import Freedom, analyse_freedom, null_space
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class MotionMap:
    """How the whole chain moves when its coordinates move: v = G x_rate, a = G x_acceleration + gamma.

    Attributes
    ----------
    coordinates
        What x is.
    rate
        (n,) x_rate of the velocity given [m/s or rad/s].
    G
        (nv, n) tangent velocity per coordinate rate, ``loop_jacobian @ G = 0`` [m/s or rad/s per m/s or rad/s].
    gamma
        (nv,) acceleration that is there without acceleration of the coordinates: centripetal, and what weight and
        inertia do to the motions at rest [m/s², rad/s²].
    share
        (nu, n) motor rates per coordinate rate; its transpose turns motor efforts into the effort of each coordinate
        [m/s or rad/s per m/s or rad/s].
    rest
        (nv, k) motions that the coordinates leave undetermined, orthonormal with lengths in robot sizes [m, rad].
        Each follows its own inertia; one without inertia, as the spin of a massless leg, gets the least motion.
    """

    coordinates: Coordinates
    rate: FloatArray
    G: FloatArray
    gamma: Tangent
    share: FloatArray
    rest: FloatArray


def motion_map(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike | None = None,
    *,
    coordinates: str | Sequence[str] | ArrayLike = "motor",
) -> MotionMap:
    """Find the explicit map from coordinate rates to the motion of the whole chain, and its bias.

    Idle freedoms, which no coordinate drives, follow their own inertia as in `inverse_dynamics`: G lets them carry no
    momentum, and ``gamma`` holds what weight and gyroscopic effects make them do.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed; default: rest [m/s, rad/s].
    coordinates
        ``"motor"``: all motors. ``"platform"``: the twist [v; ω] of the platform origin in world axes; of fewer
        freedoms, the axes or the basis of twists that `Coordinates.basis` tells. A list of joint names: these, for
        instance as many of redundant motors as there are freedoms. (6, n) twists: the amounts of these
        [m/s, rad/s].

    Returns
    -------
    MotionMap
        The map. In platform coordinates motors may move with the platform at rest (a redundant arm): ``rest`` holds
        these motions, taken as free.

    Raises
    ------
    ActuationError
        If motors or joints do not determine the motion; carries the freedom left over.
    SingularityError
        If the coordinates depend on each other (more motors than freedoms, or a singular configuration); says which
        do, and proposes independent ones.
    InputError
        If the state does not keep the loops closed, or the coordinates are unknown.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> found = stp.motion_map(chain, chain.q_home)
    >>> found.G.shape, bool(np.abs(stp.loop_jacobian(chain, chain.q_home) @ found.G).max() < 1e-12)
    ((24, 6), True)
    """
    state = closed_state(chain, q, np.zeros(chain.nv) if v is None else v)
    return SolvedMap(chain, state, coordinates).record()


class SolvedMap:
    """The map in robot sizes, with what its derivative needs.

    Parameters
    ----------
    chain
        Closed chain.
    state
        Checked state.
    coordinates
        As in `motion_map` [m/s, rad/s].
    """

    def __init__(
        self, chain: ClosedChain, state: ClosedState, coordinates: str | Sequence[str] | ArrayLike
    ) -> None:
        self.chain, self.state, self.data = chain, state, pin.Data(chain.model)
        freedom = analyse_freedom(chain, state.q)
        self.chosen = choose_coordinates(chain, state.q, freedom, coordinates)
        self.scale = chain.tangent_scale
        self.sizes = np.concatenate([row_sizes(chain), self.chosen.sizes])
        self.matrix = np.vstack([state.jacobian, self.chosen.rows]) * self.scale / self.sizes[:, None]
        self.inertia = self.scale[:, None] * joint_space_inertia(chain, self.data, state.q) * self.scale
        free = freedom.motions / self.scale[:, None]
        seen = self.matrix[chain.nc :] @ free
        resting, rank = null_space(seen)
        if rank < len(self.chosen.names):
            raise _dependent(chain, self.chosen, free, seen)
        self.rest = free @ resting
        if self.chosen.kind != "platform" and self.rest.shape[1] > freedom.idle.shape[1]:
            raise _undetermined(chain, self.chosen, self.rest, freedom)
        moments, axes = np.linalg.eigh(self.rest.T @ self.inertia @ self.rest)
        heavy = moments > NO_INERTIA * np.abs(self.inertia).max(initial=0.0)
        axes = axes[:, heavy]
        self._compliance = axes @ (axes.T / moments[heavy, None])
        least = free @ np.linalg.pinv(seen, rcond=RANK)
        self.G = self.without_momentum(least)

    def without_momentum(self, motion: FloatArray, momentum: FloatArray | float = 0.0) -> FloatArray:
        """Add the motion of `rest` that brings its momentum (or its balance of forces) to a value.

        Parameters
        ----------
        motion
            (nv,) or (nv, n) in robot sizes, dimensionless.
        momentum
            What Rᵀ M motion shall be [kg m²].

        Returns
        -------
        numpy.ndarray
            Like `motion`, dimensionless.
        """
        return motion + self.rest @ (self._compliance @ (momentum - self.rest.T @ (self.inertia @ motion)))

    def follow(self, demand: FloatArray) -> FloatArray:
        """Least motion that gives loop rows and coordinates what is asked, lengths in robot sizes.

        Parameters
        ----------
        demand
            (nc + n,) or (nc + n, k) rates of loop rows and coordinates [m/s, rad/s].

        Returns
        -------
        numpy.ndarray
            (nv,) or (nv, k) motion, dimensionless.
        """
        sizes = self.sizes if demand.ndim == 1 else self.sizes[:, None]
        return np.linalg.lstsq(self.matrix, demand / sizes, rcond=RANK)[0]

    def record(self) -> MotionMap:
        """Return the map in the robot's own units.

        Returns
        -------
        MotionMap
            With bias.
        """
        chain, state, chosen = self.chain, self.state, self.chosen
        column = self.scale[:, None]
        G = column * self.G / chosen.sizes
        bias = np.concatenate([state.bias, rows_bias(chain, state.q, state.v, chosen)])
        pull = pin.nonLinearEffects(chain.model, self.data, state.q, state.v) * self.scale
        gamma = self.without_momentum(self.follow(-bias), -(self.rest.T @ pull))
        return MotionMap(
            coordinates=chosen,
            rate=chosen.rows @ state.v,
            G=G,
            gamma=self.scale * gamma,
            share=G[chain.motor_index],
            rest=column * self.rest,
        )


def _undetermined(
    chain: ClosedChain, chosen: Coordinates, rest: FloatArray, freedom: Freedom
) -> ActuationError:
    idle = freedom.idle / chain.tangent_scale[:, None]
    left = rest - idle @ (idle.T @ rest)
    u, s, _ = np.linalg.svd(left, full_matrices=False)
    direction = u[:, 0] * chain.tangent_scale
    direction = direction / np.abs(direction).max()
    count = int(np.count_nonzero(s > 0.5))  # cosines of a projection: 0 or 1
    return ActuationError(
        f"the {chosen.kind} coordinates {', '.join(chosen.names)} do not determine how the robot moves: {count} "
        f"freedom(s) left over, the motion {named_motion(chain, direction)}; add a motor or a joint that moves in it",
        smallest_singular_value=0.0,
        direction=direction,
        names=chain.tangent_names,
    )


def _dependent(
    chain: ClosedChain, chosen: Coordinates, free: FloatArray, seen: FloatArray
) -> SingularityError:
    u, s, _ = np.linalg.svd(seen)
    rank = int(np.count_nonzero(s > RANK * max(s[0], RANK))) if s.size else 0
    direction = u[:, -1] / np.abs(u[:, -1]).max()
    pivots = np.asarray(scipy.linalg.qr(seen.T, mode="r", pivoting=True)[-1])
    independent = [chosen.names[k] for k in sorted(pivots[:rank])]
    relation = " ".join(
        f"{x:+.3g}·{name}" for x, name in zip(direction, chosen.names, strict=True) if abs(x) > 1e-6
    )
    remedy = (
        f"pass coordinates={independent}"
        if chosen.kind != "platform" and independent
        else "pass fewer twists"
    )
    return SingularityError(
        f"the coordinates {', '.join(chosen.names)} are {len(chosen.names)}, but only {rank} of them move "
        f"independently here ({relation} stays at rest, coordinates in robot sizes); {remedy}, or move away from "
        "this configuration",
        smallest_singular_value=float(s[-1]) if len(s) == len(chosen.names) else 0.0,
        direction=direction,
        names=chosen.names,
    )
