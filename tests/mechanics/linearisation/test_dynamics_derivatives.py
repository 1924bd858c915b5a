"""Derivatives of inverse and forward dynamics, by differences along curves of states that keep the loops closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.model.description import LOOP_KINDS
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.mechanisms import five_bar, four_bar, gear_train, rotary_hexapod, two_bodies
from tests.rewritten import recut
from tests.zoo.table import ROBOTS

ODD = {
    "four_bar with redundant rows": lambda rng: four_bar(),
    "five_bar with a redundant motor": lambda rng: five_bar(),
    "rotary_hexapod with idle rods": lambda rng: rotary_hexapod(),
    "gears": gear_train,
    "a platform that hangs on a spinning leg": lambda rng: recut(robot("stewart_sps")),
    "massless spinning legs": lambda rng: stp.massless_legs(robot("stewart_sps")),
    **{str(kind): lambda rng, kind=kind: two_bodies(kind, rng) for kind in LOOP_KINDS},
    **{name: lambda rng, name=name: robot(name) for name in ROBOTS},
}
STEP = 1e-4


@pytest.fixture(params=ODD)
def chain(request: pytest.FixtureRequest, rng: np.random.Generator) -> stp.ClosedChain:
    """Return every bundled robot, every kind of loop, and chains with redundant rows, motors and idle freedoms."""
    return ODD[request.param](rng)


State = tuple[np.ndarray, np.ndarray, np.ndarray]


def closed_curve(chain: stp.ClosedChain, state: State, direction: State) -> Callable[[float], State]:
    """Curve of states with closed loops: each part moved along its direction and brought back."""
    scale = chain.tangent_scale

    def brought_back(q: np.ndarray, x: np.ndarray, rate: np.ndarray) -> np.ndarray:
        jacobian = stp.loop_jacobian(chain, q) * scale
        return x - scale * np.linalg.lstsq(jacobian, jacobian @ (x / scale) - rate, rcond=1e-10)[0]

    def at(t: float) -> State:
        q = stp.close_loops(chain, pin.integrate(chain.model, state[0], t * direction[0])).q
        v = brought_back(q, state[1] + t * direction[1], np.zeros(chain.nc))
        return q, v, brought_back(q, state[2] + t * direction[2], -stp.loop_bias(chain, q, v))

    return at


def change(chain: stp.ClosedChain, curve: Callable[[float], State]) -> State:
    """Differentiate the curve at zero, by central differences."""
    after, before = curve(STEP), curve(-STEP)
    dq = pin.difference(chain.model, before[0], after[0])
    return tuple(x / (2 * STEP) for x in (dq, after[1] - before[1], after[2] - before[2]))


# Central differences at h = 1e-4: truncation 1e-8 times third derivatives of some ten to a hundred, round-off 1e-14/h
# times efforts or, for thin links, accelerations that are large.
DIFFERENCES = 1e-6


def test_along_closed_states(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    require_slopes(chain, rng, None)


PUSHED = (
    "five_bar with a redundant motor",
    "rotary_hexapod with idle rods",
    "gears",
    "universal",
    "stewart",
    "stewart_sps",
    "delta",
    "arm_7r",
)


@pytest.mark.parametrize("name", PUSHED)
def test_under_wrenches(name: str, rng: np.random.Generator) -> None:
    """They keep their axes while links turn, and the points at which they act move: J_fᵀ w changes with q."""
    chain = ODD[name](rng)
    weight = sum(body.mass for body in chain.model.inertias)
    unit = weight * np.repeat([1.0, chain.length_scale], 3)
    require_slopes(chain, rng, {link.name: unit * rng.normal(size=6) for link in chain.mechanism.links})


def require_slopes(
    chain: stp.ClosedChain, rng: np.random.Generator, wrenches: dict[str, np.ndarray] | None
) -> None:
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    motions = chain.at(q).freedom.motions
    direction = tuple((motions @ rng.normal(size=(motions.shape[1], 3))).T)
    curve = closed_curve(chain, (q, v, a), direction)
    dq, dv, da = change(chain, curve)

    def efforts(t: float) -> np.ndarray:
        return stp.inverse_dynamics(chain, *curve(t), wrenches=wrenches).tau_motor

    found = stp.dynamics.inverse_dynamics_derivatives(chain, q, v, a, wrenches=wrenches)
    slope = (efforts(STEP) - efforts(-STEP)) / (2 * STEP)
    close(found.tau_q @ dq + found.tau_v @ dv + found.tau_a @ da, slope, DIFFERENCES)

    tau, dtau = efforts(0.0), rng.normal(size=chain.nu)

    def acceleration(t: float) -> np.ndarray:
        q, v, _ = curve(t)
        return stp.forward_dynamics(chain, q, v, tau + t * dtau, wrenches=wrenches).a

    motion = stp.dynamics.forward_dynamics_derivatives(chain, q, v, tau, wrenches=wrenches)
    slope = (acceleration(STEP) - acceleration(-STEP)) / (2 * STEP)
    close(motion.a_q @ dq + motion.a_v @ dv + motion.a_tau @ dtau, slope, DIFFERENCES)


def test_inverse_and_forward_derivatives_undo_each_other(rng: np.random.Generator) -> None:
    """Efforts that follow a change of state leave the acceleration as the change asks: exact, no differences."""
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    motions = chain.at(q).freedom.motions
    inverse = stp.dynamics.inverse_dynamics_derivatives(chain, q, v, a)
    tau = stp.inverse_dynamics(chain, q, v, a).tau_motor
    forward = stp.dynamics.forward_dynamics_derivatives(chain, q, v, tau)
    close(forward.a_tau @ inverse.tau_a @ motions, motions, 1e-10)
    # A change of velocity needs efforts that leave no acceleration but the one the loops force on it.
    dv = motions @ rng.normal(size=motions.shape[1])
    h = 1e-3  # the bias is quadratic in v: central differences are exact
    bias = (stp.loop_bias(chain, q, v + h * dv) - stp.loop_bias(chain, q, v - h * dv)) / (2 * h)
    da = forward.a_v @ dv + forward.a_tau @ (inverse.tau_v @ dv)
    np.testing.assert_allclose(stp.loop_jacobian(chain, q) @ da, -bias, atol=1e-9)
    np.testing.assert_allclose(inverse.tau_a @ da, 0, atol=1e-9 * np.abs(inverse.tau_v @ dv).max())


def test_trees_agree_with_pinocchio(rng: np.random.Generator) -> None:
    """Without loops the derivatives are those of the tree."""
    chain = robot("arm_7r")
    q = random_configuration(chain, rng, 0.5)
    v, a = random_motion(chain, rng, q)
    data = pin.Data(chain.model)
    found = stp.dynamics.inverse_dynamics_derivatives(chain, q, v, a)
    by_q, by_v, _ = pin.computeRNEADerivatives(chain.model, data, q, v, a)
    order = chain.motor_index
    close(found.tau_q, by_q[order], 1e-12)
    close(found.tau_v, by_v[order], 1e-12)
    tau = np.array(pin.rnea(chain.model, data, q, v, a))
    motion = stp.dynamics.forward_dynamics_derivatives(chain, q, v, tau[order])
    by_q, by_v, by_tau = pin.computeABADerivatives(chain.model, data, q, v, tau)
    close(motion.a_q, by_q, 1e-10)
    close(motion.a_v, by_v, 1e-10)
    close(motion.a_tau, by_tau[:, order], 1e-10)


def test_against_pinocchio_s_constrained_derivatives(rng: np.random.Generator) -> None:
    """Pinocchio's own derivatives of `constraintDynamics`, whose ``ddq_dq`` has a wrong first column (4.1)."""
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    v, _ = random_motion(chain, rng, q)
    tau_motor = rng.normal(size=6) * 100
    tau = np.zeros(chain.nv)
    tau[chain.motor_index] = tau_motor
    models = stp.loops.constraint_models(chain)
    datas = pin.StdVec_RigidConstraintData()
    for model in models:
        datas.append(model.createData())
    data = pin.Data(chain.model)
    pin.initConstraintDynamics(chain.model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 0.0, 1)
    pin.constraintDynamics(chain.model, data, q, v, tau, models, datas, settings)
    pin.computeConstraintDynamicsDerivatives(chain.model, data, models, datas, settings)
    found = stp.dynamics.forward_dynamics_derivatives(chain, q, v, tau_motor)
    motions = chain.at(q).freedom.motions
    close(found.a_v @ motions, data.ddq_dv @ motions, 1e-9)
    close(found.a_tau, data.ddq_dtau[:, chain.motor_index], 1e-9)


def test_open_loops_are_refused() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    q = pin.integrate(chain.model, chain.q_home, rest + 0.01)
    with pytest.raises(InputError, match="does not keep the loops closed"):
        stp.dynamics.inverse_dynamics_derivatives(chain, q, rest, rest)
    with pytest.raises(InputError, match="does not keep the loops closed"):
        stp.dynamics.forward_dynamics_derivatives(chain, q, rest, np.zeros(6))
