"""The three passes with loops, against three other formulations of forward dynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError
from stewart_pin.model.description import LOOP_KINDS, JointKind
from tests.closed_states import NAMES
from tests.mechanics.joint_zoo import close, joint_zoo
from tests.retelling.case import case
from tests.rewritten import carry_over, recut
from tests.zoo.table import ROBOTS

WITH_LOOPS = [name for name in ROBOTS if stp.load(name).nc]


def closed_state(chain: stp.ClosedChain, rng: np.random.Generator):
    """Draw a configuration near home and a velocity that keep the loops closed, and motor efforts."""
    nearby = pin.integrate(chain.model, chain.q_home, rng.uniform(-0.1, 0.1, chain.nv) * chain.tangent_scale)
    q = stp.close_loops(chain, nearby).q
    jacobian, v = stp.loop_jacobian(chain, q), rng.normal(size=chain.nv)
    v -= np.linalg.pinv(jacobian, rcond=1e-10) @ (jacobian @ v)
    return q, v, rng.normal(0, 100, chain.nu)


def distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / max(1.0, np.abs(other).max()))


def lcaba(chain: stp.ClosedChain, q, v, tau_motor) -> np.ndarray:
    """Run Pinocchio's closed-chain articulated-body algorithm, with datas of its own."""
    models, datas = stp.loops.constraint_models(chain), pin.StdVec_RigidConstraintData()
    for model in models:
        datas.append(model.createData())
    data, tau = pin.Data(chain.model), np.zeros(chain.nv)
    tau[chain.motor_index] = tau_motor
    pin.initConstraintDynamics(chain.model, data, models, datas)
    pin.computeJointMinimalOrdering(chain.model, data, models)  # without it, a crash
    # 1e-3 converges within a few dozen iterations and leaves the least round-off.
    settings = pin.ProximalSettings(1e-16, 1e-3, 100)
    return np.array(pin.lcaba(chain.model, data, q, v, tau, models, datas, settings))


@pytest.mark.parametrize("name", WITH_LOOPS)
def test_four_forward_dynamics_agree(name: str, rng: np.random.Generator) -> None:
    chain = stp.load(name)
    mobility = stp.mobility(chain)
    for _ in range(5):
        q, v, tau = closed_state(chain, rng)
        ours = stp.dynamics.closed_chain_articulated_body(chain, q, v, tau)
        projection = stp.forward_dynamics(chain, q, v, tau)
        assert distance(ours.a, projection.a) <= 1e-9
        assert distance(ours.lambda_c, projection.lambda_c) <= 1e-9
        if {loop.kind for loop in chain.loops} <= {
            JointKind.SPHERICAL,
            JointKind.FIXED,
        } and not mobility.redundant_rows:
            constraint = stp.forward_dynamics(chain, q, v, tau, method="constraint_dynamics")
            assert distance(ours.a, constraint.a) <= 1e-9
            # Its proximal iterations leave 1e-7 of the accelerations of thin rods, which may spin and have 1e-4 times
            # the inertia of the rest.
            assert distance(ours.a, lcaba(chain, q, v, tau)) <= (1e-6 if mobility.idle else 1e-9)


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_every_kind_of_loop(kind: JointKind, rng: np.random.Generator) -> None:
    mechanism = joint_zoo(rng)
    model = build_chain(mechanism).model
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    loop = close(mechanism, model, q, kind, rng)
    home = {
        name: q[j.idx_q : j.idx_q + j.nq] for name, j in zip(model.names[1:], model.joints[1:], strict=True)
    }
    chain = build_chain(replace(mechanism, loops=(loop,), home=home))
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    for _ in range(3):
        q, v, tau = closed_state(chain, rng)
        ours, theirs = (
            stp.dynamics.closed_chain_articulated_body(chain, q, v, tau),
            stp.forward_dynamics(chain, q, v, tau),
        )
        assert distance(ours.a, theirs.a) <= 1e-9
        assert distance(ours.lambda_c, theirs.lambda_c) <= 1e-9


