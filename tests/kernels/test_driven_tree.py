"""The whole tree driven by its platform or its motors, where idle freedoms carry no momentum."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import null_space

import stewart_pin as stp
from stewart_pin.kernels.graph.driven_tree import (
    Coordinates,
    DrivenTree,
    drive_tree,
    driven_forward_dynamics,
    driven_inverse_dynamics,
)
from stewart_pin.kernels.graph.platform_kinematics import platform_columns
from stewart_pin.kernels.graph.whole_tree import close_tree
from tests.closed_states import close, random_configuration
from tests.kernels.platforms import skew_rods


@cache
def driven(coordinates: Coordinates) -> DrivenTree:
    return drive_tree(close_tree(skew_rods()), coordinates)


def drive(chain: stp.ClosedChain, coordinates: Coordinates, q: np.ndarray) -> np.ndarray:
    return chain.at(q).P if coordinates == "platform" else np.eye(chain.nv)[chain.motor_index]


@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_idle_freedoms_carry_no_momentum(coordinates: Coordinates, rng: np.random.Generator) -> None:
    tree = driven(coordinates)
    chain = tree.closed.chain
    assert tree.idle.shape[1] == 6
    inverse, forward = driven_inverse_dynamics(tree), driven_forward_dynamics(tree)
    for _ in range(2):
        q = random_configuration(chain, rng, 0.1)
        rows = np.vstack([stp.loop_jacobian(chain, q), drive(chain, coordinates, q)])
        velocity, acceleration = rng.normal(size=(2, rows.shape[0] - chain.nc))
        v = np.linalg.lstsq(rows, np.concatenate([np.zeros(chain.nc), velocity]), rcond=1e-10)[0]
        idle, M = null_space(rows, rcond=1e-10), chain.at(q).M
        v = v - idle @ np.linalg.solve(idle.T @ M @ idle, idle.T @ M @ v)
        bias = chain.at(q, v).platform_bias if coordinates == "platform" else np.zeros(chain.nu)
        demand = np.concatenate([-stp.loop_bias(chain, q, v), acceleration - bias])
        a = np.linalg.lstsq(rows, demand, rcond=1e-10)[0]
        tau_motor, infeasible = inverse.call([ca.DM(x) for x in (q, velocity, acceleration)])
        expected = stp.inverse_dynamics(chain, q, v, a).tau_motor
        close(np.array(tau_motor).ravel(), expected, 1e-10)
        assert float(infeasible) == 0.0
        moved = stp.forward_dynamics(chain, q, v, expected).a
        found = forward.call([ca.DM(x) for x in (q, velocity, expected)])[0]
        close(np.array(found).ravel(), drive(chain, coordinates, q) @ moved + bias, 1e-10)


def test_platform_columns_are_its_jacobian(rng: np.random.Generator) -> None:
    tree = driven("platform")
    chain, closed = tree.closed.chain, tree.closed
    q = random_configuration(chain, rng, 0.1)
    columns = ca.Function("columns", [closed.q], [platform_columns(closed)])
    close(np.array(columns(q)).T, chain.at(q).P, 1e-12)
