"""Coordinates in which a controller sees a robot: its motors, its platform's twist, or joints chosen by name.

Each is a set of rows, x_rate = rows v. Their own motion comes along: for the platform the rows turn with it.
Between the motors and joints that linkages drive, rates and efforts are carried over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import ActuationError, InputError
from stewart_pin.mechanics.capability.platform_space import platform_space
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.state import State, as_state, named_motion
from stewart_pin.tolerances import SINGULAR, TAKES_PART
from stewart_pin.typing import ArrayLike, FloatArray

CoordinateChoice = (
    Literal["motor", "platform"] | list[str] | tuple[str, ...] | FloatArray | Sequence[Sequence[float]]
)
"""All motors, the platform's twist, joints by name, or (6, n) twists."""


@dataclass(frozen=True, eq=False, repr=False)
class Coordinates(Brief):
    """What the coordinates of a controller are, at one configuration.

    Attributes
    ----------
    kind
        ``"motor"``, ``"platform"`` or ``"joint"``.
    names
        One per coordinate: motors, axes of the twist, tangent names of joints, or ``mode 1``, ``mode 2``, ... where
        the twists that a platform can do lie along no axes.
    rows
        (n, nv) rates of the coordinates per tangent velocity [m/s or rad/s per m/s or rad/s].
    sizes
        (n,) natural size of each: the robot's size for lengths [m], 1 for angles [rad].
    basis
        (6, n) twist [v; ω] per coordinate rate, held fixed while the robot moves, [m/s, rad/s per m/s or rad/s]; None
        unless ``kind`` is ``"platform"``.
    """

    kind: str
    names: tuple[str, ...]
    rows: FloatArray
    sizes: FloatArray
    basis: FloatArray | None = None


def choose_coordinates(state: State, coordinates: CoordinateChoice) -> Coordinates:
    """Turn what a caller asks for into rows.

    Parameters
    ----------
    state
        State with closed loops.
    coordinates
        ``"motor"``; ``"platform"``; names of joints; or (6, n) twists [v; ω] of the platform origin in world axes,
        whose amounts are the coordinates [m/s, rad/s].

    Returns
    -------
    Coordinates
        For ``"platform"``: the twist itself where the platform has six freedoms, the axes along which it can move
        where there are such, and otherwise an orthonormal basis of the twists it can do, lengths in robot sizes.

    Raises
    ------
    InputError
        If a joint is unknown or named twice, or the twists make no basis.
    UnsupportedError
        If the platform cannot move.
    """
    chain = state.chain
    if isinstance(coordinates, str):
        if coordinates == "motor":
            chain.require_motors()
            return Coordinates(
                "motor", chain.motors, chain.motor_rows, chain.tangent_scale[chain.motor_index]
            )
        if coordinates == "platform":
            return _platform_coordinates(state)
        raise InputError(
            f"coordinates must be 'motor', 'platform', a list of joints or (6, n) twists, got {coordinates!r}"
        )
    names = (
        [name for name in coordinates if isinstance(name, str)] if isinstance(coordinates, Sequence) else None
    )
    if names is not None and isinstance(coordinates, Sequence) and len(names) == len(coordinates):
        index = joint_index(chain, "coordinates", names)
        names = tuple(chain.tangent_names[k] for k in index)
        return Coordinates("joint", names, np.eye(chain.nv)[index], chain.tangent_scale[index])
    basis = as_array("coordinates", coordinates, (6, None))
    names = tuple(f"mode {k + 1}" for k in range(basis.shape[1]))
    # Twists in robot sizes: lengths count in units of the size.
    sizes = np.full(basis.shape[1], chain.length_scale)
    return _twist_coordinates(state, basis, names, sizes)


def rows_rate(state: State, chosen: Coordinates) -> FloatArray:
    """Differentiate the rows of coordinates along a velocity.

    Parameters
    ----------
    state
        State that moves.
    chosen
        Coordinates there.

    Returns
    -------
    numpy.ndarray
        (n, nv) rate of ``chosen.rows`` [per s].
    """
    if chosen.basis is None:
        return np.zeros_like(chosen.rows)
    return _amounts(state.chain, chosen.basis) @ state.P_rate


