"""Programs repeated on their own result: Newton's square root, each state stopping by itself."""

from __future__ import annotations

import pickle
import threading
import time

import casadi as ca
import numpy as np
import pytest

from stewart_pin.errors import InputError
from stewart_pin.programs.array_kernel import ArrayKernel, Engine, compile_function
from stewart_pin.programs.repeating import Repeat
from stewart_pin.programs.status import StateBound, StateStatus
from tests.programs.targets import TARGETS

pytest.importorskip("llvmlite")
each_engine = pytest.mark.parametrize("engine", ["llvm", "numpy"])
TEN = Repeat("x", "following", "gap", 1e-13, 10)


def square_root() -> ca.Function:
    """Take one step of x towards √a, and count the steps."""
    x, a, n = ca.SX.sym("x"), ca.SX.sym("a"), ca.SX.sym("n")
    outputs = [ca.vertcat((x[0] + a / x[0]) / 2), (x * x - a) / a, n]
    return ca.Function("root", [x, a, n], outputs, ["x", "a", "n"], ["following", "gap", "same"])


def numbers(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw squares, some of which are known to their root, so that states need unlike numbers of steps."""
    a = rng.uniform(0.5, 2.0, size=(n, 1))
    x = np.where(rng.random((n, 1)) < 0.5, np.sqrt(a), 1.0)
    return x, a


@each_engine
def test_states_reach_their_roots(engine: Engine, rng: np.random.Generator) -> None:
    kernel = compile_function(square_root(), repeat=TEN, engine=engine)
    x, a = numbers(rng, 100)
    following, gap, same = kernel(x, a, np.array([3.0]))
    assert np.abs(following - np.sqrt(a)).max() < 1e-15
    assert np.abs(gap).max() <= 1e-13
    assert np.all(same == 3.0)


@each_engine
def test_passes_are_counted(engine: Engine) -> None:
    """From far away each step halves: the number of passes shows."""
    a = np.array([[1.0]])
    for limit in (1, 2, 5):
        kernel = compile_function(
            square_root(), repeat=Repeat("x", "following", "gap", 0.0, limit), engine=engine
        )
        x = np.array([1e12])
        for _ in range(limit):
            x, expected_gap = (x + 1 / x) / 2, x * x - 1
        following, gap, _ = kernel(np.array([[1e12]]), a, np.zeros(1))
        assert following[0] == pytest.approx(x, rel=1e-14)
        assert gap[0] == pytest.approx(expected_gap, rel=1e-14)  # of the state that the last pass began with


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_a_state_does_not_depend_on_its_neighbours(target, rng: np.random.Generator) -> None:
    function = square_root()
    kernel = compile_function(function, repeat=TEN)
    kernel = ArrayKernel(kernel.program, repeat=TEN, target=target)
    x, a = numbers(rng, 64)
    x[::5], x[3], a[7] = 1e3, np.nan, -1.0  # slow ones, a bad one, and one without a root
    following, gap, _ = kernel(x, a, np.zeros(1), threads=1)
    single = kernel.single_state()
    for k in range(64):
        alone = kernel(x[k], a[k], np.zeros(1))
        assert alone[0].tobytes() == following[k].tobytes()
        assert single(x[k], a[k], np.zeros(1))[1].tobytes() == gap[k].tobytes()


@each_engine
def test_states_that_do_not_arrive_say_so_in_their_gap(engine: Engine) -> None:
    kernel = compile_function(square_root(), repeat=TEN, engine=engine, bounds=[])
    codes = np.zeros(4, dtype=np.int8)
    x, a = np.array([[1.0], [1e30], [np.nan], [0.0]]), np.ones((4, 1))
    following, gap, _ = kernel(x, a, np.zeros(1), status=codes)
    assert codes.tolist() == [0, 0, StateStatus.INPUT_NOT_FINITE, StateStatus.RESULT_NOT_FINITE]
    assert following[0, 0] == 1.0
    assert gap[1, 0] > 1.0
    assert np.isnan(following[2:]).all()


@each_engine
def test_bounds_judge_the_last_pass(engine: Engine) -> None:
    kernel = compile_function(
        square_root(), repeat=TEN, engine=engine, bounds=[StateBound("gap", -1e-12, 1e-12)]
    )
    codes = np.zeros(2, dtype=np.int8)
    kernel(np.array([[1.5], [1e30]]), np.ones(1), np.zeros(1), status=codes)
    assert codes.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS]


def test_pickles_with_its_repetition(rng: np.random.Generator) -> None:
    kernel = compile_function(square_root(), repeat=TEN)
    x, a = numbers(rng, 9)
    for again in (pickle.loads(pickle.dumps(kernel)), pickle.loads(pickle.dumps(kernel.single_state()))):
        assert np.array_equal(again(x[0], a[0], np.zeros(1))[0], kernel(x, a, np.zeros(1))[0][0])


def test_what_does_not_fit_is_refused() -> None:
    function = square_root()
    for names, message in [
        (("y", "following", "gap"), "root has no input 'y', only x, a, n"),
        (("x", "next", "gap"), "root has no output 'next'"),
        (("x", "following", "error"), "root has no output 'error'"),
    ]:
        with pytest.raises(InputError, match=message):
            compile_function(function, repeat=Repeat(*names, 1e-9, 3))
    with pytest.raises(InputError, match="limit must be 1 pass or more, got 0"):
        Repeat("x", "following", "gap", 1e-9, 0)
    with pytest.raises(InputError, match="tolerance must not be negative, got nan"):
        Repeat("x", "following", "gap", np.nan, 3)
    x = ca.SX.sym("x", 2)
    with pytest.raises(InputError, match=r"y \(1,\) cannot take the place of x \(2,\)"):
        compile_function(
            ca.Function("f", [x], [x[0], x], ["x"], ["y", "gap"]), repeat=Repeat("x", "y", "gap", 0.0, 3)
        )


def test_other_threads_run_meanwhile() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("long", [x], [0.5 * x + 1, ca.SX(1)], ["x"], ["y", "gap"])
    kernel = compile_function(function, repeat=Repeat("x", "y", "gap", 0.0, 100_000_000))
    spans: list[float] = []

    def work() -> None:
        spans.append(time.perf_counter())
        kernel(np.ones((1, 1)))
        spans.append(time.perf_counter())

    thread = threading.Thread(target=work)
    thread.start()
    turns = []
    while len(spans) < 2:
        turns.append(time.perf_counter())
        time.sleep(1e-3)
    thread.join()
    begin, end = spans
    assert end - begin > 0.05
    margin = 0.2 * (end - begin)
    # A kernel that kept the interpreter locked would let nobody turn until its end.
    assert sum(begin + margin < t < end - margin for t in turns) >= 3
