"""Calls with arrays: memory, sizes, threads, bad states, bad arguments, pickling."""

from __future__ import annotations

import gc
import pickle
import threading
import weakref
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from typing import Any

import casadi as ca
import numpy as np
import pytest

from stewart_pin.errors import InputError, MissingExtraError
from stewart_pin.programs import array_kernel
from stewart_pin.programs.array_kernel import ArrayKernel, compile_function
from stewart_pin.programs.llvm import machine_code
from stewart_pin.programs.passes import prepare
from stewart_pin.programs.program import Program
from stewart_pin.programs.status import StateBound, StateStatus
from stewart_pin.programs.symbolic import program_from_casadi
from tests.kernels.hexapod_graph import sample_inverse_dynamics, sample_states

pytest.importorskip("llvmlite")

HEXAPOD = prepare(program_from_casadi(sample_inverse_dynamics()))
ENGINES: tuple[array_kernel.Engine, ...] = ("llvm", "numpy")
each_engine = pytest.mark.parametrize("engine", ENGINES)


def polynomial() -> Program:
    """Read y = x₀² + x₁, z = 2 A."""
    x, a = ca.SX.sym("x", 2), ca.SX.sym("A", 2, 2)
    function = ca.Function("f", [x, a], [x[0] ** 2 + x[1], 2 * a], ["x", "A"], ["y", "z"])
    return prepare(program_from_casadi(function))


def judged() -> Program:
    """Read y = √x₀ + x₁, judged by x₁."""
    x = ca.SX.sym("x", 2)
    return program_from_casadi(ca.Function("f", [x], [ca.sqrt(x[0]) + x[1], x[1]], ["x"], ["y", "c"]))


@each_engine
@pytest.mark.parametrize("n", [0, 1, 2, 7, 8, 9, 15, 16, 17, 100])
def test_any_number_of_states(n: int, engine: array_kernel.Engine, rng: np.random.Generator) -> None:
    x, a = rng.normal(size=(n, 2)), rng.normal(size=(n, 2, 2))
    y, z = ArrayKernel(polynomial(), engine=engine)(x, a)
    assert y.shape == (n, 1)
    assert z.shape == (n, 2, 2)
    assert np.abs(y[:, 0] - (x[:, 0] ** 2 + x[:, 1])).max(initial=0.0) < 1e-15
    assert np.array_equal(z, 2 * a)


@each_engine
def test_one_state_without_an_axis_of_states(engine: array_kernel.Engine) -> None:
    y, z = ArrayKernel(polynomial(), engine=engine)([3.0, 1.0], np.eye(2))
    assert np.array_equal(y, [10.0])
    assert np.array_equal(z, 2 * np.eye(2))


@each_engine
def test_one_input_for_all_states(engine: array_kernel.Engine, rng: np.random.Generator) -> None:
    x = rng.normal(size=(11, 2))
    kernel = ArrayKernel(polynomial(), engine=engine)
    for a in (np.eye(2), np.eye(2)[None], np.broadcast_to(np.eye(2), (11, 2, 2))):
        assert np.array_equal(kernel(x, a)[1], np.broadcast_to(2 * np.eye(2), (11, 2, 2)))


def strided(x: np.ndarray, how: str) -> np.ndarray:
    """Give equal values that lie otherwise in memory."""
    n, k = x.shape
    if how == "part of wider rows":
        whole = np.full((n, k + 5), np.nan)
        whole[:, 2 : 2 + k] = x
        return whole[:, 2 : 2 + k]
    if how == "backwards":
        return np.ascontiguousarray(x[::-1])[::-1]
    if how == "every third row":
        whole = np.full((3 * n, k), np.nan)
        whole[::3] = x
        return whole[::3]
    if how == "columns":
        return np.asfortranarray(x)
    if how == "every second entry":
        whole = np.full((n, 2 * k), np.nan)
        whole[:, ::2] = x
        return whole[:, ::2]
    if how == "big-endian":
        return x.astype(">f8")
    if how == "unaligned":
        raw = np.zeros(x.nbytes + 1, dtype=np.uint8)[1:].view(np.float64).reshape(n, k)
        raw[:] = x
        return raw
    if how == "read-only":
        x = x.copy()
        x.setflags(write=False)
        return x
    return x.tolist()


