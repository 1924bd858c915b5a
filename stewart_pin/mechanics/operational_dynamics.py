r"""Maps from the rates of chosen coordinates to the whole chain, and its equation of motion in these coordinates.

With v = G x_rate + R w, where R spans the motions that the coordinates leave at rest, and Rᵀ M G = 0, the equation
of motion of the spanning tree times Gᵀ loses loop reactions and idle freedoms:

.. math:: M_x \ddot x + C_x \dot x + g_x = (S G)^\top \tau + G^\top \sum J_f^\top w_f, \qquad M_x = G^\top M G, \quad
          C_x = G^\top (M \dot G + C G), \quad g_x = G^\top g,

where C is the Coriolis matrix of the tree with :math:`\dot M = C + C^\top`, hence :math:`\dot M_x = C_x + C_x^\top`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from stewart_pin.brief import Brief
from stewart_pin.errors import ActuationError, SingularityError
from stewart_pin.mechanics.coordinates import (
    CoordinateChoice,
    Coordinates,
    choose_coordinates,
    rows_bias,
    rows_rate,
)
from stewart_pin.mechanics.inverse_dynamics import require_idle_inertia
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import OwnMotion, split_motions
from stewart_pin.state.outside import Wrenches, as_wrenches, given_efforts
from stewart_pin.state.state import State, as_state, named_motion
from stewart_pin.tolerances import SHOWN, SINGULAR
from stewart_pin.typing import ArrayLike, FloatArray, Tangent

# ----------------------------------------------------------------------------------------------------
# Explicit maps from the rates of chosen coordinates to the motion of the whole chain
#
# With J_c the loop Jacobian and A the rows of the coordinates, :math:`\dot x = A v`, the map G solves
#
# .. math:: J_c G = 0, \qquad A G = 1, \qquad R^\top M G = 0,
#
# where R spans the motions that the coordinates leave at rest: idle freedoms, for motors that hold the robot. The last
# equation says that these carry no momentum of their own, so that they drop out of the equation of motion; see
# `stewart_pin.state.freedom`.
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class MotionMap(Brief):
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
        (nv,) acceleration that is there without acceleration of the coordinates: centripetal, and what weight, inertia
        and wrenches from outside do to the motions at rest [m/s², rad/s²].
    share
        (nu, n) motor rates per coordinate rate; its transpose turns motor efforts into the effort of each coordinate
        [m/s or rad/s per m/s or rad/s].
    rest
        (nv, k) motions that the coordinates leave undetermined, orthonormal with lengths in robot sizes [m, rad].
        Each follows its own inertia; with one that has none, as the spin of a massless leg, the links turn least.
    """

    coordinates: Coordinates
    rate: FloatArray
    G: FloatArray
    gamma: Tangent
    share: FloatArray
    rest: FloatArray


def motion_map(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    *,
    coordinates: CoordinateChoice = "motor",
) -> MotionMap:
    """Find the explicit map from coordinate rates to the motion of the whole chain, and its bias.

    Idle freedoms, which no coordinate drives, follow their own inertia as in `inverse_dynamics`: G lets them carry no
    momentum, and ``gamma`` holds what weight, gyroscopic effects, springs, damping and dry friction of moving joints
    make them do.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
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
        do, and proposes independent ones. If joints push an idle freedom that has no inertia.
    InputError
        If the state does not keep the loops closed, or the coordinates are unknown.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> found = stp.dynamics.motion_map(chain, chain.q_home)
    >>> found.G.shape, bool(np.abs(stp.loop_jacobian(chain, chain.q_home) @ found.G).max() < 1e-12)
    ((24, 6), True)
    """
    state = as_state(chain, q, v)
    solved, own = SolvedMap(state, coordinates), given_efforts(state, None)
    if own is not None:
        require_idle_inertia(state, own)
    return solved.record(own)


class SolvedMap:
    """The map in natural units, with what its derivative needs.

    Parameters
    ----------
    state
        State.
    coordinates
        As in `motion_map` [m/s, rad/s].
    """

    def __init__(self, state: State, coordinates: CoordinateChoice) -> None:
        chain = state.require_moving().chain
        self.chain, self.state = chain, state
        self.chosen = choose_coordinates(state, coordinates)
        self.scale = chain.tangent_scale
        self.inertia = state.inertia
        self.rest = np.zeros((chain.nv, 0))
        count = len(self.chosen.names)
        if self.chosen.kind == "motor" and state.drive is not None:
            self._drive, self.G = state.drive, state.motor_motions
            return
        self._drive = None
        rows = self.chosen.rows * self.scale / self.chosen.sizes[:, None]
        free = state.motions.basis
        seen = rows @ free
        values = np.linalg.svd(seen, compute_uv=False)
        if count > free.shape[1] or (count and values[count - 1] < SINGULAR):
            raise _dependent(chain, self.chosen, seen, int(np.count_nonzero(values >= SINGULAR)))
        self._rows, self._seen = rows, split_motions(seen, count)
        self.rest = free @ self._seen.basis
        if self.chosen.kind != "platform" and self.rest.shape[1] > chain.generic.count.idle:
            raise _undetermined(state, self.chosen, self.rest)
        self._own = OwnMotion(state, self.rest)
        self.G = self._own.velocity(free @ self._seen.across(np.eye(count)))

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
        chain, nc = self.chain, self.chain.nc
        sizes = np.concatenate([chain.row_sizes, self.chosen.sizes])
        scaled = demand / (sizes if demand.ndim == 1 else sizes[:, None])
        if self._drive is not None:
            return self._drive.across(scaled[:nc]) + self.G @ scaled[nc:]
        across = self.state.motions.across(scaled[:nc])
        return across + self.state.motions.basis @ self._seen.across(scaled[nc:] - self._rows @ across)

    def record(self, pushed: FloatArray | None = None) -> MotionMap:
        """Return the map in the robot's own units.

        Parameters
        ----------
        pushed
            (nv,) joint efforts of wrenches from outside and of joints by themselves, or None [N, N m].

        Returns
        -------
        MotionMap
            With bias.
        """
        chain, state, chosen = self.chain, self.state, self.chosen
        column = self.scale[:, None]
        G = column * self.G / chosen.sizes
        bias = np.concatenate([state.loop_bias, rows_bias(state, chosen)])
        gamma = self.follow(-bias)
        if self.rest.shape[1]:
            gamma = self._own.acceleration(gamma, pushed)
        return MotionMap(
            coordinates=chosen,
            rate=chosen.rows @ state.v,
            G=G,
            gamma=self.scale * gamma,
            share=G[chain.motor_index],
            rest=column * self.rest,
        )


