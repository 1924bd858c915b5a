"""Controllers as a simulation calls them: plain, with a state of their own, sampled; and what moves a state on."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np

from stewart_pin.errors import ConvergenceError, InputError, StewartPinError
from stewart_pin.mechanics.inverse_dynamics import require_idle_inertia
from stewart_pin.motion.simulation.friction import too_many
from stewart_pin.motion.simulation.motors import MotorBank
from stewart_pin.motion.simulation.plant import JointForces, Plant
from stewart_pin.motion.simulation.steppers import ACCOUNTS, Phase
from stewart_pin.state.base_motion import BaseMotion, asked_base
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import OutsideWrenches, Wrenches, as_wrenches, asked_wrenches, outside_efforts
from stewart_pin.state.state import State
from stewart_pin.tolerances import WHOLE_STEPS
from stewart_pin.typing import Configuration, FloatArray, Tangent

Controller = Callable[[float, Configuration, Tangent], FloatArray]
"""(t, q, v) to the motor efforts (nu,) asked for [N or N m]."""


SimulationWrenches = Wrenches | Callable[[float, State], Wrenches | None]
"""{link: (6,)} from outside, or a function of the instant [s] and the state that returns them [N, N m]."""
SimulationBase = BaseMotion | Callable[[float], BaseMotion]
"""Motion of the ground, the same all the time, or a function of the instant [s] that returns it."""


class ControllerFailure(StewartPinError):
    """A controller gave no efforts."""


class WrenchFailure(ControllerFailure):
    """A function gave no wrenches."""


@runtime_checkable
class DynamicController(Protocol):
    """A controller with a state of its own, such as an integral, which the simulation integrates.

    Attributes
    ----------
    state_size
        Number of its states.
    """

    @property
    def state_size(self) -> int: ...  # noqa: D102 - an attribute, see above

    def effort(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Ask for motor efforts.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) [N or N m].
        """
        ...

    def state_rate(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Give the rate of the controller's state.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (state_size,) [1/s].
        """
        ...


@runtime_checkable
class Sampled(Protocol):
    """A controller that acts at instants and holds in between.

    Attributes
    ----------
    rate
        Instants per second [1/s].
    controller
        What acts there.
    """

    @property
    def rate(self) -> float: ...  # noqa: D102 - an attribute, see above
    @property
    def controller(self) -> Controller | DynamicController: ...  # noqa: D102 - an attribute, see above

    def measure(self, q: Configuration, v: Tangent) -> tuple[Configuration, Tangent]:
        """See a state through the sensors.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        q : numpy.ndarray
            (nq,) as measured [m, rad, unit quaternions].
        v : numpy.ndarray
            (nv,) as measured [m/s, rad/s].
        """
        ...


class Drive:
    """One controller during one run.

    Parameters
    ----------
    chain
        Closed chain.
    controller
        Controller, or None for motors without effort.
    dt
        Step of the simulation [s].
    """

    def __init__(
        self, chain: ClosedChain, controller: Controller | DynamicController | Sampled | None, dt: float
    ) -> None:
        self._chain = chain
        self._sampled = controller if isinstance(controller, Sampled) else None
        self._inner = self._sampled.controller if self._sampled is not None else controller
        self._dynamic = self._inner if isinstance(self._inner, DynamicController) else None
        self.every = 0 if self._sampled is None else _multiple(1.0 / self._sampled.rate, dt)
        self._period = self.every * dt
        self._held = np.zeros(chain.nu)

    @property
    def state_size(self) -> int:
        """Number of states of the controller."""
        return 0 if self._dynamic is None else self._dynamic.state_size

    @property
    def held(self) -> FloatArray:
        """(nu,) efforts held since the last sample [N or N m]."""
        return self._held

    def hold(self, efforts: FloatArray) -> None:
        """Go on from efforts sampled earlier.

        Parameters
        ----------
        efforts
            (nu,) [N or N m].
        """
        self._held = efforts

    def sample(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Act once, if the controller is a sampled one.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (state_size,) state after the sample [m s or rad s].
        """
        assert self._sampled is not None
        try:
            q, v = self._sampled.measure(q, v)
        except StewartPinError as error:
            raise ControllerFailure(f"the sensors failed at {t:g} s: {error}") from error
        self._held = self._ask(t, q, v, state)
        if self._dynamic is not None:
            state = state + self._period * self._dynamic.state_rate(t, q, v, state)
        return state

    def effort(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Return the efforts that the controller asks for now.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) [N or N m].
        """
        return self._held if self._sampled is not None else self._ask(t, q, v, state)

    def state_rate(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        """Return the rate of the controller's state; zero between samples.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        state
            (state_size,) state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (state_size,) [1/s].
        """
        if self._dynamic is None or self._sampled is not None:
            return np.zeros(state.size)
        return self._dynamic.state_rate(t, q, v, state)

    def _ask(self, t: float, q: Configuration, v: Tangent, state: FloatArray) -> FloatArray:
        if self._inner is None:
            return self._held
        try:
            answer = (
                self._inner(t, q, v) if self._dynamic is None else self._dynamic.effort(t, q, v, state)  # type: ignore[operator]
            )
        except StewartPinError as error:
            raise ControllerFailure(f"the controller failed at {t:g} s: {error}") from error
        efforts = np.asarray(answer, dtype=float)
        if efforts.shape != (self._chain.nu,):
            raise ControllerFailure(
                f"the controller must return {self._chain.nu} motor efforts, got shape {efforts.shape} at {t:g} s"
            )
        if not np.isfinite(efforts).all():
            raise ControllerFailure(f"the controller returned {efforts} at {t:g} s: efforts must be finite")
        return efforts


def _multiple(period: float, dt: float) -> int:
    count = round(period / dt)
    if count < 1 or abs(count * dt - period) > WHOLE_STEPS * period:
        raise InputError(
            f"the controller's period {period:g} s must be a multiple of dt = {dt:g} s; "
            f"choose dt = {period / max(1, round(period / dt)):g} s"
        )
    return count


# ----------------------------------------------------------------------------------------------------
# What acts from outside
# ----------------------------------------------------------------------------------------------------


class Push:
    """What acts from outside during one run: wrenches, and a ground that moves.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        {link: (6,)}, or a function of the instant and the state that returns them, or None [N, N m].
    base_motion
        Motion of the ground, or a function of the instant that returns it, or None.
    """

    def __init__(
        self,
        chain: ClosedChain,
        wrenches: SimulationWrenches | None,
        base_motion: SimulationBase | None = None,
    ) -> None:
        self._chain = chain
        self._function = wrenches if callable(wrenches) else None
        self._constant = None if callable(wrenches) else as_wrenches(chain, wrenches)
        if not (base_motion is None or callable(base_motion) or isinstance(base_motion, BaseMotion)):
            raise InputError(
                f"base_motion must be a BaseMotion or a function of the instant, got {type(base_motion).__name__}"
            )
        self._base = base_motion

    def at(
        self, t: float, q: Configuration, v: Tangent, *, weightless: bool
    ) -> tuple[OutsideWrenches | None, FloatArray] | None:
        """Tell what acts at an instant, and what it does to the joints.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        weightless
            Whether some motion has no inertia, so that nothing may push it.

        Returns
        -------
        tuple or None
            Wrenches, and (nv,) joint efforts that do the same work, with what a moving ground makes the bodies feel
            [N, N m]; None where nothing acts.

        Raises
        ------
        WrenchFailure
            If a function gives no wrenches or no motion, or they push an idle freedom that has no inertia.
        """
        if self._function is None and self._constant is None and self._base is None:
            return None
        outside, pushed = self._constant, np.zeros(self._chain.nv)
        try:
            base = asked_base(self._base, t) if callable(self._base) else self._base
            state = State(self._chain, q, v, base_motion=base)
            if self._function is not None:
                outside = as_wrenches(self._chain, asked_wrenches(self._function, t, state))
            if outside is None and base is None:
                return None
            if outside is not None:
                pushed = outside_efforts(state, outside)
            if base is not None:
                # What those who stand on the ground feel beside a weight that keeps its direction.
                pushed = pushed + State(self._chain, q, v).nle - state.nle
            if weightless:
                require_idle_inertia(state, pushed)
        except StewartPinError as error:
            what = "the wrenches" if self._base is None else "the wrenches or the ground"
            raise WrenchFailure(f"{what} failed at {t:g} s: {error}") from error
        return outside, pushed


# ----------------------------------------------------------------------------------------------------
# What moves a state on: efforts of the drives, losses and accelerations, asked once where they are needed twice
# ----------------------------------------------------------------------------------------------------


class Flow:
    """Rates of a state under its controller; those of the state that was asked for last are known.

    A recorded instant, its events and the first stage of the step from there ask for the same: controllers are asked
    once. Arrays of a state are never written to, so that a state is known by them.

    Parameters
    ----------
    drive
        Controller.
    bank
        Motors.
    plant
        Mechanism.
    push
        Wrenches from outside.
    """

    def __init__(self, drive: Drive, bank: MotorBank, plant: Plant, push: Push) -> None:
        self._drive, self._bank, self._plant, self._push = drive, bank, plant, push
        self._motor_q, self._motor_v = plant.chain.motor_q_index, plant.chain.motor_index
        self._joints: JointForces | None = None
        self._given = np.zeros(plant.chain.nv)
        if plant.friction is not None:
            self._friction = plant.friction
            self._rub_of_motors = plant.friction.shares(self._motor_v, bank.coulomb)
        self.forget()

    def forget(self) -> None:
        """Compute anew next time: the plant has chosen other ways."""
        self._asked: tuple[float, Configuration, Tangent, FloatArray] | None = None
        self._rates: tuple[Tangent, FloatArray] | None = None
        self._outside: OutsideWrenches | None = None

    def command(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> FloatArray:
        """Ask the controller.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Accounts of energy [J], and the state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) efforts asked for [N or N m].
        """
        known = self._asked
        if known is None or known[0] != t or known[1] is not q or known[2] is not v or known[3] is not x:
            self._command = self._drive.effort(t, q, v, x[ACCOUNTS:])
            self._asked, self._rates = (t, q, v, x), None
        return self._command

    def delivered(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> FloatArray:
        """Compute what the motors give.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Accounts of energy [J], and the state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) efforts [N or N m].
        """
        return self._bank.delivered(self.command(t, q, v, x), v[self._motor_v])

    def rates(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> tuple[Tangent, FloatArray]:
        """Compute how a state moves on.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration, loops closed or nearly so [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Accounts of energy [J], and the state of the controller [m s or rad s].

        Returns
        -------
        a : numpy.ndarray
            (nv,) tangent acceleration [m/s², rad/s²].
        x_rate : numpy.ndarray
            Rate of `x` [W, and the controller's per s].

        Raises
        ------
        ConvergenceError
            If the velocity is no number.
        WrenchFailure
            If a function gives no wrenches, or they push an idle freedom that has no inertia.
        """
        if not math.isfinite(v @ v):
            raise ConvergenceError("the velocity grows beyond all numbers", residual=math.inf)
        given, rate = self.delivered(t, q, v, x), v[self._motor_v]
        if self._rates is None:
            loss, viscous, stops = self._bank.losses(q[self._motor_q], rate)
            pushed = self._push.at(t, q, v, weightless=self._plant.weightless)
            self._outside, efforts = (None, None) if pushed is None else pushed
            joints = self._plant.joint_forces(q, v)
            work = given @ rate, 0.0 if efforts is None else efforts @ v
            x_rate = np.empty(x.size)
            x_rate[:ACCOUNTS] = *work, *self._heat(joints, viscous), stops
            x_rate[ACCOUNTS:] = self._drive.state_rate(t, q, v, x[ACCOUNTS:])
            a = self._plant.acceleration(q, v, given + loss, efforts, joints)
            self._rates, self._joints = (a, x_rate), joints
            self._given = np.zeros(v.size) if efforts is None else efforts.copy()
            self._given[self._motor_v] += given + loss
        return self._rates

    def _heat(self, joints: JointForces | None, viscous: float) -> tuple[float, float, float]:
        """Heat of dampers, of dry friction, and of what the motors add to both [W]."""
        if joints is None:
            return 0.0, 0.0, viscous
        by_motors = float(self._rub_of_motors @ joints.friction) if joints.friction.size else 0.0
        return joints.damping, float(joints.friction.sum()) - by_motors, viscous + by_motors

    # -- dry friction, as steppers ask for it ------------------------------------------------------------------------

    def _balance(self, t: float, phase: Phase) -> tuple[State, Tangent, Tangent]:
        """State, acceleration, and joint efforts of all but loops and what is stuck."""
        a, _ = self.rates(t, phase.q, phase.v, phase.x)
        joints = self._joints
        assert joints is not None
        return joints.state, a, self._given + joints.efforts

    def margin(self, t: float, phase: Phase) -> float:
        """Tell how far a state is from where something sticks or slips.

        Parameters
        ----------
        t
            Time [s].
        phase
            The state.

        Returns
        -------
        float
            As `Friction.margin`.
        """
        return self._friction.margin(*self._balance(t, phase))

    def settle(self, t: float, phase: Phase, *, within: bool) -> Phase:
        """Find anew what slips and what is stuck.

        Parameters
        ----------
        t
            Time [s].
        phase
            The state.
        within
            Whether a smooth stretch has ended here; else only if something has jumped.

        Returns
        -------
        Phase
            The same, what is stuck exactly at rest.
        """
        friction, plant, x = self._friction, self._plant, phase.x
        if not within and friction.settled and not friction.unsettled(*self._balance(t, phase)):
            return phase

        def free(state: State) -> Tangent:
            q, v = state.q, state.v
            rate = v[self._motor_v]
            given = self._bank.delivered(self._drive.effort(t, q, v, x[ACCOUNTS:]), rate)
            pushed = self._push.at(t, q, v, weightless=plant.weightless)
            efforts = None if pushed is None else pushed[1]
            loss = self._bank.losses(q[self._motor_q], rate)[0]
            return plant.acceleration(q, v, given + loss, efforts, held=False)

        state = friction.settle(State(plant.chain, phase.q, phase.v), free, plant.project, within=within)
        self.forget()
        gap = float(np.abs(state.gap).max(initial=0.0))
        return phase._replace(q=np.array(state.q), v=np.array(state.v), gap=gap)

    def require_charted(self) -> None:
        """Refuse what no chart can hold.

        Raises
        ------
        UnsupportedError
            As `Friction.require_charted`.
        """
        self._friction.require_charted()

    def too_many(self, t: float, h: float, count: int) -> Exception:
        """Say that friction changes without end.

        Parameters
        ----------
        t
            Time [s].
        h
            Step [s].
        count
            How often it did.

        Returns
        -------
        ConvergenceError
            To raise.
        """
        return too_many(self._friction.names, t, h, count)

    def outside(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> OutsideWrenches | None:
        """Tell what acts from outside.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration, loops closed or nearly so [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Accounts of energy [J], and the state of the controller [m s or rad s].

        Returns
        -------
        OutsideWrenches or None
            None where nothing acts.
        """
        self.rates(t, q, v, x)
        return self._outside
