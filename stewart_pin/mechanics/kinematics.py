"""Kinematics of a closed chain: pose to configuration and back, motions, and the motor Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args, overload

import numpy as np
import pinocchio as pin
from scipy.linalg import get_lapack_funcs, qr

from stewart_pin.checks import as_array
from stewart_pin.errors import ClosureError, InputError, SingularityError, UnreachableError
from stewart_pin.mechanics.forward_solutions import ForwardSolutions, all_forward_kinematics
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.state.freedom import TWIST_AXES, Motions, OwnMotion, TwistAxis, split_motions
from stewart_pin.state.newton import Closure, close_loops
from stewart_pin.state.paths import follow_path, motor_path, pose_path
from stewart_pin.state.state import State, as_chain, as_state
from stewart_pin.tolerances import FAR_FROM_SINGULAR, SINGULAR
from stewart_pin.typing import ArrayLike, FloatArray, Tangent

_getrf, _gecon, _lange, _getrs = get_lapack_funcs(("getrf", "gecon", "lange", "getrs"), dtype=np.float64)
_CONSISTENT = 1e-8
"""Part of a demanded motion that may be left over by round-off, relative to its size."""
PoseAxis = Literal["x", "y", "z", "roll", "pitch", "yaw"]
POSE_AXES: tuple[PoseAxis, ...] = get_args(PoseAxis)
"""Parts of a pose: of its origin in the world, and of its rotation about the world's axes."""
_ALONG = 1e-6
"""Part of a twist beside an axis that is round-off of a configuration with closed loops, in natural units."""


def platform_pose(chain: ClosedChain | State, q: ArrayLike | None = None) -> pin.SE3:
    """Locate the platform frame.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration, with a chain [m, rad, unit quaternions].

    Returns
    -------
    pinocchio.SE3
        oMp, the platform frame in the world.
    """
    return pin.SE3(as_state(chain, q).pose)