LAYOUTS = [
    "part of wider rows",
    "backwards",
    "every third row",
    "columns",
    "every second entry",
    "big-endian",
]
LAYOUTS += ["unaligned", "read-only", "list"]


@each_engine
@pytest.mark.parametrize("how", LAYOUTS)
def test_any_layout_gives_the_same_bits(
    how: str, engine: array_kernel.Engine, rng: np.random.Generator
) -> None:
    states = sample_states(rng, 29)
    kernel = ArrayKernel(HEXAPOD, engine=engine)
    assert np.array_equal(kernel(*(strided(x, how) for x in states)), kernel(*states))


def test_results_go_to_rows_of_a_wider_array(rng: np.random.Generator) -> None:
    states = sample_states(rng, 29)
    kernel = ArrayKernel(HEXAPOD)
    whole = np.full((29, 9), -7.0)
    given = kernel(*states, out=whole[:, 1:7])
    assert given.base is whole
    assert np.array_equal(whole[:, 1:7], kernel(*states))
    assert np.all(whole[:, [0, 7, 8]] == -7.0)


def test_nothing_outside_is_written(rng: np.random.Generator) -> None:
    """Rows before and after the result, for sizes around the vector width."""
    kernel = ArrayKernel(HEXAPOD)
    for n in (1, 7, 8, 9, 17):
        states = sample_states(rng, n)
        whole, codes = np.full((n + 40, 6), -7.0), np.full(n + 40, -7, dtype=np.int8)
        kernel(*states, out=whole[20 : 20 + n], status=codes[20 : 20 + n])
        assert np.all(whole[:20] == -7.0)
        assert np.all(whole[20 + n :] == -7.0)
        assert np.all(codes[:20] == -7)
        assert np.all(codes[20 + n :] == -7)
        assert np.all(codes[20 : 20 + n] == StateStatus.OK)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_result_depends_neither_on_place_nor_threads(dtype: Any, rng: np.random.Generator) -> None:
    states = [x.astype(dtype) for x in sample_states(rng, 5003)]
    kernel = ArrayKernel(HEXAPOD, dtype=dtype)
    whole = kernel(*states)
    for threads in (2, 3, 7):
        codes = np.full(5003, -1, dtype=np.int8)
        assert np.array_equal(kernel(*states, threads=threads, status=codes), whole)
        assert np.all(codes == StateStatus.OK)
    for begin in (1, 5, 4990):
        assert np.array_equal(kernel(*(x[begin:] for x in states)), whole[begin:])


def test_threads_hold_the_arrays_that_they_work_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """A caller that is interrupted while it waits leaves threads behind, and drops its arrays."""

    def interrupted(self: threading.Thread, timeout: float | None = None) -> None:
        raise KeyboardInterrupt

    x = ca.SX.sym("x")
    kernel = compile_function(ca.Function("f", [x], [2 * x], ["x"], ["y"]))
    gate, code = threading.Event(), kernel._code
    assert code is not None

    def gated(begin: int, end: int, table: object) -> None:
        if begin:  # the caller's own share is not held up
            gate.wait()
        code(begin, end, table)

    monkeypatch.setattr(kernel, "_code", gated)
    before = set(threading.enumerate())
    states = np.ones((2048, 1))
    alive = weakref.ref(states)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(threading.Thread, "join", interrupted)
        kernel(states, threads=2)
    del states
    gc.collect()
    held, left = alive() is not None, set(threading.enumerate()) - before
    gate.set()
    for thread in left:
        thread.join()
    assert held and left
    del thread, left
    gc.collect()
    assert alive() is None