def rows_bias(state: State, chosen: Coordinates) -> FloatArray:
    """Compute the acceleration of coordinates that is there without tangent acceleration.

    Parameters
    ----------
    state
        State that moves.
    chosen
        Coordinates there.

    Returns
    -------
    numpy.ndarray
        (n,) such that their acceleration is ``rows @ a`` and this [m/s², rad/s²].
    """
    if chosen.basis is None:
        return np.zeros(len(chosen.names))
    return _amounts(state.chain, chosen.basis) @ state.platform_bias


def joint_index(chain: ClosedChain, argument: str, joints: Sequence[str]) -> np.ndarray:
    """Find the tangent entries of joints.

    Parameters
    ----------
    chain
        Closed chain.
    argument
        Name of the argument, for messages.
    joints
        Names of joints, or of single entries as `ClosedChain.tangent_names` spells them.

    Returns
    -------
    numpy.ndarray
        Index of each entry in the tangent, in the order of the names.

    Raises
    ------
    InputError
        If none are given, or one is unknown or named twice.
    """
    if isinstance(joints, str) or not joints:
        raise InputError(f"{argument} must be a list of joint names, got {joints!r}")
    index: list[int] = []
    for name in joints:
        if name in chain.tangent_names:
            index.append(chain.tangent_names.index(name))
        elif chain.model.existJointName(name):
            joint = chain.model.joints[chain.model.getJointId(name)]
            index.extend(range(joint.idx_v, joint.idx_v + joint.nv))
        else:
            raise InputError(
                f"{argument} name the joint '{name}', which does not move or does not exist; "
                f"the joints are: {', '.join(chain.model.names[1:])}"
            )
    if len(set(index)) != len(index):
        raise InputError(f"{argument} name a joint twice: {list(joints)}")
    return np.array(index, dtype=int)


def _platform_coordinates(state: State) -> Coordinates:
    chain, space = state.chain, platform_space(state, None)
    if space.aligned is not None:
        axes = list(space.aligned)
        sizes = np.where(np.array(axes) < 3, chain.length_scale, 1.0)
        return _twist_coordinates(state, np.eye(6)[:, axes], tuple(TWIST_AXES[k] for k in axes), sizes)
    names = tuple(f"mode {k + 1}" for k in range(space.basis.shape[1]))
    basis = space.basis / np.repeat([1.0, space.length], 3)[:, None]
    return _twist_coordinates(state, basis, names, np.full(len(names), chain.length_scale))


def _twist_coordinates(
    state: State, basis: FloatArray, names: tuple[str, ...], sizes: FloatArray
) -> Coordinates:
    rows = _amounts(state.chain, basis) @ state.P
    return Coordinates("platform", names, rows, sizes, basis)


def _amounts(chain: ClosedChain, basis: FloatArray) -> FloatArray:
    """Amount of each twist of the basis in a twist, by least squares with lengths in robot sizes: (n, 6)."""
    sizes = chain.twist_sizes
    scaled = basis / sizes[:, None]
    if np.linalg.matrix_rank(scaled) < basis.shape[1]:
        raise InputError("coordinates hold twists that depend on each other; pass a basis")
    return np.linalg.pinv(scaled) / sizes


