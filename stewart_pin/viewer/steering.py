"""A robot moved by hand: a demand on platform, motors or any joint, met on the branch where the robot stands, or not.

What is taken hold of is one coordinate of the platform or of a joint; the mechanism's other freedoms stay as they are,
as far as they are independent. A demand that cannot be met leaves the robot where it was, and says why.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from stewart_pin.building.loading import with_motors
from stewart_pin.errors import StewartPinError
from stewart_pin.mechanics.kinematics import forward_kinematics, within_limits
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES, TwistAxis
from stewart_pin.state.newton import Closure, close_loops
from stewart_pin.state.paths import follow_path, pose_path
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray

_INDEPENDENT = 1e-3
"""Share of its size, in natural units, that a coordinate must have beside the others to be taken as one of its own."""
_ASIDE = 0.05
"""How far from home the freedoms are looked at, in robot sizes and radians: home is often symmetric."""
_FAR, _TURN = 0.5, 1.0
"""Reach of a slider where no limit is stated, in robot sizes and radians, to either side of home."""
_NEARER = 0.85
"""Share of the way from home by which each random demand is nearer than the one before."""
_TRIES = 40
"""Random demands of motors until one can be met."""


@dataclass(frozen=True, eq=False)
class Step:
    """Where a demand has led.

    Attributes
    ----------
    state
        The state reached; the one before, where the demand cannot be met.
    said
        What stands in the way, in words; empty where nothing does.
    tau_motor
        (nu,) efforts of a motion at this instant; None: it stands still [N or N m].
    """

    state: State
    said: str = ""
    tau_motor: FloatArray | None = None


@dataclass(frozen=True)
class Grip:
    """A coordinate that can be taken hold of.

    Attributes
    ----------
    name
        Joint, or axis of the platform's twist.
    is_length
        Whether it is a length [m], and not an angle [rad].
    low, high
        Reach of its slider [m or rad].
    """

    name: str
    is_length: bool
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Hand:
    """What of a chain can be taken hold of; made once per chain.

    Attributes
    ----------
    chain
        Closed chain.
    """

    chain: ClosedChain

    @cached_property
    def platform(self) -> tuple[Grip, ...]:
        """Independent coordinates of the platform, as many as it has freedoms; none without a platform."""
        chain = self.chain
        if chain.platform is None:
            return ()
        state = self._aside
        twists = (state.P / chain.twist_sizes[:, None]) @ (chain.tangent_scale[:, None] * state.motions.basis)
        chosen = independent_rows(twists, chain.generic.count.platform)
        at = chain.home_state().pose
        middle = np.concatenate([at.translation, pin.rpy.matrixToRpy(at.rotation)])
        reach = np.repeat([_FAR * chain.length_scale, _TURN], 3)
        return tuple(
            Grip(TWIST_AXES[k], k < 3, float(middle[k] - reach[k]), float(middle[k] + reach[k]))
            for k in sorted(chosen)
        )

    @cached_property
    def motors(self) -> tuple[Grip, ...]:
        """Motors, in their order."""
        return tuple(self._of_joint(name) for name in self.chain.motors)

    @cached_property
    def joints(self) -> tuple[Grip, ...]:
        """Other joints of one freedom, in the order of the model."""
        return tuple(self._of_joint(name) for name in self._single if name not in self.chain.motors)

    @cached_property
    def _single(self) -> dict[str, int]:
        """Joints of one freedom, and the entry of each in the tangent."""
        model = self.chain.model
        return {
            name: joint.idx_v
            for name, joint in zip(model.names[1:], list(model.joints)[1:], strict=True)
            if joint.nv == 1
        }

    @cached_property
    def _aside(self) -> State:
        """A state beside home, where symmetric ones have lost their special place."""
        chain = self.chain
        step = _ASIDE * np.random.default_rng(0).uniform(-1, 1, chain.nv) * chain.tangent_scale
        closure = close_loops(chain, pin.integrate(chain.model, chain.q_home, step), throw=False)
        return closure.state if closure.success else chain.home_state()

    @cached_property
    def _driven(self) -> dict[str, ClosedChain]:
        return {}

    def driven_by(self, joint: str) -> ClosedChain:
        """Drive the chain by a joint; the motors that are independent of it hold still, then other joints.

        Parameters
        ----------
        joint
            Name of a joint of one freedom.

        Returns
        -------
        ClosedChain
            The same chain, its first motor this joint.
        """
        if joint not in self._driven:
            basis = self._aside.motions.basis
            others = [name for name in (*self.chain.motors, *self._single) if name != joint]
            kept = _one_after_the_other(basis, [joint, *others], self._single)
            same = kept == list(self.chain.motors)
            self._driven[joint] = self.chain if same else with_motors(self.chain, kept)
        return self._driven[joint]

    def _of_joint(self, name: str) -> Grip:
        chain, entry = self.chain, self._single[name]
        joint = chain.model.joints[chain.model.getJointId(name)]
        at = float(chain.q_home[joint.idx_q])
        is_length = not chain.angle_mask[entry]
        reach = _FAR * chain.length_scale if is_length else np.pi
        low, high = chain.limits.position[entry]
        low = low if np.isfinite(low) else min(at - reach, high - reach if np.isfinite(high) else np.inf)
        high = high if np.isfinite(high) else max(at + reach, low + reach)
        return Grip(name, is_length, float(low), float(high))


def independent_rows(rows: FloatArray, count: int) -> list[int]:
    """Choose rows that depend least on each other.

    Parameters
    ----------
    rows
        (m, n) in natural units, dimensionless.
    count
        How many.

    Returns
    -------
    list of int
        Numbers of the rows, the most telling first.
    """
    order = np.asarray(qr(rows.T, pivoting=True)[-1])
    return [int(k) for k in order[:count]]


def _one_after_the_other(basis: FloatArray, names: Iterable[str], entries: dict[str, int]) -> list[str]:
    """Take joints, in order, each of which is independent of those before; the first in any case."""
    kept: list[str] = []
    taken = np.zeros((0, basis.shape[1]))
    for name in dict.fromkeys(names):
        own = basis[entries[name]]
        left = own - taken.T @ (taken @ own)
        size = float(np.linalg.norm(left))
        if not kept or size > _INDEPENDENT:
            kept.append(name)
            if size > 0:
                taken = np.vstack([taken, left / size])
    return kept


def move_platform(hand: Hand, state: State, pose: pin.SE3) -> Step:
    """Lead the platform to a pose, as far as its own coordinates go.

    Parameters
    ----------
    hand
        Of the chain.
    state
        Where it stands, loops closed.
    pose
        Platform frame in the world; coordinates that the platform does not have are not asked for.

    Returns
    -------
    Step
        Where it stands then.
    """
    axes: Sequence[TwistAxis] = [axis for axis in TWIST_AXES if axis in {grip.name for grip in hand.platform}]
    start = State(hand.chain, state.q)
    return _judged(start, lambda: follow_path(start, pose_path(start, pose, axes)))


def move_joint(hand: Hand, state: State, joint: str, value: float) -> Step:
    """Lead one joint to a position, motors that are independent of it held.

    Parameters
    ----------
    hand
        Of the chain.
    state
        Where it stands, loops closed.
    joint
        Name of a joint of one freedom.
    value
        Its position [m or rad].

    Returns
    -------
    Step
        Where it stands then.
    """
    driven = hand.driven_by(joint)
    target = state.q[driven.motor_q_index]
    target[driven.motors.index(joint)] = value
    step = _judged(
        state, lambda: forward_kinematics(driven, target, q_guess=state.q, limits=False, throw=False)
    )
    return Step(step.state, f"'{joint}' at {value:.5g}: {step.said}") if step.said else step


def random_reachable(hand: Hand, rng: np.random.Generator) -> Step:
    """Find a random state within the limits, on the branch of home.

    Parameters
    ----------
    hand
        Of the chain.
    rng
        Source of randomness.

    Returns
    -------
    Step
        The state; home, where none was found.
    """
    home = hand.chain.home_state()
    first = hand.chain.motors[:1] or tuple(hand._single)[:1]
    if not first:
        return Step(home, "no joint of one freedom can be led")
    driven = hand.driven_by(first[0])
    grips = [hand._of_joint(name) for name in driven.motors]
    at = home.q[driven.motor_q_index]
    for k in range(_TRIES):
        far = rng.uniform([grip.low for grip in grips], [grip.high for grip in grips])
        target = at + (far - at) * _NEARER**k
        step = _judged(
            home, lambda target=target: forward_kinematics(driven, target, limits=False, throw=False)
        )
        if not step.said:
            return step
    return Step(home, f"none of {_TRIES} random demands of motors could be met")


def _judged(before: State, solve: Callable[[], Closure]) -> Step:
    """Stay where the robot was, unless the demand is met within the limits."""
    chain = before.chain
    try:
        closure = solve()
        if closure.success:
            closure = within_limits(
                Closure(State(chain, closure.q), closure.gap, closure.iterations, success=True),
                "this is",
                throw=False,
                of_pose=True,
            )
    except StewartPinError as error:
        return Step(before, str(error))
    return Step(closure.state) if closure.success else Step(before, closure.reason)
