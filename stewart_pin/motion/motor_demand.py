"""What motions of the platform ask of the motors: in closed form, by kernels or one by one; and the judge of limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import ClosureError, EffortLimitError, InputError, UnsupportedError
from stewart_pin.kernels.choosing import kernels_for
from stewart_pin.kernels.kernels import Kernels
from stewart_pin.mechanics.closed_forms import LegForm, leg_form
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics_by
from stewart_pin.mechanics.kinematics import inverse_kinematics, platform_motion
from stewart_pin.mechanics.sharing import Sharer, Sharing, sharer
from stewart_pin.model.tree import Limits
from stewart_pin.motion.joint_motion import asked_of_motors, asked_of_others
from stewart_pin.motion.simulation.record import Simulation
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.base_motion import BaseMotion, BaseMotions, base_motions
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import turning_motors
from stewart_pin.state.limits import Asked, Excess
from stewart_pin.state.newton import Closure
from stewart_pin.state.outside import MotionWrenches, WrenchSamples, wrench_samples
from stewart_pin.state.state import State, as_chain
from stewart_pin.typing import ArrayLike, FloatArray

DemandMethod = Literal["closed_form", "kernels", "one_state"]
"""Ways to compute a demand; they give the same numbers, to round-off."""

_CLOSED_FORM = 100
"""States that the closed form does in the time that the one-state verbs take for one."""
_CHUNK = 1 << 16
"""States in one call of a kernel: 20 MB of Jacobians."""
_QUARTER = np.pi / 2
"""Angle between two instants up to which the nearest whole turn is the one that a motor has made [rad]."""


@dataclass(frozen=True, eq=False, repr=False)
class MotorDemand(Brief):
    """What a motion asks of the motors.

    Attributes
    ----------
    time
        (N,) [s].
    positions
        (N, nu); an angle goes on from the instant before by less than half a turn, see `turns_unsure` [m or rad].
    rates
        (N, nu) [m/s or rad/s].
    efforts
        (N, nu) [N or N m].
    chain
        Whose motors.
    samples
        Motion of the platform that asks for it.
    method
        How it was computed: by a closed form that was admitted for the chain, by kernels, or state by state.
    wrenches
        What acts from outside, or None.
    """

    time: FloatArray
    positions: FloatArray
    rates: FloatArray
    efforts: FloatArray
    chain: ClosedChain = field(repr=False)
    samples: PlatformSamples = field(repr=False)
    method: DemandMethod = "one_state"
    wrenches: WrenchSamples | None = field(default=None, repr=False)

    @property
    def turns_unsure(self) -> dict[str, float]:
        """Motors that may have turned further between two instants than poses tell, with the first time [s].

        The rates at both instants then speak for another number of whole turns than `positions` count: sample the
        motion more finely. Of poses that do not follow each other in time they say nothing.
        """
        step = np.diff(self.time)[:, None] * (self.rates[1:] + self.rates[:-1]) / 2
        missed = np.abs(step - np.diff(self.positions, axis=0)) > np.pi
        missed &= turning_motors(self.chain)
        return {
            motor: float(self.time[int(np.argmax(missed[:, k]))])
            for k, motor in enumerate(self.chain.motors)
            if missed[:, k].any()
        }

    def holds(self) -> bool:
        """Tell whether every limit holds, as `check`, but ask the other joints only where the motors keep theirs.

        Returns
        -------
        bool
            False too where joints that have limits cannot follow the motion.
        """
        chain = self.chain
        asked = asked_of_motors(chain, self.positions, self.rates, self.efforts)
        if chain.judge.excesses(asked):
            return False
        try:
            return not chain.judge.excesses(asked_of_others(chain, self.samples))
        except ClosureError:
            return False

    def check(self) -> tuple[Excess, ...]:
        """List the limits that the motion exceeds: of the motors, of passive joints and of joints that close loops.

        Returns
        -------
        tuple of Excess
            Each at its worst instant; empty where all limits hold that are stated.

        Raises
        ------
        ClosureError
            If joints that no motor moves have limits, and cannot follow the motion.
        """
        chain = self.chain
        asked = asked_of_motors(chain, self.positions, self.rates, self.efforts)
        asked += asked_of_others(chain, self.samples)
        return chain.judge.excesses(asked, time=self.time)


def motor_demand(
    chain: ClosedChain,
    samples: PlatformSamples,
    *,
    wrenches: MotionWrenches | None = None,
    base_motion: BaseMotions | None = None,
    kernels: bool | None = None,
    effort_limit: ArrayLike | Limits | None = None,
    sharing: Sharing = "least_norm",
) -> MotorDemand:
    """Compute what a platform motion asks of the motors, whatever the limits; the answer's `check` judges them.

    Parameters
    ----------
    chain
        Closed chain.
    samples
        Motion of the platform.
    wrenches
        What acts from outside: {link: (6,) or (N, 6)} [force; moment] on the link, at the origin of its frame, world
        axes, the same all the time or one per instant; or a function of the instant that returns {link: (6,)}; the
        platform is ``chain.platform`` [N, N m].
    base_motion
        How the ground moves: a `dynamics.BaseMotion`, one per instant, or a function of the instant; the motion of the
        platform is relative to it, wrenches have the axes of the inertial frame. Default: it rests.
    kernels
        Whether to use compiled kernels, where the chain has them; None: for more than a handful of states, of platforms
        with a closed form for tens of thousands. The answer is the same, to round-off.
    effort_limit, sharing
        How redundant motors share the load, as in `inverse_dynamics`: cables, which only pull, with ``chain.limits``.
        Default: by least norm, whatever the limits [N or N m].

    Returns
    -------
    MotorDemand
        Positions, rates and efforts, and by which method. Without kernels in closed form where one stands for the chain
        (`closed_forms`), and state by state for other chains; so too where the chain cannot be compiled, has a coupling
        that counts turns, such as a thread or a gear, where a motor turns by more than a quarter between two instants,
        or where kernels have no answer for a state. Of wrenches the closed form takes those on the platform, kernels
        all but at points that spin idly.

    Raises
    ------
    ClosureError
        If the chain cannot take a pose.
    ActuationError
        If the motors cannot hold it.
    EffortLimitError
        If no efforts within `effort_limit` make it move so; the instant is told.
    MissingExtraError
        If kernels are wanted and CasADi is not installed.
    UnsupportedError
        If kernels are wanted for the least peak.
    InputError
        If samples, wrenches or motions of the ground are none.
    """
    as_chain(chain)
    if not isinstance(samples, PlatformSamples):
        raise InputError(
            f"samples must be PlatformSamples, as sinusoidal_motion gives, got {type(samples).__name__}"
        )
    outside, grounds = wrench_samples(chain, wrenches, samples.time), base_motions(base_motion, samples.time)
    sharing_by = sharer(chain, effort_limit, sharing)
    moves = grounds is not None
    compiled, found = demand_kernels(chain, len(samples), kernels, outside, sharing, ground_moves=moves), None
    if compiled is not None:
        pushed = None if outside is None else outside.rows
        found = demands_by_kernels(compiled, [samples], pushed, grounds, sharing=sharing_by)[0]
        if isinstance(found, MotorDemand):
            return replace(found, wrenches=outside)
    return demand_by_formula(
        chain, samples, suspect=found, outside=outside, grounds=grounds, sharing=sharing_by
    )


def demand_kernels(
    chain: ClosedChain,
    states: float,
    wanted: bool | None,
    outside: WrenchSamples | None = None,
    sharing: Sharing | None = None,
    *,
    ground_moves: bool = False,
) -> Kernels | None:
    """Compile kernels, if so many states are worth it.

    Parameters
    ----------
    chain
        Closed chain.
    states
        Number of states.
    wanted
        True, False or None, as in `motor_demand`.
    outside
        Wrenches from outside, or None.
    sharing
        How redundant motors share.
    ground_moves
        Whether the ground moves.

    Returns
    -------
    Kernels or None
        Kernels, or None where a demand is better computed without, or the chain has none that know its turns.

    Raises
    ------
    UnsupportedError
        If they are wanted for the least peak.
    """
    if sharing == "least_peak":
        if wanted:
            raise UnsupportedError(
                "kernels know of no least peak; leave kernels= out, or choose another sharing="
            )
        return None
    links = () if outside is None else outside.links
    closed_form = (
        wanted is None
        and not ground_moves
        and (outside is None or outside.acts_on_platform(chain))
        and leg_form(chain, "leg_efforts") is not None
    )
    try:
        return kernels_for(
            chain, int(states) // (_CLOSED_FORM if closed_form else 1), wanted, links, ground_moves
        )
    except UnsupportedError:
        return None


def demands_by_kernels(
    kernels: Kernels,
    motions: Sequence[PlatformSamples],
    pushed: FloatArray | None = None,
    grounds: Sequence[BaseMotion] | None = None,
    *,
    sharing: Sharer | None = None,
) -> list[MotorDemand | int | None]:
    """Compute the demands of several motions, all states at once.

    Parameters
    ----------
    kernels
        Kernels of the chain, in platform coordinates.
    motions
        Motions of the platform.
    pushed
        (N, 6 k) wrenches at all their instants, for kernels that were compiled for some [N, N m].
    grounds
        N motions of the ground, for kernels that were compiled for them.
    sharing
        How redundant motors share within limits, or None.

    Returns
    -------
    list of MotorDemand, int or None
        For each motion its demand, bit for bit the same in any company; the index of its first state whose pose is out
        of reach of a leg; or None where it has to be followed from state to state.
    """
    ends = np.cumsum([len(samples) for samples in motions])
    pose = _poses(motions)
    twist = np.concatenate([samples.twist for samples in motions])
    acceleration = np.concatenate([samples.acceleration for samples in motions])
    positions, rates, efforts = (np.empty((len(pose), kernels.chain.nu)) for _ in range(3))
    codes = np.zeros((2, len(pose)), dtype=np.int8)
    limited: dict[str, Any] = {}
    if sharing is not None:
        limited = {"effort_limit": sharing.bounds, "sharing": sharing.sharing}
    for begin in range(0, len(pose), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        state = (pose[part], twist[part], acceleration[part])
        kernels.inverse_kinematics(pose[part], out=positions[part], status=codes[0, part])
        np.einsum("nij,nj->ni", kernels.motor_jacobian(pose[part]), twist[part], out=rates[part])
        loads = () if pushed is None else (pushed[part],)
        ground = None if grounds is None else grounds[part]
        kernels.inverse_dynamics(
            *state, *loads, base_motion=ground, **limited, out=efforts[part], status=codes[1, part]
        )
    answered = (codes == StateStatus.OK).all(axis=0)
    turning = turning_motors(kernels.chain)
    found: list[MotorDemand | int | None] = []
    for samples, end in zip(motions, ends, strict=True):
        part = slice(end - len(samples), end)
        if not answered[part].all():
            # What Newton steps from home do not find may be found from the state before.
            lost = codes[0, part] != StateStatus.OK
            found.append(int(np.argmax(lost)) if kernels.by_legs and lost.any() else None)
            continue
        if turning.any():
            # Angles are those of home's branch; they go on where a motor has turned further.
            angles = np.unwrap(positions[part, turning], axis=0)
            if np.abs(np.diff(angles, axis=0)).max(initial=0.0) > _QUARTER:
                found.append(None)
                continue
            positions[part, turning] = angles
        found.append(
            MotorDemand(
                samples.time, positions[part], rates[part], efforts[part], kernels.chain, samples, "kernels"
            )
        )
    return found


def demand_by_formula(
    chain: ClosedChain,
    samples: PlatformSamples,
    *,
    suspect: int | None = None,
    outside: WrenchSamples | None = None,
    grounds: Sequence[BaseMotion] | None = None,
    sharing: Sharer | None = None,
) -> MotorDemand:
    """Compute a demand in closed form where there is one, and state by state elsewhere.

    Parameters
    ----------
    chain
        Closed chain.
    samples
        Motion of the platform.
    suspect
        Index of a state that no leg reaches, by its closed form: it is looked at first, so that the error comes soon.
    outside
        Wrenches from outside, or None.
    grounds
        Motion of the ground at every instant, or None: it rests.
    sharing
        How redundant motors share within limits, or None.

    Returns
    -------
    MotorDemand
        Positions, rates and efforts.

    Raises
    ------
    ClosureError
        If the chain cannot take a pose.
    ActuationError
        If the motors cannot hold it.
    EffortLimitError
        If no efforts within the limits make it move so.
    """
    if grounds is not None:
        return _state_by_state(chain, samples, outside, grounds, sharing)
    closed_form = leg_form(chain, "leg_efforts") if sharing is None else None
    if closed_form is not None:
        pushed = None if outside is None else outside.on_platform(chain, samples.rotation)
        if outside is None or pushed is not None:
            return _by_closed_form(chain, closed_form, samples, outside, pushed)
    if suspect is not None:
        # Rounded, since sinusoids of other frequencies come to the same place but for the last bit.
        place = (np.round(samples.position[suspect], 12), np.round(samples.rotation[suspect], 12))
        out_of_reach = _reach(chain, *(values.tobytes() for values in place))
        if out_of_reach is not None:
            raise out_of_reach.with_traceback(None)
    return _state_by_state(chain, samples, outside, None, sharing)


def _by_closed_form(
    chain: ClosedChain,
    legs: LegForm,
    samples: PlatformSamples,
    outside: WrenchSamples | None,
    pushed: FloatArray | None,
) -> MotorDemand:
    place = (samples.position, samples.rotation)
    return MotorDemand(
        time=samples.time,
        positions=legs.positions(*place),
        rates=legs.rates(*place, samples.twist),
        efforts=legs.efforts(*place, samples.twist, samples.acceleration, pushed),
        chain=chain,
        samples=samples,
        method="closed_form",
        wrenches=outside,
    )


@lru_cache(maxsize=256)
def _reach(chain: ClosedChain, position: bytes, rotation: bytes) -> ClosureError | None:
    """Find out why a pose cannot be reached, which takes a tenth of a second; motions of one amplitude share theirs."""
    pose = pin.SE3(np.frombuffer(rotation).reshape(3, 3), np.frombuffer(position))
    try:
        inverse_kinematics(chain, pose, limits=False)
    except ClosureError as error:
        return error
    return None


def _state_by_state(
    chain: ClosedChain,
    samples: PlatformSamples,
    outside: WrenchSamples | None = None,
    grounds: Sequence[BaseMotion] | None = None,
    sharing: Sharer | None = None,
) -> MotorDemand:
    shape = (len(samples), chain.nu)
    positions, rates, efforts = np.empty(shape), np.empty(shape), np.empty(shape)
    q = chain.q_home
    for k in range(len(samples)):
        motion = samples.pose(k), samples.twist[k], samples.acceleration[k]
        state = platform_motion(chain, *motion, q_guess=q, limits=False)
        pushed = None if outside is None else outside.at(k)
        if grounds is not None:
            state = chain.at(state.q, state.v, state.a, base_motion=grounds[k])
        q, a = state.q, state.require_accelerating()
        try:
            efforts[k] = inverse_dynamics_by(state, a, pushed, sharing).tau_motor
        except EffortLimitError as error:
            raise error.at(float(samples.time[k]), k) from None
        positions[k], rates[k] = q[chain.motor_q_index], state.v[chain.motor_index]
    return MotorDemand(samples.time, positions, rates, efforts, chain, samples, wrenches=outside)


def _poses(motions: Sequence[PlatformSamples]) -> FloatArray:
    """Position and quaternion of all instants, one motion after the other [m, unit quaternion]."""
    # One orientation for all instants, as sinusoids have, is turned into a quaternion once.
    steady = [samples.rotation.strides[0] == 0 for samples in motions]
    rotations = [
        samples.rotation[:1] if one else samples.rotation
        for samples, one in zip(motions, steady, strict=True)
    ]
    times = [
        np.full(len(kept), len(samples) // max(1, len(kept)))
        for samples, kept in zip(motions, rotations, strict=True)
    ]
    quaternions = Rotation.from_matrix(np.concatenate(rotations)).as_quat()
    positions = np.concatenate([samples.position for samples in motions])
    return np.hstack([positions, np.repeat(quaternions, np.concatenate(times), axis=0)])


# ----------------------------------------------------------------------------------------------------
# The public judge of limits: of a state, of what a motion asks for, and of what a simulation did
# ----------------------------------------------------------------------------------------------------


def limits_exceeded(
    what: State | Closure | MotorDemand | Simulation, *, tau_motor: ArrayLike | None = None
) -> tuple[Excess, ...]:
    """List the limits that do not hold.

    Kinematics, simulations, fits, sweeps, polytopes and the command line ask the same judge.

    Parameters
    ----------
    what
        A state, whose positions, velocities and accelerations are judged, or a solution of kinematics; what a motion
        asks of the motors, by `motor_demand`; or a simulation.
    tau_motor
        (nu,) motor efforts to judge together with a state [N or N m].

    Returns
    -------
    tuple of Excess
        Motors, passive joints and joints that close loops, each with its value, the limit and by how much it is passed;
        of a motion at its worst instant. Empty where all limits hold that are stated.

    Raises
    ------
    InputError
        If it is none of these.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> long = stp.forward_kinematics(chain, [1.85, 1.7, 1.7, 1.7, 1.7, 1.7], limits=False)
    >>> print(*stp.limits_exceeded(long))
    'leg1' at 1.85, allowed 0.5 to 1.8
    """
    if isinstance(what, MotorDemand | Simulation):
        if tau_motor is not None:
            raise InputError("tau_motor is for a state; demands and simulations have efforts of their own")
        return what.check()
    state = what.state if isinstance(what, Closure) else what
    if not isinstance(state, State):
        raise InputError(
            f"limits_exceeded takes a State (chain.at(q, v, a)), a MotorDemand or a Simulation, got "
            f"{type(what).__name__}"
        )
    chain = state.chain
    a = None if state.a is None else state.a[None]
    asked = chain.judge.asked(state.q[None], state.v[None], a)
    if tau_motor is not None:
        efforts = as_array("tau_motor", tau_motor, (chain.nu,))
        asked.append(Asked("effort", np.asarray(chain.motor_index), efforts[None]))
    return chain.judge.excesses(asked)
