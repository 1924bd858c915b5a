"""Controllers: frozen descriptions that are called with (t, q, v) and answer with motor efforts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_positive, as_spread
from stewart_pin.errors import InputError
from stewart_pin.mechanics.closed_forms import leg_form, point_of
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics, least_efforts, motor_efforts
from stewart_pin.mechanics.kinematics import forward_kinematics, platform_acceleration, platform_motion
from stewart_pin.motion.simulation.drive import SimulationWrenches
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import OutsideWrenches, as_wrenches, asked_wrenches
from stewart_pin.state.state import State, as_chain
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

Reference = Callable[[FloatArray], PlatformSamples]
"""A motion: instants (N,) to `PlatformSamples`, such as a ``functools.partial`` of `sinusoidal_motion`."""

MODELS = ("full", "point_mass")
"""What a controller may believe about the machine."""


@dataclass(frozen=True, eq=False, repr=False)
class GravityCompensation(Brief):
    """Motors that carry the weight, whatever the configuration: ``tau = inverse_dynamics(q, 0, 0)``.

    Attributes
    ----------
    chain
        Closed chain.
    wrenches
        What is known to act from outside: {link: (6,)} [force; moment] on the link, at the origin of its frame, world
        axes; or a function of the instant and the `State` that returns them, or None [N, N m].
    """

    chain: ClosedChain
    wrenches: SimulationWrenches | None = None

    def __post_init__(self) -> None:
        as_chain(self.chain)
        _require_wrenches(self.chain, self.wrenches)

    def __call__(self, t: float, q: Configuration, v: Tangent) -> FloatArray:
        """Return the efforts (nu,) that hold the chain at rest [N or N m]."""
        return motor_efforts(
            State(self.chain, q), self.chain.rest, _known(self.wrenches, t, self.chain, q, v)
        )


@dataclass(frozen=True, eq=False, repr=False)
class Feedforward(Brief):
    """Efforts that the reference motion itself needs, without a look at the machine.

    Attributes
    ----------
    chain
        Closed chain.
    reference
        Motion of the platform.
    model
        ``"full"``: inverse dynamics of all bodies. ``"point_mass"``: legs massless, platform a point.
    wrenches
        What is known to act from outside: {link: (6,)} [force; moment] on the link, at the origin of its frame, world
        axes; or a function of the instant and the `State` that returns them, or None [N, N m].
    """

    chain: ClosedChain
    reference: Reference
    model: str = "full"
    wrenches: SimulationWrenches | None = None

    def __post_init__(self) -> None:
        _require_reference(self.chain, self.reference)
        _require_wrenches(self.chain, self.wrenches)
        _require_model(self.model)
        if self.model == "point_mass":
            point_of(self.chain)  # refuses a platform without mass here, not in the midst of a run

    def __call__(self, t: float, q: Configuration, v: Tangent) -> FloatArray:
        """Return the efforts (nu,) of the reference at time t [N or N m]."""
        want = self.reference(np.array([t]))
        legs = leg_form(self.chain, "leg_efforts" if self.model == "full" else "point_mass")
        outside = _known(self.wrenches, t, self.chain, q, v)
        if legs is not None and outside is None:
            return legs.efforts(want.position, want.rotation, want.twist, want.acceleration)[0]
        state = platform_motion(
            self.chain, want.pose(0), want.twist[0], want.acceleration[0], q_guess=q, limits=False
        )
        moved = self.chain if self.model == "full" else point_of(self.chain)
        return inverse_dynamics(moved, state.q, state.v, state.a, wrenches=outside).tau_motor


@dataclass(frozen=True, eq=False, repr=False)
class LegPID(Brief):
    """One PID controller per motor, on motor positions.

    ``tau = kp e + ki ∫e dt + kd de/dt + feedforward``, e the reference's motor positions less the measured ones.

    Attributes
    ----------
    chain
        Closed chain.
    reference
        Motion of the platform; motor positions follow by inverse kinematics.
    kp, ki, kd
        Gains, one number or (nu,) [N/m, N/(m s), N s/m; N m per rad for rotary motors].
    integral_limit
        Largest effort of the integral part: it stops growing there [N or N m].
    feedforward
        Controller whose efforts are added, such as `Feedforward` or `GravityCompensation`.
    """

    chain: ClosedChain
    reference: Reference
    kp: ArrayLike = 2e5
    ki: ArrayLike = 0.0
    kd: ArrayLike = 2e3
    integral_limit: ArrayLike = np.inf
    feedforward: Callable[[float, Configuration, Tangent], FloatArray] | None = None

    def __post_init__(self) -> None:
        _require_reference(self.chain, self.reference)
        for name in ("kp", "ki", "kd", "integral_limit"):
            as_spread(name, getattr(self, name), self.chain.nu)

    @property
    def state_size(self) -> int:
        """The integrals of the position errors; without integral gain, none."""
        return self.chain.nu if np.any(np.asarray(self.ki)) else 0

    def __call__(self, t: float, q: Configuration, v: Tangent) -> FloatArray:
        """Return the efforts (nu,) with an empty integral [N or N m]."""
        return self.effort(t, q, v, np.zeros(self.state_size))

    def effort(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Compute the motor efforts.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) integrals of the position errors [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) [N or N m].
        """
        position, rate = self._motors.at(t, q)
        effort = np.asarray(self.kp) * (position - q[self.chain.motor_q_index])
        effort = effort + np.asarray(self.kd) * (rate - v[self.chain.motor_index])
        if state.size:
            effort = effort + np.asarray(self.ki) * state
        return effort if self.feedforward is None else effort + self.feedforward(t, q, v)

    def state_rate(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Compute the rate of the integrals: the position error, or zero where it would exceed the limit.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) integrals of the position errors [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (state_size,) [m or rad].
        """
        if not state.size:
            return np.zeros(0)
        error = self._motors.at(t, q)[0] - q[self.chain.motor_q_index]
        full = (np.abs(np.asarray(self.ki) * state) >= np.asarray(self.integral_limit)) & (error * state > 0)
        return np.where(full, 0.0, error)

    @cached_property
    def _motors(self) -> _MotorReference:
        return _MotorReference(self.chain, self.reference)


@dataclass(frozen=True, eq=False, repr=False)
class ComputedTorque(Brief):
    """Inverse dynamics at the measured state, of the acceleration that corrects the platform's error.

    ``a = a_ref + kd (twist_ref - twist) + kp e``, e = [p_ref - p; log(R_ref Rᵀ)]: the exact rotation vector that is
    left, in world axes. With the full model and no limits each error obeys ``ë + kd ė + kp e = 0``.

    Attributes
    ----------
    chain
        Closed chain.
    reference
        Motion of the platform.
    kp
        Stiffness per inertia [1/s²].
    kd
        Damping per inertia [1/s]; critical at 2 √kp.
    model
        ``"full"``: all bodies. ``"point_mass"``: legs massless, platform a point. A point has no moment of inertia to
        correct the attitude with; the platform's own serves for the correction, not for the reference.
    motor_inertia
        Inertia of the motors on their coordinates, full model only [kg or kg m²].
    wrenches
        What is known to act from outside: {link: (6,)} [force; moment] on the link, at the origin of its frame, world
        axes; or a function of the instant and the `State` that returns them, or None [N, N m].
    """

    chain: ClosedChain
    reference: Reference
    kp: float = 900.0
    kd: float = 60.0
    model: str = "full"
    motor_inertia: ArrayLike = 0.0
    wrenches: SimulationWrenches | None = None

    def __post_init__(self) -> None:
        _require_reference(self.chain, self.reference)
        _require_wrenches(self.chain, self.wrenches)
        _require_model(self.model)
        as_spread("motor_inertia", self.motor_inertia, self.chain.nu)
        if self.model == "point_mass":
            point_of(self.chain)

    def __call__(self, t: float, q: Configuration, v: Tangent) -> FloatArray:
        """Return the efforts (nu,) [N or N m]."""
        want = self.reference(np.array([t]))
        state = State(self.chain, q, v)
        pose, twist = state.pose, state.twist
        turn = pin.log3(want.rotation[0] @ pose.rotation.T)
        error = np.concatenate([want.position[0] - pose.translation, turn])
        correction = self.kd * (want.twist[0] - twist) + self.kp * error
        outside = _known(self.wrenches, t, self.chain, q, v)
        if self.model == "point_mass":
            return self._by_point_mass(state, want.acceleration[0], correction, outside)
        a = platform_acceleration(state, want.acceleration[0] + correction)
        return motor_efforts(state, a, outside) + np.asarray(self.motor_inertia) * a[self.chain.motor_index]

    def _by_point_mass(
        self, state: State, asked: FloatArray, correction: FloatArray, outside: OutsideWrenches | None
    ) -> FloatArray:
        chain, pose = self.chain, state.pose
        # The point goes as the origin does; turning is asked for by the correction alone.
        wanted = asked + correction
        legs = leg_form(chain, "point_mass")
        if legs is not None and outside is None:
            efforts = legs.efforts(pose.translation, pose.rotation, state.twist, wanted)
        else:
            a = platform_acceleration(state, wanted)
            efforts = motor_efforts(State(point_of(chain), state.q, state.v), a, outside)
        body = chain.mechanism.link(chain.platform_link).inertia
        if body is None:
            return efforts
        # tauᵀ v_motor = momentᵀ ω for every motion: efforts of least norm that carry the moment.
        moment = pose.rotation @ body.inertia @ pose.rotation.T @ correction[3:]
        return efforts + least_efforts(state, state.freedom.motions.T @ state.P[3:].T @ moment)


@dataclass(frozen=True, eq=False, repr=False)
class SampledController(Brief):
    """A controller on a computer: it acts at instants, holds its efforts in between, and reads encoders.

    Attributes
    ----------
    chain
        Closed chain.
    controller
        What acts; states of its own advance by Euler's rule.
    rate
        Instants per second; a period must be a multiple of the simulation's step [1/s].
    resolution
        Step of the motor encoders; the configuration is then what forward kinematics makes of their readings, rates
        stay exact. 0: exact positions [m or rad].
    """

    chain: ClosedChain
    controller: Any
    rate: float = 1000.0
    resolution: float = 0.0

    def __post_init__(self) -> None:
        as_chain(self.chain)
        as_positive("rate", self.rate)
        if not 0 <= self.resolution < np.inf:
            raise InputError(f"resolution must be 0 or more, got {self.resolution}")

    def __call__(self, t: float, q: Configuration, v: Tangent) -> FloatArray:
        """Return the efforts (nu,) as if t were an instant [N or N m]."""
        return self.controller(t, *self.measure(q, v))

    def measure(self, q: Configuration, v: Tangent) -> tuple[Configuration, Tangent]:
        """See a state through the encoders.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        q : numpy.ndarray
            (nq,) with motor positions at multiples of the resolution [m, rad, unit quaternions].
        v : numpy.ndarray
            (nv,) unchanged [m/s, rad/s].
        """
        if not self.resolution:
            return q, v
        readings = self.resolution * np.round(q[self.chain.motor_q_index] / self.resolution)
        return forward_kinematics(self.chain, readings, q_guess=q, limits=False).q, v


class _MotorReference:
    """Motor positions and rates of a platform motion; one instant is kept, for the parts of a controller."""

    def __init__(self, chain: ClosedChain, reference: Reference) -> None:
        self._chain, self._reference = chain, reference
        self._time: float | None = None
        self._values = (np.zeros(chain.nu), np.zeros(chain.nu))
        self._legs = leg_form(chain, "leg_lengths")

    def at(self, t: float, q: Configuration) -> tuple[FloatArray, FloatArray]:
        if t != self._time:
            self._values, self._time = self._compute(t, q), t
        return self._values

    def _compute(self, t: float, q: Configuration) -> tuple[FloatArray, FloatArray]:
        want = self._reference(np.array([t]))
        chain = self._chain
        if self._legs is not None:
            place = (want.position, want.rotation)
            return self._legs.positions(*place)[0], self._legs.rates(*place, want.twist)[0]
        # A platform with fewer than six freedoms cannot move without the acceleration that goes with it.
        state = platform_motion(
            chain, want.pose(0), want.twist[0], want.acceleration[0], q_guess=q, limits=False
        )
        return state.q[chain.motor_q_index], state.v[chain.motor_index]


def _require_reference(chain: ClosedChain, reference: object) -> None:
    as_chain(chain)
    if not callable(reference):
        raise InputError(
            "reference must be a function of instants that gives PlatformSamples, such as "
            f"functools.partial(motions.sinusoidal_motion, home=home), got {type(reference).__name__}; of poses at "
            "instants, functools.partial(motions.spline_motion, knots=instants, poses=poses) makes one"
        )


def _require_wrenches(chain: ClosedChain, wrenches: SimulationWrenches | None) -> None:
    if not callable(wrenches):
        as_wrenches(chain, wrenches)


def _known(
    wrenches: SimulationWrenches | None, t: float, chain: ClosedChain, q: Configuration, v: Tangent
) -> OutsideWrenches | None:
    """Wrenches that a controller reckons with at an instant."""
    said = asked_wrenches(wrenches, t, State(chain, q, v)) if callable(wrenches) else wrenches
    return as_wrenches(chain, said)


def _require_model(model: str) -> None:
    if model not in MODELS:
        raise InputError(f"model must be one of {', '.join(MODELS)}, got {model!r}")
