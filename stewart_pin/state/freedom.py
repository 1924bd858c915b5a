"""Which motions the loops leave, which of them the motors hold, and which move nothing that matters.

N spans the motions that keep the loops closed (J_c N = 0); of these, the ones with locked motors are *idle* when the
platform rests, and a *lost* freedom when it moves. How many there are of each belongs to the mechanism and was found
once (`Generic`); at a state exactly as many directions are taken, the largest singular values first. What lies beyond
them is what round-off and printed digits left open; what comes near zero within them is a singularity. All
decompositions see natural units, so that the unit of length decides nothing. How idle motions go is settled below.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.errors import ActuationError, InputError
from stewart_pin.tolerances import NO_INERTIA, SINGULAR
from stewart_pin.typing import FloatArray

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain
    from stewart_pin.state.state import State


TwistAxis = Literal["vx", "vy", "vz", "wx", "wy", "wz"]
TWIST_AXES: tuple[TwistAxis, ...] = get_args(TwistAxis)
"""Components of the platform's twist, in world axes."""


@dataclass(frozen=True, repr=False)
class FreedomCount(Brief):
    """Numbers of motions at one configuration, or at the usual ones.

    Attributes
    ----------
    dof
        Independent motions that keep the loops closed.
    motor
        How many independent ways the motors move.
    platform
        How many independent ways the platform moves.
    either
        How many independent ways motors and platform move, taken together.
    axes
        Components of the twist that count as motion of the platform, of `TWIST_AXES`.
    """

    dof: int
    motor: int
    platform: int
    either: int
    axes: tuple[str, ...] = TWIST_AXES

    @property
    def uncontrolled(self) -> int:
        """Motions of the platform while all motors are at rest."""
        return self.either - self.motor

    @property
    def inner(self) -> int:
        """Motions of the motors while the platform is at rest."""
        return self.either - self.platform

    @property
    def idle(self) -> int:
        """Motions while motors and platform are at rest."""
        return self.dof - self.either


@dataclass(frozen=True, eq=False)
class Motions:
    """The loop rows in natural units, split by the rank of the mechanism: J_c = U s Vᵀ.

    Attributes
    ----------
    basis
        (nv, dof) orthonormal motions that keep the loops closed, N, dimensionless.
    redundant
        (nc, nc - rank) orthonormal combinations of rows that follow from the others, dimensionless.
    values
        (rank,) singular values that belong to the mechanism, dimensionless.
    left
        (nc, rank) their left singular vectors, dimensionless.
    right
        (rank, nv) their right singular vectors, dimensionless.
    """

    basis: FloatArray
    redundant: FloatArray
    values: FloatArray
    left: FloatArray
    right: FloatArray

    @property
    def smallest(self) -> float:
        """Smallest singular value that belongs to the mechanism: near zero at a singularity of the loops."""
        return float(self.values[-1]) if self.values.size else np.inf

    @property
    def gained(self) -> FloatArray:
        """(nv,) the motion that the loops resist least, dimensionless."""
        return self.right[-1]

    def across(self, rates: FloatArray) -> FloatArray:
        """Find the least motion that gives the rows certain rates.

        Parameters
        ----------
        rates
            (nc,) or (nc, k), dimensionless; what redundant rows contradict is left out.

        Returns
        -------
        numpy.ndarray
            (nv,) or (nv, k), dimensionless.
        """
        values = self.values if rates.ndim == 1 else self.values[:, None]
        return self.right.T @ ((self.left.T @ rates) / values)

    def reactions(self, efforts: FloatArray) -> FloatArray:
        """Find the least reactions that carry efforts of the tree.

        Parameters
        ----------
        efforts
            (nv,) or (nv, k), dimensionless; what works on the motions N is left out.

        Returns
        -------
        numpy.ndarray
            (nc,) or (nc, k), dimensionless.
        """
        values = self.values if efforts.ndim == 1 else self.values[:, None]
        return self.left @ ((self.right @ efforts) / values)


def split_motions(rows: FloatArray, rank: int) -> Motions:
    """Split loop rows by a rank.

    Parameters
    ----------
    rows
        (nc, nv) loop Jacobian in natural units, dimensionless.
    rank
        Number of independent rows.

    Returns
    -------
    Motions
        The split.
    """
    nc, nv = rows.shape
    if nc == 0:
        return Motions(np.eye(nv), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)), np.zeros((0, nv)))
    u, s, vt = np.linalg.svd(rows)
    return Motions(vt[rank:].T, u[:, rank:], s[:rank], u[:, :rank], vt[:rank])


