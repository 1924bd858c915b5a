"""What Newton's method is asked for beside closed loops: a platform pose, or motor positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.closure.equations import gap_from_data, jacobian_from_data, row_sizes
from stewart_pin.closure.newton import Closure, System, solve
from stewart_pin.mechanics.platform import platform_jacobian
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray

_STAGES = (4, 16)
"""Numbers of steps towards a demand, tried in order where the demand at once fails."""


def pose_system(chain: ClosedChain, target: pin.SE3) -> System:
    """Ask for closed loops and the platform at its target: position error [m], rotation vector of R R_targetᵀ [rad].

    Parameters
    ----------
    chain
        Closed chain.
    target
        Platform frame in the world.

    Returns
    -------
    System
        For `stewart_pin.closure.newton.solve`.
    """

    def evaluate(data: pin.Data, q: Configuration) -> tuple[FloatArray, FloatArray]:
        here = pin.updateFramePlacement(chain.model, data, chain.platform_id)
        turn = here.rotation @ target.rotation.T
        angle = pin.log3(turn)
        jacobian = platform_jacobian(chain, data).copy()
        # d log3(R) = Jlog3(R) ω_body, with ω_body = Rᵀ ω_world of the error rotation.
        jacobian[3:] = pin.Jlog3(turn) @ turn.T @ jacobian[3:]
        residual = np.concatenate(
            [gap_from_data(chain, data, q), here.translation - target.translation, angle]
        )
        return residual, np.vstack([jacobian_from_data(chain, data, q), jacobian])

    sizes = np.concatenate([row_sizes(chain), np.full(3, chain.length_scale), np.ones(3)])
    return System(evaluate, sizes, "the pose")


def motor_system(chain: ClosedChain, target: FloatArray) -> System:
    """Ask for closed loops and the motors at their positions.

    Parameters
    ----------
    chain
        Closed chain.
    target
        (nu,) motor positions [m or rad].

    Returns
    -------
    System
        For `stewart_pin.closure.newton.solve`.
    """
    rows = np.eye(chain.nv)[chain.motor_index]

    def evaluate(data: pin.Data, q: Configuration) -> tuple[FloatArray, FloatArray]:
        residual = np.concatenate([gap_from_data(chain, data, q), q[chain.motor_q_index] - target])
        return residual, np.vstack([jacobian_from_data(chain, data, q), rows])

    sizes = np.concatenate([row_sizes(chain), chain.tangent_scale[chain.motor_index]])
    return System(evaluate, sizes, "the motor positions")


def approach(
    chain: ClosedChain, start: Configuration, demand: Callable[[float], System], *, throw: bool
) -> Closure:
    """Solve for a demand at once, or failing that through intermediate ones.

    Parameters
    ----------
    chain
        Closed chain.
    start
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    demand
        System for a share of the way from 0 to 1.
    throw
        Whether failure raises.

    Returns
    -------
    Closure
        Configuration and residual reached.
    """
    direct = closure = solve(chain, start, demand(1.0))
    iterations = closure.iterations
    for stages in _STAGES:
        if closure.success:
            break
        closure = replace(closure, q=start)
        for k in range(1, stages + 1):
            closure = solve(chain, closure.q, demand(k / stages))
            iterations += closure.iterations
            if not closure.success:
                break
    # Of failures the direct one tells most: how near to the demand itself the chain can come.
    closure = replace(closure if closure.success else direct, iterations=iterations)
    return closure.or_raise(demand(1.0).demand) if throw else closure
