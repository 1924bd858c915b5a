"""Kernels of chains as an emulated Arm processor runs them: the bits of this machine, where it fuses as Arm does."""

from __future__ import annotations

import contextlib
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.kernels import Kernels, compile_kernels
from stewart_pin.programs.array_kernel import ArrayKernel
from stewart_pin.programs.arrays import as_states
from stewart_pin.programs.llvm.machine_code import Target
from stewart_pin.programs.repeating import interpreted
from stewart_pin.programs.status import StateStatus, written_outputs
from tests.closed_states import random_configuration, random_motion, robot
from tests.zoo.table import ROBOTS

pytest.importorskip("lief", reason="needs LIEF: pip install 'stewart_pin[oracles]'")
pytest.importorskip("unicorn", reason="needs Unicorn: pip install 'stewart_pin[oracles]'")

from tests.oracles.arm_kernels import SYSTEMS, ArmKernel, same

each_system = pytest.mark.parametrize("target", SYSTEMS.values(), ids=SYSTEMS)
each_type = pytest.mark.parametrize("dtype", [np.float64, np.float32])
NAMES = ("stewart", "hexapod_rss")
UNLIKE = sorted(set(ROBOTS) - {"stewart_cad", "stewart_s1"})  # whose legs are those of another one
STATES = [
    (name, coordinates)
    for name in UNLIKE
    for coordinates in ("platform", "motor", "tree")
    # The whole tree of a hexapod takes minutes to compile, and a platform does not determine a redundant arm.
    if (robot(name).nv < 24 or coordinates == "platform") and (name, coordinates) != ("arm_7r", "platform")
]
BY_MOTION = (
    "inverse_dynamics",
    "forward_dynamics",
    "reactions",
    "regressor",
    "inverse_dynamics_derivatives",
    "forward_dynamics_derivatives",
)


class Call(NamedTuple):
    """What a kernel was given, (n, *shape) or (1, *shape) each, and what it gave on this machine."""

    kernel: ArrayKernel
    inputs: list[np.ndarray]
    outputs: list[np.ndarray]
    codes: np.ndarray

    def first(self, n: int) -> Call:
        """Take the first states."""
        inputs = [x[:n] for x in self.inputs]
        return Call(self.kernel, inputs, [x[:n] for x in self.outputs], self.codes[:n])


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[Call]:
    """Note what kernels are given and give while verbs use them."""
    noted: list[Call] = []
    plain = ArrayKernel.__call__

    def noting(kernel: ArrayKernel, *inputs: Any, status: Any = None, **options: Any) -> Any:
        ports = kernel.program.inputs
        taken = [np.array(as_states(p, x, kernel.dtype)[0]) for p, x in zip(ports, inputs, strict=True)]
        codes = np.empty(max(map(len, taken)), dtype=np.int8) if status is None else status
        given = plain(kernel, *inputs, status=codes, **options)
        values = given if isinstance(given, tuple) else (given,)
        shaped = [
            np.array(x).reshape(len(codes), *p.shape) for x, p in zip(values, kernel.outputs, strict=True)
        ]
        noted.append(Call(kernel, taken, shaped, codes.copy()))
        return given

    monkeypatch.setattr(ArrayKernel, "__call__", noting)
    return noted


@cache
def kernels(name: str, dtype: type, coordinates: Any = "platform") -> Kernels:
    return compile_kernels(robot(name), dtype=dtype, coordinates=coordinates)