def test_other_types_are_converted(rng: np.random.Generator) -> None:
    states = sample_states(rng, 12)
    rounded = [x.astype(np.float32) for x in states]
    double, single = ArrayKernel(HEXAPOD), ArrayKernel(HEXAPOD, dtype=np.float32)
    assert np.array_equal(double(*rounded), double(*(x.astype(np.float64) for x in rounded)))
    assert np.array_equal(single(*states), single(*rounded))
    assert single(*states).dtype == np.float32
    # Condition about ten, times the round-off of a thousand operations.
    assert np.abs(single(*states) - double(*states)).max() < 1e-4 * np.abs(double(*states)).max()
    integers = np.array([[3, 4]])
    assert ArrayKernel(polynomial())(integers, np.eye(2))[0][0, 0] == 13.0


@each_engine
def test_bad_states_do_not_spoil_their_neighbours(
    engine: array_kernel.Engine, rng: np.random.Generator
) -> None:
    kernel = ArrayKernel(judged(), bounds=[StateBound("c", -0.5, 2.0)], engine=engine)
    x = rng.uniform(0.1, 1.0, size=(21, 2))
    clean = kernel(x)
    x[3, 0], x[5, 1], x[6, 0], x[7, 1] = np.nan, np.inf, -1.0, 2.5
    x[8], x[9, 1], x[10, 1], x[11, 1] = (-np.inf, 3.0), -0.51, 2.0, -0.5
    codes = np.full(21, -1, dtype=np.int8)
    y = kernel(x, status=codes)
    expected = np.zeros(21, dtype=int)
    expected[[3, 5, 8]] = StateStatus.INPUT_NOT_FINITE
    expected[6] = StateStatus.RESULT_NOT_FINITE
    expected[[7, 9]] = StateStatus.OUT_OF_BOUNDS
    assert np.array_equal(codes, expected)
    assert np.array_equal(np.isnan(y[:, 0]), expected != 0)
    good = (expected == 0) & ~np.isin(np.arange(21), [10, 11])
    assert np.array_equal(y[good], clean[good])


def test_result_that_overflows_is_told_from_a_bad_input() -> None:
    kernel = ArrayKernel(polynomial())
    codes = np.zeros(2, dtype=np.int8)
    y, z = kernel(np.array([[1e200, 0.0], [1.0, 1.0]]), np.eye(2), status=codes)
    assert codes.tolist() == [StateStatus.RESULT_NOT_FINITE, StateStatus.OK]
    assert np.isnan(y[0]).all()
    assert np.isnan(z[0]).all()  # all outputs of a bad state
    assert y[1, 0] == 2.0


def test_locked_hexapod_is_out_of_bounds(rng: np.random.Generator) -> None:
    program = prepare(program_from_casadi(sample_inverse_dynamics(conditioning=True)))
    kernel = ArrayKernel(program, bounds=[StateBound("smallest_pivot", 1e-3)])
    assert [p.name for p in kernel.outputs] == ["tau_motor"]
    pose, twist, acceleration = sample_states(rng, 9)
    pose[4] = [0, 0, 0, 0, 0, 0, 1]  # base and platform in one plane
    codes = np.zeros(9, dtype=np.int8)
    tau = kernel(pose, twist, acceleration, status=codes)
    assert codes.tolist() == [0, 0, 0, 0, StateStatus.OUT_OF_BOUNDS, 0, 0, 0, 0]
    assert np.array_equal(np.isnan(tau).all(axis=1), codes != 0)


