"""What inverse and forward dynamics answer, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass

from stewart_pin.brief import Brief
from stewart_pin.typing import FloatArray, Tangent


@dataclass(frozen=True, eq=False, repr=False)
class Effort(Brief):
    """Efforts that make a chain move as asked.

    Attributes
    ----------
    tau_motor
        (nu,) motor efforts, positive along the motor coordinate; for a leg, pushing the platform away [N or N m].
    lambda_c
        (nc,) loop reactions: what the closure does to link 2, row by row in loop frame 1 [N and N m].
    unique
        Whether the motor efforts are the only possible ones; otherwise they are the least-norm ones.
    reactions_unique
        Whether the loop reactions are the only possible ones; otherwise they are the least-norm ones.
    a
        (nv,) acceleration that these efforts cause: the demand, but for idle freedoms, which obey their own inertia;
        idle freedoms without inertia, as the spins of massless legs, are left as near to the demand as can be
        [m/s², rad/s²].
    residual
        Largest part of the equation of motion that no motor and no reaction can supply [N or N m].
    """

    tau_motor: FloatArray
    lambda_c: FloatArray
    unique: bool
    reactions_unique: bool
    a: Tangent
    residual: float


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Brief):
    """What a chain does under given efforts.

    Attributes
    ----------
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    lambda_c
        (nc,) loop reactions: what the closure does to link 2, row by row in loop frame 1 [N and N m].
    """

    a: Tangent
    lambda_c: FloatArray
