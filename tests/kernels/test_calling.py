"""How verbs of kernels are called: given arrays, codes, conditioning, singular states, one state at a time."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.kernels import Kernels, compile_kernels
from stewart_pin.programs.status import StateStatus
from tests.closed_states import robot, slow_but_for_few
from tests.kernels.hexapod_graph import sample_states
from tests.kernels.test_compile import kernels, platform_states

TWIN = ("inverse_dynamics", "forward_dynamics", "reactions", "regressor")
"""Verbs of pose, twist and a third."""
PAIRED = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives")


def in_a_tuple(values: Any) -> tuple[np.ndarray, ...]:
    return values if isinstance(values, tuple) else (values,)


def yawed(degrees: float) -> np.ndarray:
    """Pose of `stewart` above its centre; at 90° of yaw the legs lose their hold."""
    return np.array([0.0, 0.0, 1.0, *pin.Quaternion(pin.exp3(np.deg2rad([0.0, 0.0, degrees]))).coeffs()])


def calls(many: Kernels, rng: np.random.Generator, count: int) -> dict[str, tuple[np.ndarray, ...]]:
    """Verbs and arguments."""
    _, (pose, twist, acceleration, q_motor) = platform_states(many, rng, count)
    tau = many.inverse_dynamics(pose, twist, acceleration)
    third = {"forward_dynamics": tau, "forward_dynamics_derivatives": tau}
    found = {name: (pose, twist, third.get(name, acceleration)) for name in (*TWIN, *PAIRED)}
    return {
        **found,
        "inverse_kinematics": (pose,),
        "motor_jacobian": (pose,),
        "conditioning": (pose,),
        "forward_kinematics": (q_motor, pose[0]),
    }


# By legs, and by way of configurations.
@pytest.mark.parametrize("name", slow_but_for_few(["stewart", "four_bar"], ["four_bar"]))
def test_results_are_written_where_told(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    for verb, arguments in calls(many, rng, 3).items():
        call = getattr(many, verb)
        expected = in_a_tuple(call(*arguments))
        out = [np.full_like(x, 7.0) for x in expected]
        status = np.full(3, 9, dtype=np.int8)
        given = call(*arguments, out=out if len(out) > 1 else out[0], status=status)
        for place, value, returned in zip(out, expected, in_a_tuple(given), strict=True):
            assert np.shares_memory(place, returned), verb
            np.testing.assert_array_equal(place, value, err_msg=verb)
        assert (status == StateStatus.OK).all(), verb
        # One state, without an axis of states.
        first = [x if x.ndim == 1 else x[0] for x in arguments]
        alone = [np.empty_like(x[0]) for x in out]
        if verb != "conditioning":
            call(*first, out=alone if len(alone) > 1 else alone[0])
            for place, value in zip(alone, out, strict=True):
                np.testing.assert_array_equal(place, value[0], err_msg=verb)


@pytest.mark.parametrize("name", slow_but_for_few(["stewart", "four_bar"], ["four_bar"]))
def test_conditioning_comes_along(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    for verb, arguments in calls(many, rng, 3).items():
        if verb == "conditioning":
            continue
        conditioning = np.zeros(3)
        expected = in_a_tuple(getattr(many, verb)(*arguments))
        graded = in_a_tuple(getattr(many, verb)(*arguments, conditioning=conditioning))
        for found, value in zip(graded, expected, strict=True):
            # Another order of sums.
            np.testing.assert_allclose(found, value, rtol=1e-11, atol=1e-11, err_msg=verb)
        pose = many.forward_kinematics(*arguments) if verb == "forward_kinematics" else arguments[0]
        alone = many.conditioning(pose)
        if verb.startswith("forward_dynamics") or verb == "motor_jacobian" or "kinematics" in verb:
            # Fewer pivots: nothing for motors to hold, or no dynamics to lose digits again.
            assert (conditioning >= alone * (1 - 1e-9)).all(), verb
        elif verb in {"reactions", "regressor"}:
            assert (conditioning > 0.1).all(), verb  # of legs, or of the whole tree with pivots of its own
        else:
            np.testing.assert_allclose(conditioning, alone, rtol=1e-9, err_msg=verb)
    one = np.zeros(1)
    many.inverse_dynamics(*(x[0] for x in arguments_of(many, rng)), conditioning=one)
    assert one[0] > 1e-3


def arguments_of(many: Kernels, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    return calls(many, rng, 1)["inverse_dynamics"]


def test_nothing_is_allocated_where_all_is_given(rng: np.random.Generator) -> None:
    many, count = kernels("stewart"), 5000
    pose, twist, acceleration = sample_states(rng, count)
    out, status, conditioning = np.empty((count, 6)), np.empty(count, dtype=np.int8), np.empty(count)

    def peak(**options: Any) -> int:
        many.inverse_dynamics(pose, twist, acceleration, **options)  # compiled by now
        tracemalloc.start()
        many.inverse_dynamics(pose, twist, acceleration, **options)
        largest = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return largest

    assert peak(out=out, status=status, conditioning=conditioning) < 4000  # bytes: small objects of Python
    assert peak(status=status) > out.nbytes  # what numpy makes is seen


def test_a_singular_state_is_nan_with_its_code_and_conditioning() -> None:
    many = kernels("stewart")
    pose, rest = np.array([yawed(x) for x in (0.0, 90.0, 45.0)]), np.zeros((3, 6))
    status, conditioning = np.empty(3, dtype=np.int8), np.empty(3)
    regular = many.inverse_dynamics(pose[[0, 2]], rest[:2], rest[:2])
    tau = many.inverse_dynamics(pose, rest, rest, status=status, conditioning=conditioning)
    assert status.tolist() == [StateStatus.OK, StateStatus.SINGULAR, StateStatus.OK]
    assert np.isnan(tau[1]).all()
    np.testing.assert_allclose(tau[[0, 2]], regular, rtol=1e-12)
    assert 0.0 <= conditioning[1] < 1e-14 and (conditioning[[0, 2]] > 0.1).all()
    # The platform falls as it likes there: accelerations are as good as elsewhere.
    chain, fallen = many.chain, many.forward_dynamics(pose, rest, np.zeros((3, 6)), status=status)
    assert (status == StateStatus.OK).all()
    state = stp.platform_motion(chain, pin.XYZQUATToSE3(pose[1]), rest[0], rest[0])
    motion = stp.forward_dynamics(chain, state.q, state.v, np.zeros(6))
    back = stp.platform_motion(chain, pin.XYZQUATToSE3(pose[1]), rest[0], fallen[1])
    np.testing.assert_allclose(back.a, motion.a, atol=1e-9)


@pytest.mark.parametrize("off", [1e-6, 1e-7, 1e-9, 1e-10])
def test_kernels_and_one_state_call_the_same_states_singular(off: float) -> None:
    many, rest = kernels("stewart"), np.zeros(6)
    chain, pose = many.chain, yawed(90.0 - off)
    status = np.empty(1, dtype=np.int8)
    many.inverse_dynamics(pose[None], rest, rest, status=status)
    state = stp.platform_motion(chain, pin.XYZQUATToSE3(pose), rest, rest)
    try:
        stp.inverse_dynamics(chain, state.q, state.v, state.a)
        assert status[0] == StateStatus.OK
    except stp.errors.ActuationError:
        assert status[0] == StateStatus.SINGULAR


def test_a_singular_state_of_the_whole_tree_has_its_code() -> None:
    chain = robot("stewart")
    many = compile_kernels(chain, coordinates="tree")
    q = [stp.inverse_kinematics(chain, pin.XYZQUATToSE3(yawed(x))).q for x in (0.0, 90.0)]
    status = np.empty(2, dtype=np.int8)
    tau = many.inverse_dynamics(np.array(q), np.zeros(chain.nv), np.zeros(chain.nv), status=status)
    assert status.tolist() == [StateStatus.OK, StateStatus.SINGULAR]
    assert np.isnan(tau[1]).all() and np.isfinite(tau[0]).all()
    np.testing.assert_array_less(many.conditioning(np.array(q))[1], 1e-12)
    fallen = many.forward_dynamics(np.array(q), np.zeros(chain.nv), np.zeros(chain.nu), status=status)
    assert (status == StateStatus.OK).all()
    np.testing.assert_allclose(
        fallen[1], stp.forward_dynamics(chain, q[1], np.zeros(chain.nv), np.zeros(chain.nu)).a, atol=1e-8
    )


@pytest.mark.parametrize("engine", ["llvm", "numpy"])
def test_both_engines_judge_alike(engine, rng: np.random.Generator) -> None:
    many, rest = compile_kernels(robot("stewart"), engine=engine), np.zeros((4, 6))
    pose = np.array([yawed(x) for x in (0.0, 90.0, 10.0, 20.0)])
    pose[2, 0] = np.nan
    pose[3, 3:] *= 1.1
    status, conditioning = np.empty(4, dtype=np.int8), np.empty(4)
    many.inverse_dynamics(pose, rest, rest, status=status, conditioning=conditioning)
    assert status.tolist() == [
        StateStatus.OK,
        StateStatus.SINGULAR,
        StateStatus.INPUT_NOT_FINITE,
        StateStatus.OUT_OF_BOUNDS,
    ]
    assert conditioning[1] < 1e-12 and np.isnan(conditioning[2])


@pytest.mark.parametrize(
    "verb", ["inverse_dynamics", "forward_dynamics", "motor_jacobian", "inverse_kinematics"]
)
def test_one_state_at_a_time(verb: str, rng: np.random.Generator) -> None:
    many = kernels("stewart")
    arguments = calls(many, rng, 2)[verb]
    one = many.single_state(verb)
    for k in range(2):
        np.testing.assert_array_equal(one(*(x[k] for x in arguments)), getattr(many, verb)(*arguments)[k])
    if verb == "inverse_dynamics":
        assert np.isnan(one(yawed(90.0), np.zeros(6), np.zeros(6))).all()
        assert one.status == StateStatus.SINGULAR


def test_unknown_verbs_have_no_single_state() -> None:
    with pytest.raises(stp.errors.InputError, match="inverse_statics"):
        kernels("stewart").single_state("inverse_statics")


@pytest.mark.parametrize("name", ["stewart", "four_bar"])
def test_places_that_do_not_fit_are_refused(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    arguments = calls(many, rng, 3)["inverse_dynamics"]
    nu = many.chain.nu
    wrong = [
        {"out": np.empty((2, nu))},
        {"out": np.empty((3, nu), dtype=np.float32)},
        {"status": np.empty(2, dtype=np.int8)},
        {"status": np.empty(3, dtype=np.int64)},
        {"conditioning": np.empty((3, 1))},
        {"conditioning": np.empty(3, dtype=np.float32)},
        {"conditioning": np.empty(6)[::2][:2]},
    ]
    for options in wrong:
        with pytest.raises(stp.errors.InputError, match=next(iter(options))):
            many.inverse_dynamics(*arguments, **options)
        if "out" not in options:
            with pytest.raises(stp.errors.InputError, match=next(iter(options))):
                many.forward_kinematics(many.inverse_kinematics(arguments[0]), arguments[0], **options)
    with pytest.raises(stp.errors.InputError, match="memory"):
        many.inverse_dynamics(*arguments, out=arguments[1][:, :nu], conditioning=arguments[1][:, 0])


def test_guesses_must_be_as_many_as_motor_positions(rng: np.random.Generator) -> None:
    many = kernels("stewart")
    q_motor = many.inverse_kinematics(sample_states(rng, 3)[0])
    with pytest.raises(stp.errors.InputError, match="2 guesses for 3"):
        many.forward_kinematics(q_motor, np.tile(yawed(0.0), (2, 1)))


@pytest.mark.parametrize("coordinates", ["platform", "motor", "tree"])
@pytest.mark.parametrize("poor", [1e-2, 1e9])
def test_one_position_serves_many_motions(
    coordinates: Any, poor: float, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    monkeypatch.setattr(
        "stewart_pin.kernels.verbs.configurations.POOR", poor
    )  # 1e9: every state is looked at again
    chain = robot("four_bar")
    many = compile_kernels(chain, coordinates=coordinates, engine="numpy")
    motor = stp.motor_positions(chain, chain.q_home) + 0.1
    q = stp.forward_kinematics(chain, motor, limits=False).q
    position = {"platform": pin.SE3ToXYZQUAT(stp.platform_pose(chain, q)), "motor": motor, "tree": q}[
        coordinates
    ]
    size = {"platform": 6, "motor": chain.nu, "tree": chain.nv}[coordinates]
    share = rng.normal(size=(3, 1))
    motions = chain.at(q).freedom.motions[:, 0]
    way = {"platform": chain.at(q).P @ motions, "motor": motions[chain.motor_index], "tree": motions}[
        coordinates
    ]
    twist, rest = share * way, np.zeros((3, size))
    efforts = np.zeros((3, chain.nu))
    expected = many.forward_dynamics(np.tile(position, (3, 1)), twist, efforts)
    assert np.isfinite(expected).all()
    for one in (position, position[None]):
        status, conditioning = np.full(3, 7, dtype=np.int8), np.zeros(3)
        found = many.forward_dynamics(one, twist, efforts, status=status, conditioning=conditioning)
        np.testing.assert_array_equal(found, expected)
        assert not status.any()
        np.testing.assert_array_equal(many.forward_dynamics(one, twist, efforts), expected)
    assert many.inverse_dynamics(position[None], twist[:0], rest[:0]).shape == (0, chain.nu)