def test_arguments_that_do_not_fit_are_refused(rng: np.random.Generator) -> None:
    kernel = ArrayKernel(polynomial())
    x, a = rng.normal(size=(4, 2)), rng.normal(size=(4, 2, 2))
    y, z = kernel(x, a)
    for arguments, options, message in [
        ((x,), {}, r"takes 2 arrays \(x, A\), got 1"),
        ((x[:, :1], a), {}, r"x must have shape \(N, 2\) or \(2,\), got \(4, 1\)"),
        ((x, a[:, 0]), {}, r"A must have shape \(N, 2, 2\) or \(2, 2\), got \(4, 2\)"),
        ((x[None], a), {}, "x must have shape"),
        ((x[:3], a), {}, "differ in the number of states: x 3, A 4"),
        ((x[:0], a), {}, "differ in the number of states: x 0, A 4"),
        ((x + 0j, a), {}, "x must be an array of real numbers"),
        ((np.ma.masked_less(x, 0.0), a), {}, "x must be an array of real numbers, got MaskedArray"),
        (("abc", a), {}, "x must be an array of real numbers, got str"),
        (([[1.0], [1.0, 2.0]], a), {}, "x must be an array of real numbers"),
        ((x, a), {"threads": 0}, "threads must be a number of threads, 1 or more, got 0"),
        ((x, a), {"threads": 1.5}, "threads must be"),
        ((x, a), {"out": y}, r"out must hold 2 arrays \(y, z\), got 1"),
        (
            (x, a),
            {"out": (y, z[:3])},
            r"out for z must be an array float64 \(4, 2, 2\), got float64 \(3, 2, 2\)",
        ),
        ((x, a), {"out": (y.astype(np.float32), z)}, "out for y must be an array float64"),
        ((x, a), {"out": (y, z.transpose(0, 2, 1))}, "out for z must be writable, with the entries"),
        ((x, a), {"out": (y, y)}, "out for z must be an array"),
        ((x, a), {"out": ([0.0], z)}, "out for y must be an array .* got list"),
        ((x, a), {"status": np.zeros(4)}, "status must be an array int8"),
        ((x, a), {"status": np.zeros(8, dtype=np.int8)[::2]}, "status must be contiguous"),
    ]:
        with pytest.raises(InputError, match=message):
            kernel(*arguments, **options)
    frozen = np.empty((4, 1))
    frozen.setflags(write=False)
    with pytest.raises(InputError, match="out for y must be writable"):
        kernel(x, a, out=(frozen, z))
    piled = np.lib.stride_tricks.as_strided(np.zeros(9), (4, 2, 2), (8, 16, 8))
    with pytest.raises(InputError, match="states that overlap"):
        kernel(x, a, out=(y, piled))


def test_memory_that_overlaps_is_refused_and_interleaved_rows_are_not(rng: np.random.Generator) -> None:
    x = ca.SX.sym("x", 2)
    kernel = ArrayKernel(program_from_casadi(ca.Function("f", [x], [2 * x], ["x"], ["y"])))
    whole = rng.normal(size=(20, 4))
    states = whole[:, :2].copy()
    kernel(whole[:, :2], out=whole[:, 2:])
    assert np.array_equal(whole, np.concatenate([states, 2 * states], axis=1))
    for out in (whole[:, :2], whole[:, 1:3]):
        with pytest.raises(InputError, match="out for y must not share memory with x"):
            kernel(whole[:, :2], out=out)
    codes = np.zeros(20 * 8, dtype=np.int8)
    with pytest.raises(InputError, match="status must not share memory with out for y"):
        kernel(states[:10], out=codes.view(np.float64).reshape(10, 2), status=codes[:10])


def test_options_that_do_not_fit_are_refused() -> None:
    for options, message in [
        ({"dtype": np.float16}, "dtype must be float64 or float32, got float16"),
        ({"engine": "numba"}, "engine must be 'llvm', 'numpy' or None, got 'numba'"),
        ({"bounds": [StateBound("c", 0.0)]}, "f has no output 'c', only y, z"),
    ]:
        with pytest.raises(InputError, match=message):
            ArrayKernel(polynomial(), **options)
    with pytest.raises(InputError, match="no value lies between"):
        StateBound("c", 1.0, 0.0)
    with pytest.raises(InputError, match="no value lies between"):
        StateBound("c", np.nan)


