"""Bodies of a six-legged platform from three masses: a disc, and slender rods."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.from_hexapod import OVERLAP, default_home, read_stroke
from stewart_pin.checks import as_positive
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths

_SLENDER = 20.0
"""Length over radius of the legs' bodies."""
_FLAT = 20.0
"""Radius over thickness of the platform."""


def hexapod_inertias(
    hexapod: Hexapod,
    *,
    platform: float,
    lower: float,
    upper: float,
    leg_length: float | None = None,
    stroke: tuple[float, float] = (0.0, np.inf),
) -> dict[str, pin.Inertia]:
    """Estimate the inertias of a platform from its masses: a disc, and slender rods.

    The platform is a flat disc about the middle of its points, as wide as they are. Cylinders reach from the base
    points, rods from the platform points, each over 60 % of a leg, so that they overlap as telescopes do.

    Parameters
    ----------
    hexapod
        Geometry.
    platform, lower, upper
        Mass of the platform, of each cylinder and of each rod [kg].
    leg_length
        Usual length of the legs; default: the mean where `hexapod_chain` puts home by itself [m].
    stroke
        Least and greatest leg length, as for `hexapod_chain`; `leg_length` lies within [m].

    Returns
    -------
    dict
        ``platform``, ``lower`` and ``upper`` for `hexapod_chain` [kg, m, kg m²].

    Raises
    ------
    InputError
        If a mass or the length is not above zero, the stroke is empty, the length is beyond it, or the platform's
        points coincide.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> hexapod = stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3)
    >>> masses = stp.hexapods.hexapod_inertias(hexapod, platform=20.0, lower=2.0, upper=1.5)
    >>> stp.mobility(stp.hexapod_chain(hexapod, **masses)).dof
    6
    """
    masses = {
        name: as_positive(name, mass)
        for name, mass in (("platform", platform), ("lower", lower), ("upper", upper))
    }
    if leg_length is None:
        home = default_home(hexapod, *read_stroke(stroke))
        leg_length = float(leg_lengths(hexapod, home, np.eye(3)).mean())
    low, high = read_stroke(stroke)
    if not low <= leg_length <= high:
        raise InputError(
            f"leg_length {leg_length:g} m is beyond the stroke of {low:g} to {high:g} m; choose one within"
        )
    length = OVERLAP * as_positive("leg_length", leg_length)
    centre = hexapod.platform_points.mean(axis=0)
    radius = float(np.linalg.norm(hexapod.platform_points - centre, axis=1).max())
    if radius == 0.0:
        raise InputError(
            "hexapod: all platform points coincide, so the platform has no size; give inertias by hand"
        )
    # A cylinder about z, its centre of mass where told.
    across = (3 * radius**2 + (radius / _FLAT) ** 2) / 12
    disc = masses["platform"] * np.diag([across, across, radius**2 / 2])
    thin = length / _SLENDER
    rod = np.diag([(3 * thin**2 + length**2) / 12, (3 * thin**2 + length**2) / 12, thin**2 / 2])
    half = np.array([0.0, 0.0, length / 2])
    return {
        "platform": pin.Inertia(masses["platform"], centre, disc),
        "lower": pin.Inertia(masses["lower"], half, masses["lower"] * rod),
        "upper": pin.Inertia(masses["upper"], -half, masses["upper"] * rod),
    }
