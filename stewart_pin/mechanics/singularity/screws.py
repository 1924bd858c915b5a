"""Twists and wrenches of the platform in words: which way it moves or is loaded worst."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.typing import FloatArray

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
