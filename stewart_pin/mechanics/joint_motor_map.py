r"""Between motors and the serial joints that linkages drive: rates one way, efforts the other.

An ankle or a knee moved by rods has motors beside it. With N the motions that keep the loops closed, S the rows of
the motors and A those of the joints, rate_joint = J rate_motor for all of them asks for

.. math:: J\, S N = A N, \qquad \text{hence} \qquad \tau_{motor} = J^\top \tau_{joint}

by virtual work. Nothing else is assumed: the joints may be any coordinates of the chain, as many as one likes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.errors import ActuationError
from stewart_pin.mechanics.coordinates import joint_index
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_state, named_motion
from stewart_pin.tolerances import SINGULAR, TAKES_PART
from stewart_pin.typing import ArrayLike, FloatArray


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
