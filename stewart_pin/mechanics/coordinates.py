"""Coordinates in which a controller sees a robot: its motors, its platform's twist, or joints chosen by name.

Each is a set of rows, x_rate = rows v. Their own motion comes along: for the platform the rows turn with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.mechanics.capability.platform_space import platform_space
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.state import State
from stewart_pin.typing import ArrayLike, FloatArray


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


def choose_coordinates(state: State, coordinates: str | Sequence[str] | ArrayLike) -> Coordinates:
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
