r"""Singular configurations of any chain: how near, of which kind, and what is lost or gained there.

One split of the Jacobians makes every kind of singularity one small singular value.

With N an orthonormal basis of the motions that keep the loops closed (J_c N = 0), S the rows of the motors and P those
of the platform, all lengths in robot sizes, the usual ranks belong to four matrices:

===========  ==============  ================================================================
kind         matrix          its rank drops where
===========  ==============  ================================================================
``loop``     J_c             the loops leave more freedom than usual
``motor``    S N             locked motors leave the platform free (type II, parallel)
``platform`` P N             the platform cannot move some way (type I, serial)
``passive``  [S; P] N        joints move while motors and platform are at rest
===========  ==============  ================================================================

The measure of each is the singular value that the usual rank makes the last one. Bases are taken by that rank and not
by a tolerance, so that the measures are continuous along any path. What is lost or gained is told in words as well, by
twists and wrenches of the platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_positive
from stewart_pin.errors import InputError
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES, FreedomCount, TwistAxis, count_at, counted
from stewart_pin.state.generic import generic_freedom
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import SHOWN, SINGULAR
from stewart_pin.typing import ArrayLike, FloatArray


class SingularityKind(StrEnum):
    """What goes wrong at a singular configuration."""

    LOOP = "loop"
    MOTOR = "motor"
    PLATFORM = "platform"
    PASSIVE = "passive"


MEANING = {
    SingularityKind.LOOP: "the loops leave more freedom than usual (constraint singularity)",
    SingularityKind.MOTOR: "locked motors leave the platform free (type II, parallel)",
    SingularityKind.PLATFORM: "the platform cannot move some way (type I, serial)",
    SingularityKind.PASSIVE: "joints can move with motors and platform at rest",
}
"""Each kind in words."""


ALIGNED = 0.7
"""Cosine between singular vectors at two configurations from which on they are the same ones."""


@dataclass(frozen=True, eq=False)
class Measure:
    """How near one kind of singularity is.

    Attributes
    ----------
    value
        The singular value that vanishes there, lengths in robot sizes; infinite where the kind cannot occur.
    largest
        The largest singular value of the same matrix.
    left
        (m,) its left singular vector, dimensionless.
    motion
        (nv,) its right singular vector, a motion [m, rad in robot sizes, dimensionless].
    matrix
        (m, nv) the matrix, zero on what is no motion of its domain, dimensionless.
    """

    value: float
    largest: float
    left: FloatArray
    motion: FloatArray
    matrix: FloatArray

    @property
    def condition(self) -> float:
        """Ratio of the largest to the smallest singular value: 1 at best, infinite at the singularity."""
        return self.largest / self.value if self.value > 0 else np.inf


@dataclass(frozen=True, eq=False)
class JacobianSplit:
    """The split at one configuration.

    Attributes
    ----------
    measures
        One per kind.
    motions
        (nv, dof) the usual number of motions that the loops leave, orthonormal, dimensionless.
    motors
        (nu, dof) motor rates of these, dimensionless.
    platform
        (6, dof) twists of these, velocities over the length, dimensionless.
    length
        What velocities are divided by to compare them with angular velocities [m].
    """

    measures: dict[SingularityKind, Measure]
    motions: FloatArray
    motors: FloatArray
    platform: FloatArray
    length: float


def split_jacobians(state: State, generic: FreedomCount, length: float) -> JacobianSplit:
    """Split the Jacobians at a configuration.

    Parameters
    ----------
    state
        State with closed loops.
    generic
        The usual numbers of motions.
    length
        Divides velocities of the platform; lengths of joints and loops count in robot sizes [m].

    Returns
    -------
    JacobianSplit
        Measures and bases.
    """
    chain, loops = state.chain, state.rows
    if chain.platform is None:  # then every motion is one of the mechanism
        twist = np.eye(chain.nv)
    else:
        twist = state.P * chain.tangent_scale / np.repeat([length, 1.0], 3)[:, None]
        twist = twist * counted(generic.axes)[:, None]
    rows = chain.motor_rows

    everything = np.eye(chain.nv)
    bound = chain.nv - generic.dof
    motions = np.linalg.svd(loops)[2][bound:].T if chain.nc else everything
    both = np.vstack([rows, twist]) @ motions
    # The motions that take part, without the usual number of idle ones.
    active = motions @ np.linalg.svd(both)[2][: generic.either].T if generic.idle else motions
    kind = SingularityKind
    return JacobianSplit(
        measures={
            kind.LOOP: _measure(loops, everything, bound),
            kind.MOTOR: _measure(rows, active, generic.motor),
            kind.PLATFORM: _measure(twist, motions, generic.platform),
            kind.PASSIVE: _measure(np.vstack([rows, twist]), motions, generic.either),
        },
        motions=motions,
        motors=rows @ motions,
        platform=twist @ motions,
        length=length,
    )


def signed_measure(reference: Measure, here: Measure) -> float:
    """Give a measure the sign that continues a reference: smooth along a path, where singular values have a kink.

    Parameters
    ----------
    reference
        Measure at a configuration nearby, counted as positive.
    here
        Measure of the same kind.

    Returns
    -------
    float
        The measure, times the cosine between the motions of the two; negative beyond a singularity.
    """
    turned = 1.0 if reference.left @ here.left >= 0 else -1.0
    return here.value * turned * float(reference.motion @ here.motion)


def _measure(rows: FloatArray, domain: FloatArray, rank: int) -> Measure:
    reduced = rows @ domain
    if rank == 0 or not reduced.size:
        nothing = np.zeros(rows.shape[0]), np.zeros(rows.shape[1])
        return Measure(np.inf, np.inf, *nothing, np.zeros_like(rows))
    u, s, vt = np.linalg.svd(reduced)
    return Measure(
        value=float(s[rank - 1]),
        largest=float(s[0]),
        left=u[:, rank - 1],
        motion=domain @ vt[rank - 1],
        matrix=reduced @ domain.T,
    )


# ----------------------------------------------------------------------------------------------------
# Twists and wrenches of the platform in words: which way it moves or is loaded worst
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Screw(Brief):
    """A twist or a wrench at the platform origin, in world axes.

    Attributes
    ----------
    kind
        ``"twist"`` or ``"wrench"``.
    values
        (6,) [v; ω] or [f; m] [m/s, rad/s, N, N m].
    """

    kind: str
    values: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each entry."""
        return tuple(("vx vy vz wx wy wz" if self.kind == "twist" else "fx fy fz mx my mz").split())

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each entry."""
        linear, angular = ("m/s", "rad/s") if self.kind == "twist" else ("N", "N m")
        return (linear,) * 3 + (angular,) * 3

    def __str__(self) -> str:
        """Spell out the entries that are not round-off."""
        most = np.abs(self.values).max()
        return ", ".join(
            f"{name} {x:+.4g} {unit}"
            for name, x, unit in zip(self.names, self.values, self.units, strict=True)
            if abs(x) > SHOWN * most
        )


def twist_and_wrench(direction: FloatArray, length: float) -> tuple[Screw, Screw]:
    """Give a direction in normalised coordinates its units, as a twist and as the wrench that works on it.

    Parameters
    ----------
    direction
        (6,) of (v / length, ω), equally (f, m / length), dimensionless.
    length
        Normalising length [m].

    Returns
    -------
    twist : Screw
        With ω of the direction [m/s, rad/s].
    wrench : Screw
        With f of the direction [N, N m].
    """
    # The sign of a singular vector means nothing: make the largest entry positive.
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    stretch = np.repeat([length, 1.0], 3)
    return Screw("twist", direction * stretch), Screw("wrench", direction * stretch[::-1])


# ----------------------------------------------------------------------------------------------------
# Which kind of singularity a configuration is, by counting motions against the usual numbers
# ----------------------------------------------------------------------------------------------------

_CLEAR = 1e-7
"""Singular value above which its vector stands clear of those that are always zero: the root of round-off."""
_ASIDE = 1e-4
"""Step to a neighbour that is not singular, in robot sizes and radians."""


@dataclass(frozen=True, eq=False, repr=False)
class Singularity(Brief):
    """What a configuration is like: regular if `kinds` is empty.

    Attributes
    ----------
    kinds
        What goes wrong here, within the tolerance.
    zlatanov
        The same in the six classes of Zlatanov: RI, RO (redundant input, output), II, IO (impossible input, output),
        IIM (increased instantaneous mobility), RPM (redundant passive motion).
    count, generic
        Numbers of motions here, and the usual ones.
    measures
        Of each kind the singular value that vanishes there, lengths in robot sizes; the smaller, the nearer.
    conditions
        Of each kind the ratio of the largest singular value to it.
    condition_number
        Of the map from the twists that the platform can do to motor rates, velocities over `length`; infinite where
        it or its inverse is singular.
    length
        What velocities were divided by [m].
    worst_twist, worst_wrench
        The twist that needs the least motor rates, and the wrench that needs the largest motor efforts: with locked
        motors the platform moves so, and they cannot carry it. Unit length once normalised.
    lost_twist, carried_wrench
        The twist that needs the largest motor rates, and the wrench that needs the least motor efforts: at a
        singularity the platform cannot move so, and the structure carries that wrench alone.
    motions
        Of each kind (nv,) the motion whose share of the matrix is least: what is gained there [m, rad].
    """

    kinds: tuple[SingularityKind, ...]
    zlatanov: tuple[str, ...]
    count: FreedomCount
    generic: FreedomCount
    measures: dict[SingularityKind, float]
    conditions: dict[SingularityKind, float]
    condition_number: float
    length: float
    worst_twist: Screw
    worst_wrench: Screw
    lost_twist: Screw
    carried_wrench: Screw
    motions: dict[SingularityKind, FloatArray]

    def __str__(self) -> str:
        """Say what it is, and what goes with it."""
        if not self.kinds:
            return f"regular, condition number {self.condition_number:.4g} (length {self.length:.4g} m)"
        return "; ".join(MEANING[kind] for kind in self.kinds) + f" [{', '.join(self.zlatanov)}]"


def classify_singularity(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    axes: Sequence[TwistAxis] | None = None,
    length: float | None = None,
    tolerance: float = SINGULAR,
    generic: FreedomCount | None = None,
) -> Singularity:
    """Tell whether a configuration is singular, of which kinds, and what moves or is carried there.

    Parameters
    ----------
    chain
        Closed chain, or a state of it. What the platform is decides what it can lose: of a four-bar, take the rocker.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    axes
        Components of the twist, in world axes, that count as motion of the platform: ``("vx", "vy")`` where only the
        path of a point of a planar robot matters; default: all.
    length
        Length that makes turning and shifting of the platform comparable; default: ``chain.length_scale`` [m].
    tolerance
        Singular values below this count as zero, lengths in robot sizes: a configuration known to 13 digits is only
        known to half of them where loops depend on each other.
    generic
        The usual numbers of motions, with their axes; default: those near home, which `generic_freedom` counts. Pass
        them to classify many configurations.

    Returns
    -------
    Singularity
        Kinds, measures, condition number, worst twists and wrenches.

    Raises
    ------
    InputError
        If the loops are open at q, or an argument makes no sense.

    References
    ----------
    .. [1] D. Zlatanov, R. G. Fenton, B. Benhabib, "A unifying framework for classification and interpretation of
       mechanism singularities", ASME Journal of Mechanical Design 117, 1995, p. 566.
    .. [2] C. Gosselin, J. Angeles, "Singularity analysis of closed-loop kinematic chains", IEEE Transactions on
       Robotics and Automation 6(3), 1990, p. 281.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> arm = stp.load("arm_3r_planar")
    >>> print(stp.singularities.classify_singularity(arm, np.zeros(3)))  # stretched
    the platform cannot move some way (type I, serial) [RI, IO]
    """
    state = as_state(chain, q).require_closed()
    chain = state.chain
    chain.platform_link  # noqa: B018 - raises
    length = chain.length_scale if length is None else as_positive("length", length)
    tolerance = as_positive("tolerance", tolerance)
    if axes is not None:
        counted(axes)
    usual = generic_freedom(chain, TWIST_AXES if axes is None else axes) if generic is None else generic
    if axes is not None and tuple(axes) != usual.axes:
        raise InputError(f"axes {tuple(axes)} are not those of generic, {usual.axes}; pass one of the two")
    here = count_at(state, usual.axes, tolerance)
    split = split_jacobians(state, usual, length)
    kinds, letters = _kinds(here, usual)
    worst, lost, condition = _extreme_directions(split)
    if split.measures[SingularityKind.PLATFORM].value <= _CLEAR:
        lost = _lost_direction(state, usual, split)
    singular = {SingularityKind.MOTOR, SingularityKind.PLATFORM} & set(kinds)
    return Singularity(
        kinds=kinds,
        zlatanov=letters,
        count=here,
        generic=usual,
        measures={kind: measure.value for kind, measure in split.measures.items()},
        conditions={kind: measure.condition for kind, measure in split.measures.items()},
        condition_number=np.inf if singular else condition,
        length=length,
        worst_twist=twist_and_wrench(worst, length)[0],
        worst_wrench=twist_and_wrench(worst, length)[1],
        lost_twist=twist_and_wrench(lost, length)[0],
        carried_wrench=twist_and_wrench(lost, length)[1],
        motions={kind: measure.motion * chain.tangent_scale for kind, measure in split.measures.items()},
    )


def _kinds(here: FreedomCount, usual: FreedomCount) -> tuple[tuple[SingularityKind, ...], tuple[str, ...]]:
    letters = {
        "RI": here.inner > usual.inner,
        "RO": here.uncontrolled > usual.uncontrolled,
        "II": here.motor < usual.motor,
        "IO": here.platform < usual.platform,
        "IIM": here.dof > usual.dof,
        "RPM": here.idle > usual.idle,
    }
    kinds = {
        SingularityKind.LOOP: letters["IIM"],
        SingularityKind.MOTOR: letters["RO"],
        SingularityKind.PLATFORM: letters["RI"] or letters["IO"],
        SingularityKind.PASSIVE: letters["RPM"],
    }
    return tuple(k for k, true in kinds.items() if true), tuple(k for k, true in letters.items() if true)


def _extreme_directions(split: JacobianSplit) -> tuple[FloatArray, FloatArray, float]:
    """Normalised twists that need the least and the most motor rates, and the condition number between them."""
    u, s, _ = np.linalg.svd(split.platform)
    rank = int(np.count_nonzero(s >= SINGULAR))
    if rank == 0 or not split.motors.size:
        return np.zeros(6), np.zeros(6), np.inf
    # In a basis of the twists that the platform can do: those it never does need no motor rates either.
    feasible = u[:, :rank]
    to_motors = split.motors @ np.linalg.pinv(feasible.T @ split.platform)
    values, vt = np.linalg.svd(to_motors)[1:]
    smallest = values[rank - 1] if values.size >= rank else 0.0
    condition = float(values[0] / smallest) if smallest > SINGULAR * values[0] else np.inf
    return feasible @ vt[-1], feasible @ vt[0], condition


def _lost_direction(state: State, usual: FreedomCount, split: JacobianSplit) -> FloatArray:
    """Normalised twist that the platform loses at a singularity."""
    chain = state.chain
    measure = split.measures[SingularityKind.PLATFORM]
    if usual.platform == len(usual.axes):
        on = counted(usual.axes) > 0
        direction = np.zeros(6)
        direction[on] = np.linalg.svd(split.platform[on])[0][:, -1]
        return direction
    # Beside the twist that is lost there are those that it never does; a neighbour tells them apart.
    here = np.linalg.svd(split.platform)[0][:, : usual.platform - 1]
    for motion in np.hstack([measure.motion[:, None], split.motions]).T:
        step = _ASIDE * chain.tangent_scale * motion / np.abs(motion).max()
        beside = close_loops(chain, pin.integrate(chain.model, state.q, step), throw=False)
        if beside.success:
            near = split_jacobians(beside.state, usual, split.length)
            if near.measures[SingularityKind.PLATFORM].value > _CLEAR:
                space = np.linalg.svd(near.platform)[0][:, : usual.platform]
                return np.linalg.svd(space - here @ (here.T @ space))[0][:, 0]
    return measure.left
