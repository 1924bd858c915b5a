"""Graphs of whole-tree dynamics against the one-state verbs, on every bundled robot and on odd mechanisms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.kernels.graph.state_functions import forward_dynamics_function, inverse_dynamics_function
from stewart_pin.kernels.graph.whole_tree import ClosedTree, close_tree, tree_bias
from stewart_pin.mechanics.effort import Effort
from stewart_pin.model.description import LOOP_KINDS, JointKind
from tests import mechanisms
from tests.closed_states import (
    along,
    close,
    derivative,
    random_configuration,
    random_motion,
    robot,
    slow_but_for_few,
)
from tests.kernels.tied_platforms import carts, in_the_tree
from tests.laws.conftest import Case, round_off_of_accelerations
from tests.zoo.table import ROBOTS

BUILDERS: dict[str, Callable[[np.random.Generator], stp.ClosedChain]] = {
    **{f"two bodies, {kind}": lambda rng, kind=kind: mechanisms.two_bodies(kind, rng) for kind in LOOP_KINDS},
    "four-bar, redundant rows": lambda rng: mechanisms.four_bar(JointKind.REVOLUTE),
    "five-bar, redundant motor": lambda rng: mechanisms.five_bar(),
    "five-bar, two pins": lambda rng: held_twice(),
    "plate on rods in a plane askew": lambda rng: in_the_tree(carts()),
    "gears and threads": mechanisms.gear_train,
    "arm": lambda rng: mechanisms.arm(rng, 4),
    "six cranks, idle rods": lambda rng: mechanisms.rotary_hexapod(),
    **{name: lambda rng, name=name: robot(name) for name in ROBOTS},
}

LARGE = {"stewart_sps", "stewart_cad", "stewart_s1", "delta", "hexapod_rss", "six cranks, idle rods"}
"""Those whose graphs take long."""


def held_twice() -> stp.ClosedChain:
    """Close a five-bar by two pins, one turned against the other: their reactions share by least norm."""
    chain = mechanisms.five_bar()
    pin_joint = chain.loops[0]
    turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.5])), np.zeros(3))
    twin = replace(
        pin_joint,
        name="twin",
        placement1=pin_joint.placement1 * turned,
        placement2=pin_joint.placement2 * turned,
    )
    return build_chain(replace(chain.described(), loops=(pin_joint, twin)))


def states(chain: stp.ClosedChain, rng: np.random.Generator, count: int = 3):
    for _ in range(count):
        q = random_configuration(chain, rng)
        yield q, *random_motion(chain, rng, q)


def call(function: ca.Function, *arguments: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.array(x).ravel() for x in function.call([ca.DM(x) for x in arguments]))


@pytest.fixture(params=slow_but_for_few(BUILDERS, [name for name in BUILDERS if name not in LARGE]))
def chain(request: pytest.FixtureRequest, rng: np.random.Generator) -> stp.ClosedChain:
    return BUILDERS[request.param](rng)


def rows_of(closed: ClosedTree) -> ca.Function:
    """Rows of a chain, turned back into its own, and their bias."""
    v, columns = ca.SX.sym("v", closed.tree.nv), closed.columns
    rows, bias = columns.turn @ columns.transpose.T, columns.turn @ tree_bias(closed, v)
    return ca.Function("rows", [closed.q, v], [rows, bias])


def test_rows_and_bias_hold_at_open_loops(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    """As those of one state, and as differences say, for a velocity that opens the loops further."""
    if not chain.nc:
        pytest.skip("no loops")
    rows = rows_of(close_tree(chain))
    q = pin.integrate(chain.model, chain.q_home, 0.2 * rng.normal(size=chain.nv) * chain.tangent_scale)
    v = rng.normal(size=chain.nv) * chain.tangent_scale
    jacobian, bias = (np.array(x) for x in rows.call([q, v]))
    close(jacobian, stp.loop_jacobian(chain, q), 1e-14)
    close(bias[:, 0], stp.loop_bias(chain, q, v), 1e-13)
    slope = derivative(lambda t: np.array(rows.call([along(chain, q, v)(t), v])[0]) @ v)
    close(bias[:, 0], slope, 1e-8)  # differences of order 4: 1e-12 of rates, of which three in a row enter


def test_rows_of_closed_loops_are_the_same_in_fewer_operations(
    chain: stp.ClosedChain, rng: np.random.Generator
) -> None:
    q = random_configuration(chain, rng)
    v, _ = random_motion(chain, rng, q)
    exact, short = (rows_of(close_tree(chain, closed=closed)) for closed in (False, True))
    assert short.n_instructions() <= exact.n_instructions()
    for one, two in zip(exact.call([q, v]), short.call([q, v]), strict=True):
        close(np.array(one), np.array(two), 1e-11)  # loops close to 1e-12 of the robot's size


def test_agrees_with_the_one_state_verbs(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    closed = close_tree(chain)
    forward = forward_dynamics_function(closed)
    inverse = inverse_dynamics_function(closed) if stp.mobility(chain).motors_sufficient else None
    for q, v, a in states(chain, rng):
        tau_motor = rng.normal(size=chain.nu)
        if inverse is not None:
            effort = stp.inverse_dynamics(chain, q, v, a)
            tau_motor = effort.tau_motor
            found, reactions = call(inverse, q, v, a)
            close(found, tau_motor, 1e-10)
            close(reactions, effort.lambda_c, 1e-10)
        motion = stp.forward_dynamics(chain, q, v, tau_motor)
        effort = Effort(tau_motor, motion.lambda_c, True, True, motion.a, 0.0)
        tolerance = round_off_of_accelerations(Case(chain, q, v, a, "generic"), 1e-10, effort)
        a_found, reactions = call(forward, q, v, tau_motor)
        close(a_found / chain.tangent_scale, motion.a / chain.tangent_scale, tolerance)
        close(reactions, motion.lambda_c, 1e-10)