def test_redundant_loops_change_nothing_but_the_reactions(rng: np.random.Generator) -> None:
    chain = stp.load("stewart")
    q, v, tau = closed_state(chain, rng)
    twice = (*chain.loops, replace(chain.loops[2], name="again"))
    redundant = build_chain(replace(chain.mechanism, loops=twice))
    one, two = (stp.dynamics.closed_chain_articulated_body(x, q, v, tau) for x in (chain, redundant))
    assert distance(two.a, one.a) <= 1e-9
    # Least norm: the doubled loop shares its reaction evenly.
    np.testing.assert_allclose(two.lambda_c[6:9], one.lambda_c[6:9] / 2, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(two.lambda_c[6:9], two.lambda_c[18:], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_a_chain_without_loops_is_a_tree(name: str, rng: np.random.Generator) -> None:
    chain = stp.load(name)
    if chain.nc:
        chain = build_chain(replace(chain.mechanism, loops=()))
    q, v, tau_motor = closed_state(chain, rng)
    tau = np.zeros(chain.nv)
    tau[chain.motor_index] = tau_motor
    motion = stp.dynamics.closed_chain_articulated_body(chain, q, v, tau_motor)
    np.testing.assert_array_equal(motion.a, stp.articulated_body_acceleration(chain, q, v, tau))
    assert motion.lambda_c.shape == (0,)


def test_platform_on_a_ship(rng: np.random.Generator) -> None:
    # The base of a platform with loops is carried along: the free chain's answer, its base held to that motion.
    chain = stp.load("stewart")
    q, v, tau = closed_state(chain, rng)
    free = stp.on_floating_base(chain)
    whole = np.concatenate([free.q_home[:7], q])
    base_v, base_a = rng.normal(size=(2, 6))
    ship = stp.dynamics.BaseMotion(
        np.eye(3), base_v, base_a + np.concatenate([np.cross(base_v[3:], base_v[:3]), np.zeros(3)])
    )
    sailing = chain.at(q, v, base_motion=ship)
    ours = stp.dynamics.closed_chain_articulated_body(sailing, tau_motor=tau)
    data, rates = pin.Data(free.model), np.concatenate([base_v, v])
    jacobian = stp.loop_jacobian(free, whole)
    bias = stp.loop_bias(free, whole, rates)
    # Equation of motion of the free chain with the base's rows replaced by the known acceleration.
    inertia = np.triu(pin.crba(free.model, data, whole))
    inertia += np.triu(inertia, 1).T
    push = -pin.nonLinearEffects(free.model, data, whole, rates)
    push[free.motor_index] += tau
    matrix = np.block([[inertia[6:, 6:], -jacobian[:, 6:].T], [jacobian[:, 6:], np.zeros((18, 18))]])
    right = np.concatenate([push[6:] - inertia[6:, :6] @ base_a, -bias - jacobian[:, :6] @ base_a])
    wanted = np.linalg.solve(matrix, right)
    assert distance(ours.a, wanted[: chain.nv]) <= 1e-9
    assert distance(ours.lambda_c, wanted[chain.nv :]) <= 1e-9


def test_open_loops_are_refused(rng: np.random.Generator) -> None:
    chain = stp.load("stewart")
    q, v, tau = closed_state(chain, rng)
    with pytest.raises(InputError, match=r"q does not keep the loops closed: .* leg3_ball row 3"):
        moved = q.copy()
        moved[chain.motor_q_index[2]] += 1e-3
        stp.dynamics.closed_chain_articulated_body(chain, moved, v, tau)
    with pytest.raises(InputError, match="v does not keep the loops closed"):
        stp.dynamics.closed_chain_articulated_body(chain, q, v + 0.1, tau)
    with pytest.raises(InputError, match="tau_motor must have shape"):
        stp.dynamics.closed_chain_articulated_body(chain, q, v, np.zeros(chain.nv))


@pytest.mark.parametrize("name", ["delta", "hexapod_rss", "stewart"])
def test_a_body_without_mass_at_the_end_of_the_tree(name: str) -> None:
    """A cross that the cut leaves at the end: loops give it the inertia that the open tree has not."""
    at = case(name)
    told = recut(at.chain)
    assert told is not None
    q, v, _ = carry_over(at.chain, told, at.q, at.v, at.a)
    one = stp.dynamics.closed_chain_articulated_body(told, q, v, at.tau_motor)
    two = stp.forward_dynamics(told, q, v, at.tau_motor)
    # A hundred times what round-off makes of the lightest rod's spin.
    np.testing.assert_allclose(one.a, two.a, atol=1e-9 * np.abs(two.a).max())
    np.testing.assert_allclose(one.lambda_c, two.lambda_c, atol=1e-10 * np.abs(two.lambda_c).max())


def test_legs_without_mass() -> None:
    at = case("stewart")
    light = stp.massless_legs(at.chain)
    one = stp.dynamics.closed_chain_articulated_body(light, at.q, at.v, at.tau_motor)
    two = stp.forward_dynamics(light, at.q, at.v, at.tau_motor)
    np.testing.assert_allclose(one.a, two.a, atol=1e-10 * np.abs(two.a).max())


def test_a_spin_without_inertia_is_refused_by_name() -> None:
    at = case("delta")
    with pytest.raises(stp.errors.SingularityError, match=r"rod\d._spin.*moves nothing that has inertia"):
        stp.dynamics.closed_chain_articulated_body(stp.massless_legs(at.chain), at.q, at.v, at.tau_motor)