@dataclass(frozen=True, eq=False)
class Freedom:
    """Motions of a chain at one configuration. Each basis is orthonormal when lengths are measured in robot sizes.

    Attributes
    ----------
    motions
        (nv, dof) basis of the motions that keep the loops closed, N [m, rad].
    idle
        (nv, n) basis of those that generically move neither motors nor platform [m, rad].
    lost
        (nv, n) motions with locked motors that are not idle, orthogonal to the idle ones [m, rad].
    rank
        Rank of the loop Jacobian.
    smallest_singular_value
        Of the motors' share of all motions but the idle ones, in natural units; near zero at a singularity.
    weakest
        (nv,) the motion that the motors resist least [m, rad].
    count
        Numbers of motions, of the motors and of the platform.
    active
        (nv, dof - n) orthonormal basis of the motions that are not idle, dimensionless.
    """

    motions: FloatArray
    idle: FloatArray
    lost: FloatArray
    rank: int
    smallest_singular_value: float
    weakest: FloatArray
    count: FreedomCount
    active: FloatArray

    @staticmethod
    def of(state: State) -> Freedom:
        """Sort the motions at a state.

        Parameters
        ----------
        state
            State whose loops are closed.

        Returns
        -------
        Freedom
            The motions, sorted.
        """
        chain, usual = state.chain, state.chain.generic
        scale, free = chain.tangent_scale[:, None], state.motions.basis
        share, platform = free[chain.motor_index], _platform_share(state, free)
        active, idle = free, np.zeros((chain.nv, 0))
        if usual.count.idle:
            vt = np.linalg.svd(np.vstack([share, platform]))[2]
            active, idle = free @ vt[: usual.count.either].T, free @ vt[usual.count.either :].T
        # Padded with zero rows, so that every active motion has its singular value and vector.
        held = active[chain.motor_index]
        held = np.vstack([held, np.zeros((max(0, active.shape[1] - chain.nu), active.shape[1]))])
        _, s, vt = np.linalg.svd(held)
        driven = int(np.count_nonzero(s[: usual.count.motor] >= SINGULAR * usual.usual_motors))
        moved = np.linalg.svd(platform, compute_uv=False)[: usual.count.platform]
        return Freedom(
            motions=free * scale,
            idle=idle * scale,
            lost=(active @ vt[driven:].T) * scale,
            rank=usual.rank,
            smallest_singular_value=float(s[-1]) if s.size else np.inf,
            weakest=(active @ vt[-1] if s.size else np.zeros(chain.nv)) * scale[:, 0],
            count=FreedomCount(
                dof=free.shape[1],
                motor=driven,
                platform=free.shape[1]
                if chain.platform is None
                else int(np.count_nonzero(moved >= SINGULAR * usual.usual_platform)),
                either=active.shape[1],
            ),
            active=active,
        )

    @cached_property
    def held(self) -> bool:
        """Whether the motors hold everything but the idle motions."""
        return not self.lost.shape[1]


def _platform_share(state: State, free: FloatArray) -> FloatArray:
    """Twists of the platform in natural units that motions make; none where there is no platform."""
    if state.chain.platform is None:
        return np.zeros((0, free.shape[1]))
    chain = state.chain
    return (state.P / chain.twist_sizes[:, None]) @ (chain.tangent_scale[:, None] * free)


def count_at(state: State, axes: Sequence[str] = TWIST_AXES, tolerance: float = SINGULAR) -> FreedomCount:
    """Count the motions at a configuration, those that a singularity adds or takes away included.

    Parameters
    ----------
    state
        State with closed loops.
    axes
        Components of the twist that count as motion of the platform.
    tolerance
        Share of their usual size below which singular values of loops count as zero; those of motors and platform
        below this itself, dimensionless.

    Returns
    -------
    FreedomCount
        Numbers of motions here.
    """
    motions, usual = state.motions, state.chain.generic
    gained = motions.values < tolerance * usual.usual_loops
    free = np.hstack([motions.right[gained].T, motions.basis])
    motors = free[state.chain.motor_index]
    platform = _platform_share(state, free)
    if len(platform):
        platform = platform * counted(axes)[:, None]

    def rank(matrix: FloatArray) -> int:
        return (
            int(np.count_nonzero(np.linalg.svd(matrix, compute_uv=False) >= tolerance)) if matrix.size else 0
        )

    return FreedomCount(
        dof=free.shape[1],
        motor=rank(motors),
        platform=rank(platform) if state.chain.platform is not None else free.shape[1],
        either=rank(np.vstack([motors, platform])) if len(platform) else free.shape[1],
        axes=tuple(axes),
    )


def require_held(state: State) -> None:
    """Refuse a configuration at which the motors cannot hold the robot.

    Parameters
    ----------
    state
        The state.

    Raises
    ------
    ActuationError
        With the freedom that is left over.
    MissingRoleError
        If there are no motors at all.
    """
    from stewart_pin.state.state import named_motion  # noqa: PLC0415 - a state has a freedom, whose errors name motions

    freedom, chain = state.freedom, state.chain
    if freedom.held:
        return
    chain.require_motors()
    direction = freedom.weakest / np.abs(freedom.weakest).max()
    raise ActuationError(
        f"the motors cannot hold the robot here: {freedom.lost.shape[1]} freedom(s) left over with all motors "
        f"locked (smallest singular value {freedom.smallest_singular_value:.3g}), the motion "
        f"{named_motion(chain, direction)}; "
        "move away from this configuration, add a motor, or pass throw=False for least squares",
        smallest_singular_value=freedom.smallest_singular_value,
        direction=direction,
        names=chain.tangent_names,
    )


