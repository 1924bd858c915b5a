"""Closed forms that stand for a chain: read off it, compared with the general way on this very chain, then admitted.

Every verb that would rather use a closed form asks here. What is not admitted is no error: the general way answers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from stewart_pin.building.hexapod_bodies import hexapod_bodies
from stewart_pin.building.legs import planar_rpr, rotary_legs
from stewart_pin.building.variants import massless_legs
from stewart_pin.errors import InputError, StewartPinError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths, point_mass_forces
from stewart_pin.geometry.hexapod_dynamics import HexapodBodies, hexapod_inverse_dynamics
from stewart_pin.geometry.leg_motion import leg_rates
from stewart_pin.geometry.planar import PlanarRPR, planar_leg_lengths
from stewart_pin.geometry.rotary import RotaryLegs, crank_angles
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.mechanics.kinematics import platform_motion
from stewart_pin.model.joint_physics import fields_key
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray

AGREE = 1e-9
"""Share of lengths, rates and efforts by which a closed form may differ from the general way: round-off of states that
are closed to 2e-13, with some thousands for elimination."""

Form = Literal["leg_lengths", "leg_efforts", "point_mass", "planar_lengths", "crank_angles"]
"""Closed forms: lengths and rates of six legs; their efforts with all masses, and with the platform as a point;
lengths of a planar 3-RPR platform; angles of cranks with rods."""


@dataclass(frozen=True, eq=False)
class LegForm:
    """Closed form of a platform on six legs, in terms of what its motors read.

    Attributes
    ----------
    hexapod
        Leg ends, in the world and in the platform frame [m].
    sign, offset
        (6,) what motors read, length = offset + sign × reading; dimensionless, [m].
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].
    bodies
        Masses; None where only lengths are known.
    mass
        Of the platform as a point [kg].
    """

    hexapod: Hexapod
    sign: FloatArray
    offset: FloatArray
    gravity: FloatArray
    bodies: HexapodBodies | None = None
    mass: float = 0.0

    def positions(self, position: FloatArray, rotation: FloatArray) -> FloatArray:
        """Compute what the motors read: sign × (length - offset).

        Parameters
        ----------
        position
            (..., 3) platform origin in the world frame [m].
        rotation
            (..., 3, 3) platform axes in the world frame.

        Returns
        -------
        numpy.ndarray
            (..., 6) motor positions [m].
        """
        return self.sign * (leg_lengths(self.hexapod, position, rotation) - self.offset)

    def rates(self, position: FloatArray, rotation: FloatArray, twist: FloatArray) -> FloatArray:
        """Compute the rates of the motors.

        Parameters
        ----------
        position
            (..., 3) platform origin in the world frame [m].
        rotation
            (..., 3, 3) platform axes in the world frame.
        twist
            (..., 6) [v; ω] of the platform origin, in world axes [m/s, rad/s].

        Returns
        -------
        numpy.ndarray
            (..., 6) motor rates [m/s].
        """
        return self.sign * leg_rates(self.hexapod, position, rotation, twist)

    def efforts(
        self,
        position: FloatArray,
        rotation: FloatArray,
        twist: FloatArray,
        acceleration: FloatArray,
        wrench: FloatArray | None = None,
    ) -> FloatArray:
        """Compute the motor efforts of a motion: of all bodies, or of the point where none are known.

        Parameters
        ----------
        position
            (..., 3) platform origin in the world frame [m].
        rotation
            (..., 3, 3) platform axes in the world frame.
        twist
            (..., 6) [v; ω] of the platform origin, in world axes [m/s, rad/s].
        acceleration
            (..., 6) its rate of change, in world axes [m/s², rad/s²].
        wrench
            (..., 6) from outside on the platform at its origin, world axes; default: none [N, N m].

        Returns
        -------
        numpy.ndarray
            (..., 6) motor efforts [N].
        """
        legs, loads = self.hexapod, {"gravity": self.gravity, "wrench": wrench}
        if self.bodies is None:
            push = np.asarray(acceleration)[..., :3]
            return self.sign * point_mass_forces(legs, position, rotation, push, mass=self.mass, **loads)
        where = (position, rotation, twist, acceleration)
        return self.sign * hexapod_inverse_dynamics(legs, self.bodies, *where, **loads).actuator


@dataclass(frozen=True, eq=False)
class Admission:
    """Whether a closed form stands for a chain.

    Attributes
    ----------
    form
        Which one.
    admitted
        Whether it agrees with the general way.
    miss
        Largest difference from it, as a share; infinite where the form cannot be read off the chain.
    reason
        Why it is not admitted; empty where it is.
    geometry
        What was read off the chain, admitted or not; None where nothing could be.
    """

    form: Form
    admitted: bool
    miss: float
    reason: str
    geometry: LegForm | PlanarRPR | RotaryLegs | None

    def __str__(self) -> str:
        """Say it in a line."""
        return f"{self.form}: " + (f"admitted, differs by {self.miss:.1g}" if self.admitted else self.reason)


def closed_forms(chain: ClosedChain) -> tuple[Admission, ...]:
    """Tell which closed forms stand for a chain, and why the others do not.

    Parameters
    ----------
    chain
        Closed chain with a platform.

    Returns
    -------
    tuple of Admission
        One for every closed form.

    Raises
    ------
    MissingRoleError
        If the chain has no platform.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> [found.form for found in stp.dynamics.closed_forms(stp.load("stewart")) if found.admitted]
    ['leg_lengths', 'leg_efforts', 'point_mass']
    """
    chain.platform_link  # noqa: B018 - raises
    return tuple(admission(chain, form) for form in get_args(Form))


def admission(chain: ClosedChain, form: Form) -> Admission:
    """Compare a closed form with the general way at closed states of a chain, once in its life.

    Parameters
    ----------
    chain
        Closed chain.
    form
        Which closed form.

    Returns
    -------
    Admission
        Kept with the chain; a chain that is made of it is asked anew.
    """
    if form not in chain.found:
        chain.found[form] = _judged(chain, form)
    found = chain.found[form]
    if form in ("leg_efforts", "point_mass") and chain.joint_effects.present:
        # Whenever they came: fields of the model may be set by hand.
        return Admission(
            form, False, np.inf, "joints have rotors, springs, damping or friction", found.geometry
        )
    return found


def leg_form(chain: ClosedChain, form: Literal["leg_lengths", "leg_efforts", "point_mass"]) -> LegForm | None:
    """Return the closed form of six legs that stands for a chain.

    Parameters
    ----------
    chain
        Closed chain.
    form
        What it shall answer.

    Returns
    -------
    LegForm or None
        None where the general way has to answer.
    """
    found = admission(chain, form)
    return found.geometry if found.admitted and isinstance(found.geometry, LegForm) else None


def point_of(chain: ClosedChain) -> ClosedChain:
    """Return the chain with massless legs and the platform as a point, made once for what its joints do.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    ClosedChain
        The mechanism of the simplified formula.
    """
    fields = fields_key(chain.model)
    if chain.found.get("point", (b"",))[0] != fields:
        chain.found["point"] = fields, massless_legs(chain, point_platform=True)
    return chain.found["point"][1]


def _judged(chain: ClosedChain, form: Form) -> Admission:
    read, compare = _FORMS[form]
    geometry, freedoms, needed = None, chain.generic.count.platform, _FREEDOMS.get(form, 0)
    if freedoms < needed:  # guided: where it can go the lengths agree, and the closed form goes elsewhere too
        return Admission(
            form, False, np.inf, f"the platform has {freedoms} freedoms instead of {needed}", None
        )
    try:
        geometry = read(chain)
        miss = max(compare(chain, geometry, state) for state in _states(chain))
    except StewartPinError as error:
        return Admission(form, False, np.inf, str(error), geometry)
    admitted = bool(miss <= AGREE)
    reason = "" if admitted else f"differs from the general way by {miss:.3g} of what it answers"
    return Admission(form, admitted, miss, reason, geometry)


def _states(chain: ClosedChain) -> list[State]:
    """Draw closed states with random rates and accelerations of the platform, each with the least joint motion."""
    rng = np.random.default_rng(0)
    states: list[State] = []
    for q in chain.generic.samples:
        here = chain.at(q)
        N = here.motions.basis * chain.tangent_scale[:, None]
        v = N @ rng.uniform(-1, 1, N.shape[1])
        twist = here.P @ v
        moving = chain.at(q, v)
        across = -here.motions.across(moving.loop_bias / chain.row_sizes) * chain.tangent_scale
        acceleration = here.P @ (across + N @ rng.uniform(-1, 1, N.shape[1])) + moving.platform_bias
        states.append(platform_motion(chain, here.pose, twist, acceleration, q_guess=q, limits=False))
    return states


def _share(found: FloatArray, general: FloatArray, size: float) -> float:
    difference = np.abs(np.asarray(found) - general).max(initial=0.0)
    return float(difference / size) if difference else 0.0


def _place(state: State) -> tuple[FloatArray, FloatArray]:
    return state.pose.translation, state.pose.rotation


def _motion(state: State) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    return (*_place(state), state.twist, state.P @ state.require_accelerating() + state.platform_bias)


def _six(chain: ClosedChain) -> Hexapod:
    if chain.nu != 6:
        raise InputError(f"{chain.nu} motors: the closed form is of six legs")
    return Hexapod.from_chain(chain)


def _legs(chain: ClosedChain) -> LegForm:
    return LegForm(_six(chain), *chain.leg_readings, chain.gravity)


def _legs_with_masses(chain: ClosedChain) -> LegForm:
    return LegForm(_six(chain), *chain.leg_readings, chain.gravity, hexapod_bodies(chain))


def _legs_of_a_point(chain: ClosedChain) -> LegForm:
    legs = _six(chain)
    # What is fixed to the ground is Pinocchio's joint 0.
    mass = sum(body.mass for body in list(point_of(chain).model.inertias)[1:])
    return LegForm(legs, *chain.leg_readings, chain.gravity, mass=mass)


def _lengths_miss(chain: ClosedChain, legs: LegForm, state: State) -> float:
    positions, rates = state.q[chain.motor_q_index], state.v[chain.motor_index]
    return max(
        _share(legs.positions(*_place(state)), positions, chain.length_scale),
        _share(legs.rates(*_place(state), state.twist), rates, float(np.abs(rates).max())),
    )


def _efforts_miss(chain: ClosedChain, legs: LegForm, state: State) -> float:
    variant = chain if legs.bodies is not None else point_of(chain)
    general = inverse_dynamics(variant, state.q, state.v, state.a).tau_motor
    return max(
        _lengths_miss(chain, legs, state),
        _share(legs.efforts(*_motion(state)), general, float(np.abs(general).max())),
    )


def _planar_miss(chain: ClosedChain, platform: PlanarRPR, state: State) -> float:
    sign, offset = chain.leg_readings
    position, angle = platform.coordinates(*_place(state))
    lengths = planar_leg_lengths(platform, position, angle)
    return _share(sign * (lengths - offset), state.q[chain.motor_q_index], chain.length_scale)


def _cranks_miss(chain: ClosedChain, legs: RotaryLegs, state: State) -> float:
    # Of the two branches of each leg the one that is nearer: the general way keeps home's.
    apart = crank_angles(legs, *_place(state)).angle - state.q[chain.motor_q_index][:, None]
    return float(np.abs(np.angle(np.exp(1j * apart))).min(axis=-1).max())


_FORMS: dict[Form, tuple[Callable, Callable]] = {
    "leg_lengths": (_legs, _lengths_miss),
    "leg_efforts": (_legs_with_masses, _efforts_miss),
    "point_mass": (_legs_of_a_point, _efforts_miss),
    "planar_lengths": (planar_rpr, _planar_miss),
    "crank_angles": (rotary_legs, _cranks_miss),
}
"""How each is read off a chain, and how it is compared."""
_FREEDOMS = {"leg_lengths": 6, "leg_efforts": 6, "point_mass": 6, "planar_lengths": 3}
"""Freedoms of the platform that a form takes for granted."""
