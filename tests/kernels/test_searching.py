"""One state at a time where pose or configuration must be found first: as the verbs for arrays, bit for bit."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.programs.status import StateStatus
from tests.closed_states import random_configuration, random_motion, robot, slow_but_for_few

pytest.importorskip("llvmlite")
ROBOTS = ("stewart", "delta", "five_bar", "four_bar", "rpr_planar")
CASES = [
    pytest.param(name, coordinates, marks=() if name == "four_bar" else pytest.mark.slow)
    for name in ROBOTS
    for coordinates in ("platform", "motor", "tree")
]
VERBS = (
    "inverse_dynamics",
    "forward_dynamics",
    "reactions",
    "regressor",
    "conditioning",
    "inverse_dynamics_derivatives",
    "forward_dynamics_derivatives",
    "inverse_dynamics_geometry",
    "forward_dynamics_geometry",
    "motor_jacobian",
    "inverse_kinematics",
    "forward_kinematics",
)


@cache
def kernels(name: str, coordinates: str, dtype: type = np.float64) -> stp.compiled.Kernels:
    return stp.compile_kernels(robot(name), coordinates=coordinates, dtype=dtype)


def states(many: stp.compiled.Kernels, rng: np.random.Generator, count: int) -> tuple[list[np.ndarray], ...]:
    """Motions in the coordinates of the kernels, and motor positions with a pose near theirs."""
    chain, rows = many.chain, []
    for _ in range(count):
        q = random_configuration(chain, rng, 0.05)
        v, a = random_motion(chain, rng, q)
        state, pose = chain.at(q, v), pin.SE3ToXYZQUAT(stp.platform_pose(chain, q))
        by = {
            "tree": (q, v, a),
            "motor": (q[chain.motor_q_index], v[chain.motor_index], a[chain.motor_index]),
            "platform": (pose, state.P @ v, state.P @ a + state.platform_bias),
        }[many.coordinates]
        rows.append((*by, q[chain.motor_q_index], pose, rng.normal(size=chain.nu)))
    return tuple(np.array(x) for x in zip(*rows, strict=True))


def arguments(verb: str, given: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    position, rate, acceleration, motors, pose, tau = given
    if verb == "forward_kinematics":
        return motors, pose
    if verb in ("inverse_kinematics", "motor_jacobian", "conditioning"):
        return (position,)
    return position, rate, tau if verb.startswith("forward") else acceleration


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(("name", "coordinates"), CASES)
def test_as_the_verb_for_arrays(name: str, coordinates: str, verb: str, rng: np.random.Generator) -> None:
    if verb.endswith("_geometry") and name not in ("five_bar", "four_bar"):
        pytest.skip("all parameters of larger robots take minutes to compile")
    many = kernels(name, coordinates)
    given = arguments(verb, states(many, rng, 3))
    try:
        expected = getattr(many, verb)(*given)
    except (UnsupportedError, InputError) as error:
        with pytest.raises(type(error)):
            many.single_state(verb)
        return
    one = many.single_state(verb)
    kept = [one(*(x[k] for x in given)) for k in range(3)]
    assert one.status is StateStatus.OK
    several = isinstance(expected, tuple)
    for k, found in enumerate(kept):  # looked at after the last call: each is an array of its own
        for part, whole in zip(
            found if several else [found], expected if several else [expected], strict=True
        ):
            np.testing.assert_array_equal(np.squeeze(part), np.squeeze(whole[k]))


@pytest.mark.parametrize("name", slow_but_for_few(["stewart", "five_bar", "four_bar"], ["four_bar"]))
def test_out_of_reach_is_nan_with_its_code(name: str, rng: np.random.Generator) -> None:
    many = kernels(name, "motor")
    position, rate, acceleration, *_ = (x[0] for x in states(many, rng, 1))
    one = many.single_state("inverse_dynamics")
    far = np.where(np.arange(many.chain.nu) == 0, 50.0 + position, position)
    code = np.zeros(1, dtype=np.int8)
    expected = many.inverse_dynamics(far[None], rate[None], acceleration[None], status=code)
    np.testing.assert_array_equal(one(far, rate, acceleration), expected[0])
    assert one.status == code[0]
    out = np.empty(many.chain.nu)
    assert one(position, rate, acceleration, out=out) is out
    assert one.status is StateStatus.OK and np.isfinite(out).all()
    again = pickle.loads(pickle.dumps(one))
    np.testing.assert_array_equal(again(position, rate, acceleration), out)


def test_single_precision_and_bad_arguments(rng: np.random.Generator) -> None:
    many = kernels("stewart", "platform", np.float32)
    *_, motors, pose, _ = (x[0] for x in states(many, rng, 1))
    one = many.single_state("forward_kinematics")
    np.testing.assert_array_equal(one(motors, pose), many.forward_kinematics(motors, pose))
    for wrong, message in [
        ((motors,), "takes 2 arrays"),
        ((motors[:5], pose), "q_motor must be one state"),
        ((motors, "no"), "pose_guess must be an array of real numbers"),
    ]:
        with pytest.raises(InputError, match=message):
            one(*wrong)
    with pytest.raises(InputError, match="out must"):
        one(motors, pose, out=np.empty(7))
