"""A state: checked at the door, computed once, never changed, and the same numbers as the verbs of a chain."""

from __future__ import annotations

import copy
import pickle
import threading
from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.state import loop_rows
from stewart_pin.state.scratch import Scratch
from tests.closed_states import NAMES, along, close, derivative, random_configuration, random_motion, robot
from tests.mechanisms import four_bar

ROBOTS = ("stewart", "stewart_sps", "delta", "four_bar", "arm_7r", "gear_train")


def moving(name: str, rng: np.random.Generator) -> stp.State:
    chain = robot(name)
    q = random_configuration(chain, rng, 0.1)
    return chain.at(q, *random_motion(chain, rng, q))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_state_gives_what_chain_and_numbers_give(name: str, rng: np.random.Generator) -> None:
    state = moving(name, rng)
    given = state.chain, state.q, state.v, state.a
    effort = stp.inverse_dynamics(state)
    assert np.array_equal(effort.tau_motor, stp.inverse_dynamics(*given).tau_motor)
    motion = stp.forward_dynamics(state, tau_motor=effort.tau_motor)
    assert np.array_equal(motion.a, stp.forward_dynamics(*given[:3], effort.tau_motor).a)
    for verb in (stp.loop_gap, stp.loop_jacobian, stp.motor_jacobian, stp.motor_positions):
        assert np.array_equal(verb(state), verb(*given[:2]))
    for verb in (stp.loop_bias, stp.loops.loop_jacobian_rate):
        assert np.array_equal(verb(state), verb(*given[:3]))
    assert stp.platform_pose(state) == stp.platform_pose(*given[:2])
    assert np.array_equal(stp.operational_dynamics(state).M, stp.operational_dynamics(*given[:3]).M)
    assert (
        stp.singularities.classify_singularity(state).measures
        == stp.singularities.classify_singularity(*given[:2]).measures
    )
    parts = stp.joint_reactions(state), stp.joint_reactions(*given[:3], effort)
    assert all(np.array_equal(one.force, two.force) for one, two in zip(*parts, strict=True))


@pytest.mark.parametrize("name", ROBOTS)
def test_platform_by_differences(name: str, rng: np.random.Generator) -> None:
    """Twist and acceleration of the platform are the derivatives of its pose: none of Pinocchio's frames takes part."""
    state = moving(name, rng)
    chain = state.chain
    curve = along(chain, state.q, state.v, state.a)
    turned = lambda t: pin.log3(chain.at(curve(t)).pose.rotation @ state.pose.rotation.T)  # noqa: E731
    placed = lambda t: np.concatenate([chain.at(curve(t)).pose.translation, turned(t)])  # noqa: E731
    # Differences of order 4: 1e-12 of rates of a few per second.
    close(state.twist, derivative(placed), 1e-9)

    def twist(t: float) -> np.ndarray:
        # The velocity of the curve q ⊕ (v t + a t²/2) at t, by differences of the curve itself.
        rate = derivative(lambda h: pin.difference(chain.model, curve(t), curve(t + h)))
        return chain.at(curve(t), rate).twist

    close(state.P @ state.a + state.platform_bias, derivative(twist), 1e-7)
    matrix = derivative(lambda t: chain.at(pin.integrate(chain.model, state.q, t * state.v)).P)
    np.testing.assert_allclose(state.P_rate, matrix, rtol=0, atol=1e-9 * max(1.0, np.abs(matrix).max()))