def motor_positions(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    """Pick the motor coordinates out of a configuration.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nu,) in the order of ``chain.motors``; for a leg, its length [m or rad].
    """
    state = as_state(chain, q)
    return state.q[state.chain.motor_q_index]


def inverse_kinematics(
    chain: ClosedChain,
    pose: pin.SE3 | ArrayLike,
    *,
    only: Sequence[PoseAxis] | None = None,
    q_guess: ArrayLike | None = None,
    limits: bool = True,
    throw: bool = True,
) -> Closure:
    """Find the whole configuration of a platform pose.

    The pose is followed from that of the guess along the screw between the two, so that the solution stays on the
    branch of the guess: the same assembly mode, elbows on the same side.

    Parameters
    ----------
    chain
        Closed chain.
    pose
        Platform frame in the world: a placement, x y z qx qy qz qw, or a matrix (4, 4) [m].
    only
        Which parts of the pose are asked for, the rest being left to the mechanism: ``x``, ``y``, ``z`` of its origin,
        and ``roll``, ``pitch``, ``yaw``, components about the world's x, y and z of the rotation vector that is left
        between the pose and the one reached; default: all. A platform of fewer freedoms meets all six only to the
        digits of the pose and of its own geometry.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions]; default: home.
    limits
        Whether joint limits must hold.
    throw
        Whether failure raises; otherwise it is returned with ``success=False``.

    Returns
    -------
    Closure
        Configuration and residual reached.

    Raises
    ------
    ClosureError
        If the chain cannot take the pose, or only on another branch, beyond a singularity; carries the residual.
    UnreachableError
        If a joint limit is exceeded; names the joints and their values.

    Notes
    -----
    See `stewart_pin.state.paths` for what keeps the branch. From a guess that is singular itself, where branches meet,
    any of them will do.
    """
    as_chain(chain)
    pose, axes = as_pose("pose", pose), _asked_for(only)
    start = _start(chain, q_guess)
    closure = follow_path(start, pose_path(start, pose, axes))
    if not closure.success and throw:
        try:
            closure.or_raise(_said_of_platform(start))
        except ClosureError as error:
            error.args = (f"{error.args[0]}{_some_axes(start) if only is None else ''}", *error.args[1:])
            raise
    return within_limits(closure, "the pose is", throw=throw, of_pose=True) if limits else closure


@overload
def forward_kinematics(
    chain: ClosedChain,
    q_motor: ArrayLike,
    *,
    q_guess: ArrayLike | None = None,
    limits: bool = True,
    throw: bool = True,
    all: Literal[False] = False,
) -> Closure: ...
@overload
def forward_kinematics(
    chain: ClosedChain, q_motor: ArrayLike, *, limits: bool = True, all: Literal[True]
) -> ForwardSolutions: ...
def forward_kinematics(
    chain: ClosedChain,
    q_motor: ArrayLike,
    *,
    q_guess: ArrayLike | None = None,
    limits: bool = True,
    throw: bool = True,
    all: bool = False,
) -> Closure | ForwardSolutions:
    """Find the whole configuration of given motor positions, on the assembly mode of the guess.

    The motors are followed from where they are at the guess, all in proportion, turns of continuous joints counted: the
    assembly mode is kept along that path, or the answer is refused.

    Parameters
    ----------
    chain
        Closed chain.
    q_motor
        (nu,) motor positions in the order of ``chain.motors`` [m or rad].
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions]; default: home.
    limits
        Whether joint limits must hold, as for `inverse_kinematics`: those of the motors asked for, of passive joints
        and of joints that close loops. Without them the geometry alone answers.
    throw
        Whether failure raises; otherwise it is returned with ``success=False``.
    all
        Whether to search other assembly modes as well, from many starts: `all_forward_kinematics`.

    Returns
    -------
    Closure or ForwardSolutions
        Configuration and residual reached, `platform_pose` gives the pose; with ``all`` every configuration found,
        which may not be every one there is.

    Raises
    ------
    MissingRoleError
        If the chain has no motors.
    ClosureError
        If the loops do not close on these motor positions, or the path to them ends at a singularity; carries the
        residual reached.
    UnreachableError
        If a joint limit is exceeded; names the joints and their values.
    """
    as_chain(chain)
    chain.require_motors()
    target = as_array("q_motor", q_motor, (chain.nu,))
    if all:
        return all_forward_kinematics(chain, target, limits=limits)
    start = _start(chain, q_guess)
    path = motor_path(start, target)
    closure = follow_path(start, path)
    spare = chain.nu - chain.generic.count.motor
    if not closure.success and spare:
        told = (
            f"{closure.reason}; {chain.nu} motors stand for {chain.generic.count.motor} freedom(s), so their"
        )
        closure = replace(closure, reason=f"{told} positions must agree to the last digits")
    if not closure.success:
        return closure.or_raise(path.demand) if throw else closure
    return within_limits(closure, "the motor positions are", throw=throw) if limits else closure


def platform_motion(
    chain: ClosedChain,
    pose: pin.SE3 | ArrayLike,
    twist: ArrayLike,
    acceleration: ArrayLike,
    *,
    q_guess: ArrayLike | None = None,
    limits: bool = True,
) -> State:
    """Find the motion of the whole chain from that of the platform.

    Idle freedoms, which neither loops nor platform determine, carry no momentum and follow their own inertia,
    Nᵀ M v = 0 and Nᵀ (M a + h) = 0, as in `inverse_dynamics` and `motion_map`: a round rod between two balls does not
    turn about its axis. Other motors than the platform needs, of a redundant arm, get the least-norm motion.

    Parameters
    ----------
    chain
        Closed chain.
    pose
        Platform frame in the world: a placement, x y z qx qy qz qw, or a matrix (4, 4) [m].
    twist
        (6,) velocity of the platform origin and angular velocity, in world axes [m/s, rad/s].
    acceleration
        (6,) acceleration of the platform origin and angular acceleration, in world axes [m/s², rad/s²].
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions]; default: home.
    limits
        Whether joint limits must hold.

    Returns
    -------
    State
        Configuration, velocity and acceleration that keep the loops closed.

    Raises
    ------
    ClosureError
        If the chain cannot take the pose, or cannot follow the twist or acceleration.
    UnreachableError
        If a joint limit is exceeded.
    """
    as_chain(chain)
    twist = as_array("twist", twist, (6,))
    acceleration = as_array("acceleration", acceleration, (6,))
    placed = inverse_kinematics(chain, pose, q_guess=q_guess, limits=limits).state
    follower = _Follower(placed)
    v = follower.follow(np.zeros(chain.nc), twist, "twist")
    scale, idle = chain.tangent_scale, bool(chain.generic.count.idle)
    if idle:
        v = scale * OwnMotion(placed, placed.freedom.idle / scale[:, None]).velocity(v / scale)
    moving = State(chain, placed.q, v)
    a = follower.follow(-moving.loop_bias, acceleration - moving.platform_bias, "acceleration")
    if idle:
        a = scale * OwnMotion(moving, placed.freedom.idle / scale[:, None]).acceleration(a / scale)
    return State(chain, placed.q, v, a)


def motor_jacobian(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    """Map platform twists to motor rates.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nu, 6) such that motor rates = J @ twist, twist [v; ω] of the platform origin in world axes
        [m/s or rad/s per m/s or rad/s]. For a platform with fewer than six freedoms, J acts on the twists it can do.

    Raises
    ------
    SingularityError
        If the platform has lost a freedom here (type I), or the loops have.
    InputError
        If the loops are open.
    """
    state = as_state(chain, q).require_regular()
    state.chain.platform_link  # noqa: B018 - raises
    state.chain.require_motors()
    return _Follower(state).rates()


def platform_acceleration(state: State, acceleration: FloatArray) -> Tangent:
    """Find the acceleration of the chain from that of the platform, without checks: for controllers.

    Parameters
    ----------
    state
        State whose loops are closed or nearly so.
    acceleration
        (6,) of the platform's origin, in world axes; what it cannot do is left out in least squares, in natural units
        [m/s², rad/s²].

    Returns
    -------
    numpy.ndarray
        (nv,) tangent acceleration that keeps the loops closed; idle freedoms, which follow their own inertia whatever
        is asked of them, at the least in the coordinates of their joints [m/s², rad/s²].
    """
    return _Follower(state).nearest(-state.loop_bias, acceleration - state.platform_bias)


class _Follower:
    """Motions of the whole chain that give loop rows and platform certain rates, at one configuration."""

    def __init__(self, state: State) -> None:
        chain, usual = state.chain, state.chain.generic
        self._state, self._sizes, self._scale = state, chain.twist_sizes, chain.tangent_scale
        self._factors: tuple[FloatArray, np.ndarray] | None = None
        self._rows = state.P * self._scale / self._sizes[:, None]
        if usual.rank == chain.nc and chain.nv == chain.nc + 6 == usual.rank + usual.count.platform:
            matrix = np.concatenate([state.rows, self._rows])
            factors, pivots, info = _getrf(matrix)
            if info == 0 and _gecon(factors, _lange("1", matrix))[0] > max(
                FAR_FROM_SINGULAR, state.largest_gap
            ):
                self._factors = factors, pivots
                return
        self._split = self._platform_split(usual.count.platform)

    def _platform_split(self, rank: int) -> Motions:
        state = self._state
        split = split_motions(self._rows @ state.motions.basis, rank)
        if split.smallest < SINGULAR * state.chain.generic.usual_platform:
            twist = split.left[:, -1] * self._sizes
            raise SingularityError(
                f"the platform has lost a freedom here (type I, smallest singular value {split.smallest:.3g}): it "
                f"cannot move along {', '.join(f'{n} {x:+.3g}' for n, x in zip(TWIST_AXES, twist, strict=True) if x)}; "
                "move away from this configuration",
                smallest_singular_value=split.smallest,
                direction=twist,
                names=TWIST_AXES,
            )
        return split

    def _least(self, rows: FloatArray, twist: FloatArray) -> FloatArray:
        """Least motion for rates of loop rows and platform; all in natural units."""
        if self._factors is not None:
            return self._solved(np.concatenate([rows, twist]))
        motions = self._state.motions
        across = motions.across(rows)
        return across + motions.basis @ self._split.across(twist - self._rows @ across)

    def _solved(self, right: FloatArray) -> FloatArray:
        assert self._factors is not None
        return _getrs(*self._factors, right)[0]

    def nearest(self, rows: FloatArray, twist: FloatArray) -> Tangent:
        """Least tangent vector that meets a demand as nearly as can be."""
        return self._least(rows / self._state.chain.row_sizes, twist / self._sizes) * self._scale

    def follow(self, rows: FloatArray, twist: FloatArray, name: str) -> Tangent:
        """Least tangent vector that meets a demand exactly, or an error."""
        state = self._state
        motion = self.nearest(rows, twist)
        left = float(
            np.abs(np.concatenate([state.J_c @ motion - rows, state.P @ motion - twist])).max(initial=0.0)
        )
        if left > _CONSISTENT * max(1.0, float(np.abs(twist).max()), float(np.abs(rows).max(initial=0.0))):
            raise ClosureError(
                f"the chain cannot follow this {name} here: {left:.3g} of it is left over; "
                f"ask for a motion the platform can do{_freedoms_in_words(state)}",
                residual=left,
                iterations=0,
                q=state.q,
            )
        return motion

    def rates(self) -> FloatArray:
        """(nu, 6) motor rates per twist."""
        chain = self._state.chain
        right = np.zeros((chain.nc + 6, 6))
        right.ravel()[6 * chain.nc :: 7] = (
            1 / self._sizes
        )  # loops stay closed, one entry of the twist at a time
        motion = (
            self._least(right[: chain.nc], right[chain.nc :])
            if self._factors is None
            else self._solved(right)
        )
        return self._scale[chain.motor_index, None] * motion[chain.motor_index]


def _said_of_platform(state: State) -> str:
    return f"the pose{_freedoms_in_words(state)}"


def _asked_for(only: Sequence[PoseAxis] | None) -> tuple[TwistAxis, ...]:
    """Translate parts of a pose into components of a twist."""
    if only is None:
        return TWIST_AXES
    names = (only,) if isinstance(only, str) else tuple(only)
    if not names or any(name not in POSE_AXES for name in names):
        raise InputError(f"only must name some of {', '.join(POSE_AXES)}, got {only!r}")
    return tuple(axis for axis, name in zip(TWIST_AXES, POSE_AXES, strict=True) if name in names)


def _some_axes(state: State) -> str:
    """Say which parts of a pose tell the configuration of a platform that has fewer than six freedoms."""
    count = state.chain.generic.count.platform
    if not 0 < count < 6:
        return ""
    # Pivots of the directions in which it moves: the components that tell these apart best.
    pivots = qr(_directions(state, count).T, mode="r", pivoting=True)[-1][:count]
    names = tuple(POSE_AXES[k] for k in sorted(pivots))
    return (
        f"; if the pose is met but for digits, ask for as much of it as the platform may choose: only={names}"
    )


def _directions(state: State, count: int) -> FloatArray:
    """(6, count) twists that the platform can do, orthonormal in natural units."""
    sizes = state.chain.twist_sizes[:, None]
    return split_motions((state.P * state.chain.tangent_scale / sizes) @ state.motions.basis, count).left


def _freedoms_in_words(state: State) -> str:
    """Name the freedoms of a platform that has fewer than six."""
    count = state.chain.generic.count.platform
    if count == 6:
        return ""
    left = _directions(state, count)
    along = [TWIST_AXES[k] for k in range(6) if 1 - np.linalg.norm(left[k]) < _ALONG]
    axes = f" along {', '.join(along)}" if len(along) == count else ""
    return f" (the platform '{state.chain.platform}' has {count} freedom{'s' * (count != 1)}{axes})"


def within_limits(closure: Closure, demand: str, *, throw: bool, of_pose: bool = False) -> Closure:
    """Let a solution pass if the limits of its joints hold.

    Parameters
    ----------
    closure
        Solution, or how near it came.
    demand
        What was asked for, with its verb.
    throw
        Whether an excess raises; otherwise it is returned with ``success=False``.
    of_pose
        Whether a pose was asked for, which does not tell the whole turns of coupled joints.

    Returns
    -------
    Closure
        The solution.

    Raises
    ------
    UnreachableError
        If a limit does not hold; names the joints and their values.
    """
    if not closure.success:
        return closure
    chain = closure.state.chain
    excesses = chain.judge.positions(closure.q)
    if not excesses:
        return closure
    listed = "; ".join(map(str, excesses))
    from_here = ""
    if of_pose and any(excess.joint in _counting_turns(chain) for excess in excesses):
        # They stay as near to the guess as they can; a whole turn on, gears stand elsewhere at the same pose.
        listed += "; other whole turns of coupled joints were not tried: start there by q_guess"
        from_here = " from this guess"
    if throw:
        raise UnreachableError(
            f"{demand} out of reach{from_here}, joints exceed their limits: {listed}; ask for another, or limits=False",
            violations={excess.joint: (excess.value, *excess.allowed) for excess in excesses},
            residual=closure.gap,
            iterations=closure.iterations,
            q=closure.q,
        )
    return replace(closure, success=False, reason=f"joints exceed their limits: {listed}")


def _counting_turns(chain: ClosedChain) -> set[str]:
    """Joints of couplings in which a hinge is: a pose leaves their whole turns open."""
    joints = [coupling.joints for coupling in chain.mechanism.couplings]
    hinges = {joint.name for joint in chain.mechanism.joints if joint.kind is JointKind.REVOLUTE}
    return {name for names in joints if not hinges.isdisjoint(names) for name in names}


def _start(chain: ClosedChain, q_guess: ArrayLike | None) -> State:
    """Home, or the guess with its loops closed: without that, the way to the demand would begin off the mechanism."""
    if q_guess is None:
        return chain.home_state()
    return close_loops(chain, q_guess, throw=False).state