def motions(many: Kernels, rng: np.random.Generator, n: int = 9) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw states that the chain can be in, in the coordinates of its kernels."""
    chain, states = many.chain, []
    for _ in range(n):
        q = random_configuration(chain, rng, 0.05)
        v, a = random_motion(chain, rng, q)
        if many.coordinates == "tree":
            states.append((q, v, a))
        elif many.coordinates == "motor":
            states.append((q[chain.motor_q_index], v[chain.motor_index], a[chain.motor_index]))
        else:
            jacobian = chain.at(q).P
            acceleration = jacobian @ a + chain.at(q, v).platform_bias
            states.append((pin.SE3ToXYZQUAT(stp.platform_pose(chain, q)), jacobian @ v, acceleration))
    pose, twist, acceleration = (np.array(x) for x in zip(*states, strict=True))
    return pose, twist, acceleration


@cache
def on_arm(kernel: ArrayKernel, target: Target) -> ArmKernel:
    return ArmKernel(kernel, target)


def agree(call: Call, target: Target) -> None:
    answer = on_arm(call.kernel, target)(*call.inputs)
    assert np.array_equal(answer.codes, call.codes)
    for there, here in zip(answer.outputs, call.outputs, strict=True):
        assert same(there, here), call.kernel


@each_system
@each_type
@pytest.mark.parametrize("name", ["stewart", pytest.param("hexapod_rss", marks=pytest.mark.slow)])
def test_main_verbs(
    name: str, dtype: type, target: Target, calls: list[Call], rng: np.random.Generator
) -> None:
    many = kernels(name, dtype)
    pose, twist, acceleration = motions(many, rng)
    tau_motor = many.inverse_dynamics(pose, twist, acceleration)
    many.forward_dynamics(pose, twist, tau_motor)
    q_motor = many.inverse_kinematics(pose)
    found = many.forward_kinematics(q_motor, pose[0])
    assert np.abs(found - pose).max() < (1e-9 if dtype is np.float64 else 1e-3)
    assert any(call.kernel.repeat for call in calls)  # Newton steps, repeated without leaving the machine
    for call in calls:
        assert np.all(call.codes == 0)
        for n in (1, 7, 8, 9):
            agree(call.first(n), target)


@each_type
@pytest.mark.parametrize("name", NAMES)
def test_by_an_interpreter_with_more_digits(
    name: str, dtype: type, calls: list[Call], rng: np.random.Generator
) -> None:
    many = kernels(name, dtype)
    pose, twist, acceleration = motions(many, rng)
    many.inverse_dynamics(pose, twist, acceleration)
    many.forward_dynamics(pose, twist, acceleration[:, : many.chain.nu])
    many.inverse_kinematics(pose)
    for kernel, inputs, _, _ in calls:
        answer = on_arm(kernel, SYSTEMS["Linux"])(*inputs)
        exact = interpreted(kernel.program, inputs, np.longdouble, kernel.repeat)
        named = dict(zip((p.name for p in kernel.program.outputs), exact, strict=True))
        for port, there in zip(written_outputs(kernel.program, kernel.bounds), answer.outputs, strict=True):
            size = np.abs(named[port.name]).max(axis=1, keepdims=True)
            # Some thousand operations, the worst of them solving six equations near home.
            assert np.all(np.abs(there - named[port.name]) <= 2000 * np.finfo(dtype).eps * size)


@each_system
@each_type
@pytest.mark.parametrize("name", NAMES)
def test_one_state_at_fixed_addresses(
    name: str, dtype: type, target: Target, calls: list[Call], rng: np.random.Generator
) -> None:
    many = kernels(name, dtype)
    pose, twist, acceleration = motions(many, rng, 2)
    many.inverse_dynamics(pose, twist, acceleration)
    many.forward_kinematics(many.inverse_kinematics(pose), pose[0])
    for call in calls:
        answer = on_arm(call.kernel, target).one(*(x[-1] for x in call.inputs))
        assert answer.codes.tolist() == [0]
        for there, here in zip(answer.outputs, call.outputs, strict=True):
            assert same(there, here[-1]), call.kernel


@each_system
@each_type
def test_bad_states(dtype: type, target: Target, calls: list[Call], rng: np.random.Generator) -> None:
    many = kernels("stewart", dtype)
    pose, twist, acceleration = motions(many, rng)
    twist[1, 2], acceleration[3, 5], pose[8, 0] = np.nan, np.inf, -np.inf
    pose[4, 3:] *= 1.1  # of no unit length
    acceleration[6] = np.finfo(dtype).max / 2  # overflows on the way
    codes = np.empty(9, dtype=np.int8)
    tau_motor = many.inverse_dynamics(pose, twist, acceleration, status=codes)
    bad = np.zeros(9, dtype=np.int8)
    bad[[1, 3, 8]] = StateStatus.INPUT_NOT_FINITE
    bad[4] = StateStatus.OUT_OF_BOUNDS
    bad[6] = StateStatus.RESULT_NOT_FINITE
    assert np.array_equal(codes, bad)
    assert np.array_equal(np.isnan(tau_motor).all(axis=1), bad != 0)
    (call,) = calls
    agree(call, target)
    for k in (1, 4, 6):
        answer = on_arm(call.kernel, target).one(*(x[k] for x in call.inputs))
        assert answer.codes.tolist() == [bad[k]]
        assert np.isnan(answer.outputs[0]).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "coordinates"), STATES)
def test_every_verb_of_every_robot(
    name: str, coordinates: str, calls: list[Call], rng: np.random.Generator
) -> None:
    many = kernels(name, np.float64, coordinates)
    pose, twist, acceleration = motions(many, rng, 3)
    for verb in BY_MOTION:
        if verb in many.names:
            last = np.ones((3, many.chain.nu)) if verb.startswith("forward") else acceleration
            with contextlib.suppress(UnsupportedError):  # derivatives and regressors of some
                getattr(many, verb)(pose, twist, last)
    legs = many._functions.leg_displacements
    if legs or many.chain.nv < 15:  # hundreds of thousands of operations otherwise, of the same kinds
        along = [many.geometry_parameters[k] for k in legs] or None
        many.inverse_dynamics_geometry(pose, twist, acceleration, along=along)
        many.forward_dynamics_geometry(pose, twist, np.ones((3, many.chain.nu)), along=along)
    if coordinates == "platform":
        many.motor_jacobian(pose)
        many.conditioning(pose)
        many.forward_kinematics(many.inverse_kinematics(pose), pose[0])
    assert {"inverse_dynamics", "forward_dynamics"} <= {call.kernel.program.name for call in calls}
    for call in {id(call.kernel): call for call in calls}.values():
        agree(call.first(9), SYSTEMS["Linux"])