def test_each_quantity_is_computed_once(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    state, calls = moving("stewart", rng), []
    for name in ("place_loops", "wrenches_of", "jacobian_of", "jacobian_rate_of"):
        own = getattr(loop_rows, name)

        def counted(*args, own=own, name=name):
            calls.append(name)
            return own(*args)

        monkeypatch.setattr(f"stewart_pin.state.state.{name}", counted)
    stp.inverse_dynamics(state, method="constraint_matrix")  # ranks are found on states of their own
    calls.clear()
    fresh = stp.State(state.chain, state.q, state.v, state.a)
    effort = stp.inverse_dynamics(fresh)
    stp.forward_dynamics(fresh, tau_motor=effort.tau_motor)
    stp.operational_dynamics(fresh), stp.motor_jacobian(fresh)
    stp.inverse_dynamics(fresh, method="constraint_matrix")
    assert sorted(calls) == ["jacobian_of", "jacobian_rate_of", "place_loops", "wrenches_of"]


def test_a_state_does_not_change(rng: np.random.Generator) -> None:
    chain = robot("four_bar")
    q = np.array(chain.q_home)
    state = chain.at(q)
    q[0] += 1.0
    assert np.array_equal(state.q, chain.q_home)
    with pytest.raises(ValueError, match="read-only"):
        state.q[0] = 0.0
    with pytest.raises(AttributeError, match=r"chain\.at"):
        state.v = np.ones(3)
    again = pickle.loads(pickle.dumps(state))
    assert np.array_equal(again.q, state.q) and again.chain.name == chain.name
    assert repr(state).startswith("State of 'four_bar': at rest, largest loop gap ")


def test_what_a_state_has_computed_does_not_change(rng: np.random.Generator) -> None:
    # What it keeps is asked again by every verb: a caller that scales it in place would spoil their answers.
    state = moving("stewart", rng)
    right = stp.motor_jacobian(state)
    for name in ("gap", "J_c", "loop_bias", "M", "nle", "P", "twist", "platform_bias"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(state, name)[:] = 0.0
    state.pose.translation[:] = 7.0
    assert state.pose == stp.platform_pose(state.chain, state.q)
    # What verbs hand out is the caller's own.
    for mine in (stp.loop_jacobian(state), stp.motor_jacobian(state), stp.loop_bias(state)):
        mine[:] = 0.0
    assert np.array_equal(stp.motor_jacobian(state), right)
    assert np.abs(stp.loop_jacobian(state)).max() > 0


def test_verbs_say_what_they_take(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    state = moving("stewart", rng)
    with pytest.raises(InputError, match="a state holds q, v and a already"):
        stp.inverse_dynamics(state, state.q)
    with pytest.raises(InputError, match="q is missing"):
        stp.inverse_dynamics(chain)
    with pytest.raises(InputError, match=r"ClosedChain .* or a State .*, got Hexapod"):
        stp.inverse_dynamics(stp.Hexapod.from_chain(chain), state.q)
    with pytest.raises(InputError, match="no acceleration"):
        stp.inverse_dynamics(chain.at(state.q, state.v))
    with pytest.raises(InputError, match="tau_motor is missing"):
        stp.forward_dynamics(state)
    assert np.array_equal(
        stp.inverse_dynamics(chain.at(chain.q_home)).tau_motor,
        stp.inverse_dynamics(chain, chain.q_home, np.zeros(24), np.zeros(24)).tau_motor,
    )


def test_solvers_hand_out_states() -> None:
    chain = robot("stewart")
    pose = pin.SE3(np.eye(3), np.array([0.03, -0.02, 1.0]))
    for closure in (
        stp.close_loops(chain, chain.q_home),
        stp.inverse_kinematics(chain, pose),
        stp.forward_kinematics(chain, stp.motor_positions(chain, chain.q_home) + 0.01),
    ):
        assert isinstance(closure.state, stp.State) and closure.q is closure.state.q
        assert stp.inverse_dynamics(closure.state).residual < 1e-9
    assert isinstance(stp.platform_motion(chain, pose, np.zeros(6), np.zeros(6)), stp.State)


def test_placements_are_read_where_pinocchio_keeps_them(rng: np.random.Generator) -> None:
    """All placements are looked at as one array, whatever the number of joints."""
    for name in ("stewart", "four_bar", "arm_7r", "delta"):
        model = robot(name).model
        scratch = Scratch(model)
        for _ in range(3):
            scratch.place(pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)))
            for k in range(model.njoints):
                assert np.array_equal(scratch.rotation[k], scratch.data.oMi[k].rotation)
                assert np.array_equal(scratch.translation[k], scratch.data.oMi[k].translation)


def test_a_chain_serves_any_number_of_threads(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    states = [moving("stewart", rng) for _ in range(40)]
    expected = [stp.inverse_dynamics(chain, s.q, s.v, s.a).tau_motor for s in states]
    found: list = [None] * len(states)

    def work(first: int) -> None:
        for k in range(first, len(states), 4):
            s = states[k]
            for _ in range(5):
                found[k] = stp.inverse_dynamics(chain, s.q, s.v, s.a).tau_motor

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert all(np.array_equal(one, two) for one, two in zip(found, expected, strict=True))


def test_all_states_of_a_chain_share_one_scratch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pinocchio's memory grows with nv³: states that live at the same time cannot each have one."""
    chain = replace(four_bar())  # a copy, whose ranks are not known yet
    made = []
    monkeypatch.setattr("stewart_pin.state.chain.Scratch", lambda model: made.append(model) or Scratch(model))
    states = [chain.at(q, np.zeros(chain.nv)) for q in chain.generic.samples]
    for state in states:
        state.J_c_rate, state.M, state.coriolis, state.weight, state.opposed()
    assert len(states) > 1 and len(made) == 1


@pytest.mark.parametrize("name", NAMES)
def test_large_trees_are_placed_without_pinocchios_memory(
    name: str, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """Placements and Jacobians are Pinocchio's, of which no memory was asked for; a base that floats included."""
    monkeypatch.setattr("stewart_pin.state.scratch._LARGE", 1)
    for chain in (robot(name), stp.on_floating_base(robot(name), pin.Inertia(1.0, np.zeros(3), np.eye(3)))):
        model, scratch, data = chain.model, Scratch(chain.model), pin.Data(chain.model)
        for _ in range(3):
            q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
            placed, jacobian = scratch.placed(q), pin.computeJointJacobians(model, data, q)
            assert np.abs(placed.jacobian - jacobian).max() < 1e-13
            for k, placement in enumerate(data.oMi):
                assert np.abs(placed.rotation[k] - placement.rotation).max() < 1e-13
                assert np.abs(placed.translation[k] - placement.translation).max() < 1e-13
        assert "data" not in vars(scratch)


def test_a_state_with_few_digits_is_refused_beside_a_singularity() -> None:
    """Eight digits are enough at ordinary states, and not at a distance of 1e-5 from where the loops are singular."""
    chain = four_bar(lengths=(0.3, 0.9, 0.3))  # a parallelogram, flat at zero
    near = np.array([1e-5, -1e-5, 1e-5])
    for angle, name in ((near[0], "crank_motor"), (-near[0], "elbow"), (near[0], "rocker_hinge")):
        near[chain.model.joints[chain.model.getJointId(name)].idx_q] = angle
    exact = stp.close_loops(chain, near).state
    assert stp.inverse_dynamics(exact).residual < 1e-9
    printed = exact.q + 1e-8 * np.array([1.0, 1.0, 0.0])
    with pytest.raises(SingularityError, match="so near a singularity of theirs"):
        stp.inverse_dynamics(chain.at(printed))


def test_chains_and_states_travel_without_their_scratch(rng: np.random.Generator) -> None:
    """Placements are views of Pinocchio's memory: a copy of them would stand still."""
    state = moving("stewart", rng)
    expected = stp.inverse_dynamics(state).tau_motor
    for again in (pickle.loads(pickle.dumps(state)), copy.deepcopy(state)):
        assert np.array_equal(stp.inverse_dynamics(again).tau_motor, expected)
        assert set(pickle.loads(pickle.dumps(again)).__dict__) == {"chain", "q", "v", "a", "base_motion"}
    chain = pickle.loads(pickle.dumps(state.chain))
    assert set(vars(chain)) == {"mechanism", "model", "motors", "platform", "q_home"}
    other = moving("stewart", rng)
    ours, theirs = (
        stp.inverse_dynamics(c, other.q, other.v, other.a).tau_motor for c in (state.chain, chain)
    )
    assert np.array_equal(ours, theirs)
    with pytest.raises(TypeError, match="one process"):
        pickle.dumps(Scratch(chain.model))


VERBS_OF_CHAINS = (
    stp.close_loops,
    stp.mobility,
    stp.forward_kinematics,
    stp.inverse_kinematics,
    stp.platform_motion,
    stp.articulated_body_acceleration,
    stp.singularities.find_singularity,
    stp.loops.closed_path,
    stp.singularities.singularity_map,
    stp.motor_demand,
    stp.fit_to_limits,
    stp.compare_methods,
    stp.simulate,
    stp.compile_kernels,
    stp.with_limits,
    stp.with_motors,
    stp.with_platform,
    stp.lock_joints,
    stp.attach_payload,
    stp.build.replace_inertias,
    stp.massless_legs,
    stp.on_floating_base,
    stp.build.loops_by_balls,
    stp.build.displace_geometry,
    stp.build.geometry_parameters,
    stp.loops.generic_freedom,
    stp.export,
    stp.write_urdf,
    stp.loops.constraint_models,
)


@pytest.mark.parametrize("verb", VERBS_OF_CHAINS, ids=lambda verb: verb.__name__)
def test_verbs_of_chains_say_so(verb: Callable[..., Any]) -> None:
    parameters = list(signature(verb).parameters.values())[1:]
    told = {p.name: None for p in parameters if p.default is p.empty and p.kind is not p.VAR_KEYWORD}
    state = robot("four_bar").at(robot("four_bar").q_home)
    for wrong, name in (("stewart", "str"), (state, "State"), (None, "NoneType"), (object(), "object")):
        with pytest.raises(InputError, match=rf"must be a ClosedChain \(see load\), got {name}"):
            verb(wrong, **told)
