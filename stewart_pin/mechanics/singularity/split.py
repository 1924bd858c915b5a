r"""One split of the Jacobians, by which every kind of singularity is one small singular value.

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
by a tolerance, so that the measures are continuous along any path.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.state.freedom import FreedomCount, counted
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray


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

_SHOWN = 1e-6
"""Entries smaller than this share of the largest are not spelled out."""


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
            if abs(x) > _SHOWN * most
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