# ----------------------------------------------------------------------------------------------------
# Between motors and the serial joints that linkages drive: rates one way, efforts the other
#
# An ankle or a knee moved by rods has motors beside it. With N the motions that keep the loops closed, S the rows of
# the motors and A those of the joints, rate_joint = J rate_motor for all of them asks for
#
# .. math:: J\, S N = A N, \qquad \text{hence} \qquad \tau_{motor} = J^\top \tau_{joint}
#
# by virtual work. Nothing else is assumed: the joints may be any coordinates of the chain, as many as one likes.
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class JointMotorMap(Brief):
    """Rates and efforts of joints and motors: rate_joint = J rate_motor, effort_motor = Jᵀ effort_joint.

    Attributes
    ----------
    J
        (n, m) joint rates per motor rate [m/s or rad/s per m/s or rad/s].
    bias
        (n,) joint acceleration that is there without motor acceleration [m/s², rad/s²].
    inverse
        (m, n) motor rates per joint rate, whose transpose turns motor efforts into joint efforts; None where the
        joints do not determine the motors [m/s or rad/s per m/s or rad/s].
    joints
        Names of the n joint coordinates.
    motors
        Names of the m motors.
    unique
        Whether the motors move independently; otherwise J is the least one that is right for the rates they can have.
    """

    J: FloatArray
    bias: FloatArray
    inverse: FloatArray | None
    joints: tuple[str, ...]
    motors: tuple[str, ...]
    unique: bool


def joint_motor_map(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    joints: Sequence[str] = (),
    v: ArrayLike | None = None,
    *,
    motors: Sequence[str] | None = None,
) -> JointMotorMap:
    """Map rates and efforts between motors and chosen joints.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    joints
        Names of joints, for instance the two of an ankle; a ball joint stands for its three angular velocities.
    v
        (nv,) tangent velocity that keeps the loops closed, for the bias; default: rest [m/s, rad/s].
    motors
        Names of the motors that drive these joints, where the chain has others as well; default: all.

    Returns
    -------
    JointMotorMap
        The map, and its inverse where there is one.

    Raises
    ------
    ActuationError
        If the joints can move with these motors at rest; carries that motion.
    InputError
        If a name is unknown, or the state does not keep the loops closed.
    """
    state = as_state(chain, q, v).require_moving()
    chain = state.chain
    to_joint = joint_index(chain, "joints", joints)
    to_motor = joint_index(chain, "motors", chain.motors if motors is None else motors)
    scale, free = chain.tangent_scale, state.motions.basis
    moved, driven = free[to_joint], free[to_motor]
    resting, spread, rank = _resting(driven)
    left = moved @ resting
    if np.abs(left).max(initial=0.0) > TAKES_PART:
        worst = resting @ np.linalg.svd(left)[2][0]
        direction = scale * (free @ worst)
        direction = direction / np.abs(direction).max()
        names = [chain.tangent_names[k] for k in to_motor]
        raise ActuationError(
            f"the joints {', '.join(joints)} can move with the motors {', '.join(names)} at rest: "
            f"{named_motion(chain, direction)}; name the motors that drive them, or other joints",
            smallest_singular_value=0.0,
            direction=direction,
            names=chain.tangent_names,
        )
    J = scale[to_joint, None] * (moved @ spread) / scale[to_motor]
    # Any acceleration that keeps the loops closed will do: what two of them differ by, J maps as it should.
    drift = -scale * state.motions.across(state.loop_bias / chain.row_sizes)
    return JointMotorMap(
        J=J,
        bias=drift[to_joint] - J @ drift[to_motor],
        inverse=_inverse(moved, driven, scale[to_motor, None] / scale[to_joint]),
        joints=tuple(chain.tangent_names[k] for k in to_joint),
        motors=tuple(chain.tangent_names[k] for k in to_motor),
        unique=rank == len(to_motor),
    )


def _inverse(moved: FloatArray, driven: FloatArray, units: FloatArray) -> FloatArray | None:
    resting, spread, _ = _resting(moved)
    if np.abs(driven @ resting).max(initial=0.0) > TAKES_PART:
        return None
    return driven @ spread * units


def _resting(share: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Motions that leave coordinates at rest, the pseudo-inverse of their share, and its rank."""
    u, s, vt = np.linalg.svd(share)
    rank = int(np.count_nonzero(s >= SINGULAR))
    return vt[rank:].T, (vt[:rank].T / s[:rank]) @ u[:, :rank].T, rank
