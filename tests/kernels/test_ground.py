"""Kernels on a ground that moves: they say what the verbs of one state say there, and refuse what they do not know."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, random_configuration, random_motion, robot, slow_but_for_few

AGREE = 1e-10
STATES = 4


def ships(rng: np.random.Generator, count: int) -> list[stp.dynamics.BaseMotion]:
    return [
        stp.dynamics.BaseMotion(pin.exp3(rng.normal(size=3)), *rng.normal(size=(2, 6))) for _ in range(count)
    ]


def rows(motions: list[stp.dynamics.BaseMotion]) -> np.ndarray:
    """(N, 16), as the kernels take them."""
    return np.array(
        [np.concatenate([pin.Quaternion(m.rotation).coeffs(), m.twist, m.acceleration]) for m in motions]
    )


def effective(name: str) -> stp.ClosedChain:
    chain = robot(name)
    own = {"armature": 0.3, "damping": 0.2, "stiffness": 2.0, "friction": 0.1}
    return stp.with_joint_physics(
        chain, {joint.name: own for joint in chain.mechanism.joints if joint.name in chain.motors}
    )


@pytest.mark.parametrize("name", slow_but_for_few(["five_bar", "delta", "universal"], ["five_bar"]))
def test_states_of_the_tree(name: str, rng: np.random.Generator) -> None:
    chain = effective(name)
    link = chain.platform or next(x.name for x in chain.mechanism.links[::-1] if x.inertia is not None)
    sails, states = ships(rng, STATES), []
    for ship in sails:
        q = random_configuration(chain, rng)
        states.append(chain.at(q, *random_motion(chain, rng, q), base_motion=ship))
    q, v, a = (np.array([getattr(s, x) for s in states]) for x in "qva")
    wrenches, status = rng.normal(size=(STATES, 6)), np.empty(STATES, dtype=np.int8)
    kernels = stp.compile_kernels(
        chain, coordinates="tree", wrenches=(link,), base_motion=True, engine="numpy"
    )
    tau = kernels.inverse_dynamics(q, v, a, wrenches, base_motion=sails, status=status)
    assert (status == StateStatus.OK).all()
    reactions = kernels.reactions(q, v, a, wrenches, base_motion=rows(sails))
    moved = kernels.forward_dynamics(q, v, tau, wrenches, base_motion=rows(sails))
    for k, state in enumerate(states):
        effort = stp.inverse_dynamics(state, wrenches={link: wrenches[k]})
        close(tau[k], effort.tau_motor, AGREE)
        close(reactions[k], effort.lambda_c, AGREE)
        forth = stp.forward_dynamics(state, tau_motor=tau[k], wrenches={link: wrenches[k]})
        close(moved[k][chain.motor_index], forth.a[chain.motor_index], 1e-9)
        close(
            moved[k], forth.a, 1e-7
        )  # a thin rod spins in its balls with a millionth of the others' inertia


@pytest.mark.slow
@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_platform_and_motors(coordinates: Any, rng: np.random.Generator) -> None:
    chain = effective("stewart")
    kernels = stp.compile_kernels(
        chain, coordinates=coordinates, wrenches=(chain.platform_link,), base_motion=True
    )
    assert kernels.report.why_tree == "the ground moves" and kernels.ground_moves
    home, given, expected = stp.platform_pose(chain, chain.q_home), [], []
    sails, push = ships(rng, STATES), rng.normal(size=(STATES, 6))
    for k, ship in enumerate(sails):
        pose = home * pin.SE3(pin.exp3(rng.uniform(-0.1, 0.1, 3)), rng.uniform(-0.05, 0.05, 3))
        twist, acceleration = rng.normal(size=(2, 6))
        state = stp.platform_motion(chain, pose, twist, acceleration)
        state = chain.at(state.q, state.v, state.a, base_motion=ship)
        expected.append(stp.inverse_dynamics(state, wrenches={chain.platform_link: push[k]}).tau_motor)
        motors = state.q[chain.motor_q_index], state.v[chain.motor_index], state.a[chain.motor_index]
        given.append((pin.SE3ToXYZQUAT(pose), twist, acceleration) if coordinates == "platform" else motors)
    motion = [np.array(x) for x in zip(*given, strict=True)]
    close(kernels.inverse_dynamics(*motion, push, base_motion=sails), np.array(expected), AGREE)
    pose, twist, acceleration = motion
    forth = kernels.forward_dynamics(pose, twist, np.array(expected), push, base_motion=sails, threads=2)
    close(forth, acceleration, 1e-8)


def test_regressors_hold_on_a_ship(rng: np.random.Generator) -> None:
    chain = robot("five_bar")
    kernels = stp.compile_kernels(chain, coordinates="tree", base_motion=True, engine="numpy")
    q = random_configuration(chain, rng)
    state = q, *random_motion(chain, rng, q)
    (ship,) = ships(rng, 1)
    matrix = kernels.regressor(*state, base_motion=ship)
    close(matrix @ kernels.inertial_parameters, kernels.inverse_dynamics(*state, base_motion=ship), AGREE)
    again = pickle.loads(pickle.dumps(kernels))
    np.testing.assert_array_equal(again.regressor(*state, base_motion=ship), matrix)
    close(again.regressor(*state, base_motion=rows([ship])[0]), matrix, AGREE)


def test_what_is_no_motion_is_refused(rng: np.random.Generator) -> None:
    chain = robot("five_bar")
    kernels = stp.compile_kernels(chain, coordinates="tree", base_motion=True, engine="numpy")
    still = stp.compile_kernels(chain, coordinates="tree", engine="numpy")
    state = chain.q_home, np.zeros(chain.nv), np.zeros(chain.nv)
    rest = stp.dynamics.BaseMotion()
    close(kernels.inverse_dynamics(*state, base_motion=rest), still.inverse_dynamics(*state), AGREE)
    with pytest.raises(InputError, match="BaseMotion\\(\\) where it rests"):
        kernels.inverse_dynamics(*state)
    with pytest.raises(InputError, match="base_motion=True"):
        still.inverse_dynamics(*state, base_motion=rest)
    with pytest.raises(InputError, match=r"\(16,\).*shape \(15,\)"):
        kernels.inverse_dynamics(*state, base_motion=np.zeros(15))
    with pytest.raises(InputError, match="got float"):
        kernels.inverse_dynamics(*state, base_motion=[rest, 1.0])  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="True or False"):
        stp.compile_kernels(chain, base_motion=rest)  # pyright: ignore[reportArgumentType]
    with pytest.raises(UnsupportedError, match="ground rests"):
        kernels.single_state("inverse_dynamics")
    status = np.empty(2, dtype=np.int8)
    turned = rows([rest, rest])
    turned[1, :4] *= 2
    found = kernels.inverse_dynamics(*state, base_motion=turned, status=status)
    assert (
        status[0] == StateStatus.OK != status[1] and np.isnan(found[1]).all() and np.isfinite(found[0]).all()
    )