def require_sufficient_motors(chain: ClosedChain) -> None:
    """Refuse a chain whose motors can hold it nowhere.

    Parameters
    ----------
    chain
        Closed chain.

    Raises
    ------
    ActuationError
        With the freedom that is left over.
    """
    if chain.generic.count.uncontrolled:
        require_held(chain.at(chain.generic.samples[0]))


def counted(axes: Sequence[str]) -> FloatArray:
    """Mark components of a twist.

    Parameters
    ----------
    axes
        Names, of `TWIST_AXES`.

    Returns
    -------
    numpy.ndarray
        (6,) of 1 and 0, dimensionless.

    Raises
    ------
    InputError
        If a name is none of them, or there is none.
    """
    names = list(axes) if isinstance(axes, Iterable) and not isinstance(axes, str) else []
    if not names or not all(isinstance(name, str) and name in TWIST_AXES for name in names):
        raise InputError(f"axes must be some of {', '.join(TWIST_AXES)}, got {axes!r}")
    return np.array([float(name in names) for name in TWIST_AXES])


# ----------------------------------------------------------------------------------------------------
# How motions go that nobody asks for: idle freedoms, such as the spin of a rod between two balls
#
# Loops, platform and motors do not determine them, so that something has to be chosen, and the choice has to belong to
# the mechanism and not to the joints by which it is told. With R a basis of these motions, M the inertia of the tree
# and h its efforts without acceleration,
#
# .. math:: R^\top M v = 0, \qquad R^\top (M a + h) = 0:
#
# they carry no momentum, and follow their own inertia. A rod that is round about its axis u then does not turn about
# it, :math:`u \cdot \omega = 0` and :math:`u \cdot \dot\omega = 0`, as textbooks have it. Of motions without inertia,
# R₀, on which no effort depends, the links turn least: with the angular velocities :math:`\omega_i = J_i v` of all
# links in the world,
#
# .. math:: R_0^\top \sum_i J_i^\top \omega_i = 0, \qquad R_0^\top \sum_i J_i^\top \dot\omega_i = 0.
#
# What turns no link either, a massless slide, moves least in the coordinates of its joints.
# ----------------------------------------------------------------------------------------------------


class OwnMotion:
    """Motions that nobody asks for, at one state.

    Parameters
    ----------
    state
        The state.
    rest
        (nv, k) basis of these motions, R, lengths in robot sizes, dimensionless.
    """

    def __init__(self, state: State, rest: FloatArray) -> None:
        self._state = state
        self._heavy = self._light = rest
        if rest.shape[1]:
            weight = NO_INERTIA * np.abs(state.inertia).max(initial=0.0)
            self._heavy, light = _orthonormal(rest, state.inertia, weight)
            self._light = _orthonormal(light, state.turning, NO_INERTIA)[0] if light.shape[1] else light

    def velocity(self, motion: FloatArray) -> FloatArray:
        """Let the motions carry no momentum.

        Parameters
        ----------
        motion
            (nv,) or (nv, n) velocities, lengths in robot sizes, dimensionless.

        Returns
        -------
        numpy.ndarray
            Like `motion`, changed along R only, dimensionless.
        """
        if self._heavy.shape[1]:
            motion = motion - self._heavy @ (self._heavy.T @ (self._state.inertia @ motion))
        if self._light.shape[1]:
            motion = motion - self._light @ (self._light.T @ (self._state.turning @ motion))
        return motion

    def acceleration(self, motion: FloatArray, pushed: FloatArray | None = None) -> FloatArray:
        """Let the motions follow their own inertia, under weight, gyroscopic effects and what pushes them.

        Parameters
        ----------
        motion
            (nv,) acceleration, lengths in robot sizes, dimensionless.
        pushed
            (nv,) joint efforts of wrenches from outside, or None [N, N m].

        Returns
        -------
        numpy.ndarray
            (nv,) changed along R only, dimensionless.
        """
        state = self._state
        if self._heavy.shape[1]:
            needed = state.nle if pushed is None else state.nle - pushed
            pull = state.inertia @ motion + needed * state.chain.tangent_scale
            motion = motion - self._heavy @ (self._heavy.T @ pull)
        if self._light.shape[1]:
            turning = state.turning @ motion + state.turning_bias
            motion = motion - self._light @ (self._light.T @ turning)
        return motion


def _orthonormal(basis: FloatArray, metric: FloatArray, nothing: float) -> tuple[FloatArray, FloatArray]:
    """Split a space into a basis that is orthonormal in a metric, and what has no length in it."""
    lengths, axes = np.linalg.eigh(basis.T @ metric @ basis)
    some = lengths > nothing
    return basis @ (axes[:, some] / np.sqrt(lengths[some])), basis @ axes[:, ~some]