def test_without_the_compiler_numpy_takes_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "llvmlite", None)
    monkeypatch.setitem(__import__("sys").modules, "llvmlite.binding", None)
    kernel = ArrayKernel(polynomial())
    assert kernel.engine == "numpy"
    assert kernel(np.array([3.0, 1.0]), np.eye(2))[0] == 10.0
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[kernels\]"):
        ArrayKernel(polynomial(), engine="llvm")
    with pytest.raises(MissingExtraError, match="llvmlite"):
        machine_code.host_target()


@each_engine
def test_pickles_as_the_program(engine: array_kernel.Engine, rng: np.random.Generator) -> None:
    states = sample_states(rng, 13)
    kernel = ArrayKernel(HEXAPOD, dtype=np.float32, engine=engine, bounds=())
    again = pickle.loads(pickle.dumps(kernel))
    assert again.engine == engine
    assert np.array_equal(again(*states), kernel(*states))
    single = pickle.loads(pickle.dumps(kernel.single_state()))
    assert np.array_equal(single(*(x[0] for x in states)), kernel(*states)[0])


def _in_process(kernel: ArrayKernel, states: tuple[np.ndarray, ...]) -> np.ndarray:
    return kernel(*states)


def test_kernels_work_in_other_processes(rng: np.random.Generator) -> None:
    states, kernel = sample_states(rng, 50), ArrayKernel(HEXAPOD)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        results = [pool.submit(_in_process, kernel, states) for _ in range(3)]
        assert all(np.array_equal(r.result(), kernel(*states)) for r in results)


def test_many_kernels_are_made_and_called_in_many_threads(rng: np.random.Generator) -> None:
    states = sample_states(rng, 3000)
    expected = ArrayKernel(HEXAPOD)(*states)
    small, x = polynomial(), rng.normal(size=(100, 2))
    expected_small = ArrayKernel(small)(x, np.eye(2))[0]

    def work(k: int) -> bool:
        if k % 4:
            return np.array_equal(ArrayKernel(small)(x, np.eye(2))[0], expected_small)
        return np.array_equal(ArrayKernel(HEXAPOD)(*states, threads=2), expected)

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(16)))


def test_one_kernel_is_called_in_many_threads(rng: np.random.Generator) -> None:
    kernel = ArrayKernel(HEXAPOD)
    parts = [sample_states(rng, 500 + k) for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(lambda states: kernel(*states), parts))
    assert all(np.array_equal(r, kernel(*states)) for r, states in zip(results, parts, strict=True))


def test_code_goes_with_the_kernel_and_not_before(rng: np.random.Generator) -> None:
    states = sample_states(rng, 20)
    kernel = ArrayKernel(HEXAPOD)
    expected, single = kernel(*states), kernel.single_state()
    one, run, outputs = single(*(x[0] for x in states)).copy(), single.run, single.outputs
    for _ in range(20):
        ArrayKernel(polynomial())
    del kernel, single
    gc.collect()
    outputs[0][:] = 0.0
    run()  # the bare function keeps its code and its arrays
    assert np.array_equal(outputs[0], one)
    assert np.array_equal(one, expected[0])


def test_no_memory_is_taken_when_the_result_has_its_place(rng: np.random.Generator) -> None:
    import tracemalloc

    kernel, states = ArrayKernel(HEXAPOD), sample_states(rng, 100_000)
    out = np.empty((100_000, 6))
    kernel(*states, out=out)
    tracemalloc.start()
    try:
        kernel(*states, out=out, threads=2)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 50_000  # bytes; the result alone has 4.8 MB


@pytest.mark.slow
def test_ten_million_states() -> None:
    x = ca.SX.sym("x", 1)
    kernel = ArrayKernel(program_from_casadi(ca.Function("f", [x], [x * x], ["x"], ["y"])))
    states = np.arange(10_000_001, dtype=np.float64)[:, None]
    for threads in (1, 2):
        y = kernel(states, threads=threads)
        assert np.array_equal(y, states * states)