def _undetermined(state: State, chosen: Coordinates, rest: FloatArray) -> ActuationError:
    chain = state.chain
    idle = state.freedom.idle / chain.tangent_scale[:, None]
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


def _dependent(chain: ClosedChain, chosen: Coordinates, seen: FloatArray, rank: int) -> SingularityError:
    u, s, _ = np.linalg.svd(seen)
    direction = u[:, -1] / np.abs(u[:, -1]).max()
    pivots = np.asarray(scipy.linalg.qr(seen.T, mode="r", pivoting=True)[-1])
    independent = [chosen.names[k] for k in sorted(pivots[:rank])]
    relation = " ".join(
        f"{x:+.3g}·{name}" for x, name in zip(direction, chosen.names, strict=True) if abs(x) > SHOWN
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


# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class OperationalDynamics(Brief):
    """M x_acceleration + c + g = w + effort of each coordinate.

    Motor coordinates have the motor efforts on the right, platform coordinates the wrench (or its components along
    the basis), any coordinates ``motion.share.T @ tau_motor``.

    Attributes
    ----------
    motion
        The map that stands behind it, with the coordinates and their rates.
    M
        (n, n) inertia, symmetric [kg, kg m, kg m²].
    C
        (n, n) Coriolis matrix; the rate of M is C + Cᵀ, so M's rate less 2 C is skew [kg/s, kg m/s, kg m²/s].
    c
        (n,) Coriolis and centrifugal efforts: ``C @ motion.rate``, and what idle freedoms that turn add [N or N m].
    g
        (n,) efforts against gravity [N or N m].
    w
        (n,) what wrenches from outside, springs, damping and dry friction of moving joints add to the efforts; zero
        without [N or N m].
    """

    motion: MotionMap
    M: FloatArray
    C: FloatArray
    c: FloatArray
    g: FloatArray
    w: FloatArray


def operational_dynamics(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    *,
    coordinates: CoordinateChoice = "motor",
    wrenches: Wrenches | None = None,
) -> OperationalDynamics:
    """Write the equation of motion of a chain in motor, joint or platform coordinates.

    Parameters
    ----------
    chain
        Closed chain, or a state of it; redundant loops and idle freedoms are no special case.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed; default: rest [m/s, rad/s].
    coordinates
        As in `motion_map` [m/s, rad/s].
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics` [N, N m].

    Returns
    -------
    OperationalDynamics
        Inertia, Coriolis matrix and efforts, gravity efforts, and those of wrenches and of the joints themselves.

    Raises
    ------
    ActuationError
        If motors or joints do not determine the motion; carries the freedom left over.
    SingularityError
        If the coordinates depend on each other; proposes independent ones. If wrenches push an idle freedom that has no
        inertia.
    InputError
        If the state does not keep the loops closed, or the coordinates are unknown.

    Notes
    -----
    The equation holds whatever acts on the motions in ``motion.rest``, because G is orthogonal to them in the metric
    of the inertia. With a redundant arm's twist as coordinates, M is the operational-space inertia of [1]_.

    References
    ----------
    .. [1] O. Khatib, "A unified approach for motion and force control of robot manipulators: the operational space
       formulation", IEEE Journal on Robotics and Automation 3(1), 1987, eq. (50).

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> stp.operational_dynamics(chain, chain.q_home).g.round(2)  # what the legs carry
    array([49.99, 49.99, 49.99, 49.99, 49.99, 49.99])
    """
    state = as_state(chain, q, v)
    solved = SolvedMap(state, coordinates)
    pushed = given_efforts(state, as_wrenches(state.chain, wrenches))
    require_idle_inertia(state, pushed)
    motion, scale, sizes = solved.record(pushed), solved.scale, solved.chosen.sizes
    coriolis = scale[:, None] * state.coriolis * scale
    G, inertia = solved.G, solved.inertia
    own = scale[:, None] * G
    turning = np.concatenate([state.J_c_rate @ own, rows_rate(state, solved.chosen) @ own])
    # Up to motions of the rest, which M G does not see: Gᵀ M R = 0.
    G_rate = solved.follow(-turning)

    across = np.outer(sizes, sizes)
    M = G.T @ inertia @ G / across
    inertial = inertia @ (motion.gamma / scale)
    return OperationalDynamics(
        motion=motion,
        M=(M + M.T) / 2,
        C=G.T @ (inertia @ G_rate + coriolis @ G) / across,
        c=G.T @ (inertial + scale * (state.nle - state.weight)) / sizes,
        g=motion.G.T @ state.weight,
        w=np.zeros(M.shape[0]) if pushed is None else motion.G.T @ pushed,
    )
