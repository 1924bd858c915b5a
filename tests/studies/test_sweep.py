"""A function over a grid: every executor gives the same arrays, failures are told, and the queue stays short."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MissingExtraError
from tests.studies import functions

A, B = np.linspace(0.1, 2.3, 7), np.geomspace(0.3, 4.0, 5)


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with functions.processes(2) as pool:
        yield pool


def same(one: stp.sweeps.Sweep, other: stp.sweeps.Sweep) -> None:
    """Equal bit for bit; messages may print round-off, which depends on where in memory a matrix stands."""
    assert list(one.results) == list(other.results)
    for name, values in one.results.items():
        assert values.tobytes() == other[name].tobytes()
    assert [(f.index, f.point, f.error) for f in one.failures] == [
        (f.index, f.point, f.error) for f in other.failures
    ]


def test_results_stand_where_their_point_stands() -> None:
    found = stp.sweep(functions.wave, {"a": A, "b": B})
    assert found.shape == (7, 5) and found.success
    np.testing.assert_array_equal(found["sum"], np.sin(A)[:, None] + np.cos(B))
    assert found["vector"].shape == (7, 5, 3) and found["matrix"].shape == (7, 5, 2, 3)
    np.testing.assert_array_equal(found["vector"][4, 2], [A[4], B[2], A[4] / 3 + B[2]])
    assert "7 × 5 points of a, b" in str(found) and "matrix (7, 5, 2, 3)" in str(found)


def test_paired_axes_are_a_list_of_points(rng: np.random.Generator) -> None:
    a, b = rng.uniform(size=(2, 20))
    found = stp.sweep(functions.wave, {"a": a, "b": b}, paired=True)
    assert found.shape == (20,)
    np.testing.assert_array_equal(found["sum"], np.sin(a) + np.cos(b))


def test_a_number_is_called_value_and_strings_are_parameters() -> None:
    def dofs(robot: str, extra: int) -> int:
        return stp.mobility(stp.load(robot)).dof + extra

    found = stp.sweep(dofs, {"robot": ["stewart", "five_bar"], "extra": [0, 10]})
    np.testing.assert_array_equal(found["value"], [[6, 16], [2, 12]])


@pytest.mark.parametrize("chunk", [1, 4])
def test_no_executor_changes_a_bit(processes: Executor, chunk: int) -> None:
    alone = stp.sweep(functions.wave, {"a": A, "b": B})
    same(stp.sweep(functions.wave, {"a": A, "b": B}, executor=processes, chunk=chunk), alone)
    with ThreadPoolExecutor(3) as pool:
        # The first points are the last to come in.
        same(stp.sweep(functions.out_of_order, {"a": A, "b": B}, executor=pool, chunk=chunk), alone)


@pytest.mark.parametrize("name", ["lambda", "module"])
def test_dask_is_an_executor_like_others(name: str) -> None:
    distributed = pytest.importorskip("distributed")
    function: Callable = functions.wave if name == "module" else lambda a, b: functions.wave(a, b)
    with (
        distributed.LocalCluster(
            processes=False, n_workers=1, threads_per_worker=2, dashboard_address=None
        ) as c,
        distributed.Client(c) as client,
    ):
        found = stp.sweep(function, {"a": A, "b": B}, executor=client.get_executor(), chunk=3)
        same(found, stp.sweep(functions.wave, {"a": A, "b": B}))


def test_forces_by_workers_are_those_of_this_process(processes: Executor) -> None:
    axes = {"height": [0.9, 1.0, 1.1], "yaw": [0.0, 0.3, np.pi / 2]}
    found = stp.sweep(functions.holding_forces, axes)
    same(stp.sweep(functions.holding_forces, axes, executor=processes), found)
    # At a right angle the platform is singular, whatever its height.
    assert [failed.index for failed in found.failures] == [(0, 2), (1, 2), (2, 2)]
    assert {failed.error for failed in found.failures} == {"ActuationError"}
    # Six legs, each an equal share of the weight of platform and upper halves, and of lower halves by their lever.
    assert np.ptp(found["force"][1, 0]) < 1e-9 * found["force"][1, 0].max()


@pytest.mark.parametrize("where", ["here", "processes"])
def test_points_that_cannot_be_answered_are_nan(processes: Executor, where: str) -> None:
    executor = processes if where == "processes" else None
    found = stp.sweep(functions.unreachable_above_two, {"a": [1.0, 3.0, 2.0, 4.0]}, executor=executor)
    np.testing.assert_array_equal(found["value"], [1.0, np.nan, 2.0, np.nan])
    assert not found.success
    first = found.failures[0]
    assert (first.index, first.point, first.error) == ((1,), {"a": 3.0}, "UnreachableError")
    assert first.message == "3 is too far"
    assert "2 failed, the first at a=3.0" in str(found)


def test_where_all_points_fail_the_reason_is_told() -> None:
    found = stp.sweep(functions.unreachable_above_two, {"a": [3.0, 4.0]})
    with pytest.raises(InputError, match=r"all 2 points failed; the first, a=3\.0: 3 is too far"):
        found["value"]


@pytest.mark.parametrize("where", ["here", "threads", "processes"])
@pytest.mark.parametrize(
    ("function", "error", "text"),
    [
        (functions.broken_at_two, ZeroDivisionError, "division"),
        # As it is where a package has taught pickle to carry such errors, which importing distributed does.
        (functions.heavy_at_two, (RuntimeError, functions.HeavyError), "1 and 2"),
    ],
)
def test_another_error_stops_the_sweep_and_names_the_point(
    processes: Executor, where: str, function: Callable, error, text: str
) -> None:
    with ThreadPoolExecutor(2) as threads:
        executor = {"here": None, "threads": threads, "processes": processes}[where]
        with pytest.raises(error, match=text) as stopped:
            stp.sweep(function, {"a": [0, 1, 2, 3]}, executor=executor)
    assert "at the point a=2 of the sweep" in stopped.value.__notes__
    # The pool lives on.
    assert processes.submit(abs, -1).result() == 1


def test_a_missing_package_is_no_failure_of_a_point() -> None:
    def lacking(a: float) -> float:
        raise MissingExtraError("casadi", "kernels")

    with pytest.raises(MissingExtraError, match="casadi"):
        stp.sweep(lacking, {"a": [1.0]})


def test_one_point_and_none() -> None:
    one = stp.sweep(functions.wave, {"a": [2.0], "b": [3.0]})
    assert one["vector"].shape == (1, 1, 3)
    none = stp.sweep(functions.wave, {"a": [], "b": B})
    assert none.shape == (0, 5) and none.success and not none.results
    with pytest.raises(InputError, match="has no point"):
        none["sum"]


def test_progress_is_told() -> None:
    told: list[tuple[str, int, int]] = []
    stp.sweep(functions.wave, {"a": A, "b": B}, chunk=10, progress=lambda *report: told.append(report))
    assert told == [("points", n, 35) for n in (10, 20, 30, 35)]


class Counting(ThreadPoolExecutor):
    """Threads that know how many tasks they were ever left with."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self.open = self.most = 0
        self.lock = threading.Lock()

    def submit(self, fn: Callable, /, *args, **kwargs) -> Future:
        with self.lock:
            self.open += 1
            self.most = max(self.most, self.open)
        future = super().submit(fn, *args, **kwargs)
        future.add_done_callback(self._count_down)
        return future

    def _count_down(self, _: Future) -> None:
        with self.lock:
            self.open -= 1


@pytest.mark.parametrize(("wanted", "most"), [(None, 8), (3, 3)])
def test_the_queue_stays_short(wanted: int | None, most: int) -> None:
    with Counting(2) as pool:
        stp.sweep(functions.wave, {"a": np.arange(100.0), "b": [1.0]}, executor=pool, in_flight=wanted)
    assert 2 <= pool.most <= most


def test_an_interrupt_does_not_wait_for_the_queue() -> None:
    asked: list[float] = []
    gate = threading.Event()

    def first_then_wait(a: float) -> float:
        asked.append(a)
        return a if a == 0 or gate.wait(10.0) else np.nan

    def interrupt(stage: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(KeyboardInterrupt):
            stp.sweep(first_then_wait, {"a": np.arange(1000.0)}, executor=pool, progress=interrupt)
        gate.set()
    assert asked in ([0.0], [0.0, 1.0])  # what ran is left to end, what was queued is not begun


def test_failures_are_listed_in_the_order_of_their_points() -> None:
    first_is_known = threading.Event()

    def failing(a: float) -> float:
        if a == 1:
            first_is_known.wait(10.0)
        return functions.unreachable_above_two(a + 2)

    def tell(stage: str, done: int, total: int) -> None:
        first_is_known.set()

    with ThreadPoolExecutor(2) as pool:
        found = stp.sweep(failing, {"a": [1.0, 2.0]}, executor=pool, progress=tell)
    assert [failed.message for failed in found.failures] == ["3 is too far", "4 is too far"]


@pytest.mark.parametrize(
    ("axes", "options", "words"),
    [
        ({"a": [1.0]}, {}, "missing a required argument: 'b'"),
        ({"a": [1.0], "b": [1.0], "c": [1.0]}, {}, "unexpected keyword argument 'c'"),
        ({}, {}, "axes must map names"),
        ([1.0], {}, "axes must map names"),
        ({"a": 1.0, "b": [1.0]}, {}, "axis 'a' must be a list of numbers or of strings, got 1.0"),
        ({"a": [[1.0]], "b": [1.0]}, {}, "axis 'a' must be a list"),
        ({"a": [1.0, "x"], "b": [1.0]}, {}, "axis 'a' must be a list"),
        ({"a": [1.0, None], "b": [1.0]}, {}, "axis 'a' must be a list"),
        ({"a": [[1.0], [1.0, 2.0]], "b": [1.0]}, {}, "axis 'a' must be a list"),
        ({"a": [1j], "b": [1.0]}, {}, "axis 'a' must be a list"),
        ({"a": [1.0, np.nan], "b": [1.0]}, {}, "axis 'a' must be finite, got nan"),
        ({1: [1.0], "b": [1.0]}, {}, "axes must have names"),
        ({"a": [1.0, 2.0], "b": [1.0]}, {"paired": True}, "same number of values, got a 2, b 1"),
        ({"a": np.zeros(10**5), "b": np.zeros(10**5)}, {}, "100000000 is the most"),
        ({"a": [1.0], "b": [1.0]}, {"chunk": 0}, "chunk must be"),
        ({"a": [1.0], "b": [1.0]}, {"chunk": True}, "chunk must be"),
        ({"a": [1.0], "b": [1.0]}, {"in_flight": 0.5}, "in_flight must be"),
        ({"a": [1.0], "b": [1.0]}, {"executor": 4}, r"executor must be a concurrent\.futures\.Executor"),
    ],
)
def test_bad_input_is_refused(axes, options, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.sweep(functions.wave, axes, **options)


def test_functions_that_fit_in_other_ways() -> None:
    assert stp.sweep(functools.partial(functions.wave, b=2.0), {"a": A})["sum"].shape == (7,)
    assert stp.sweep(lambda **all: sum(all.values()), {"a": [1], "b": [2]})["value"] == [[3]]
    with pytest.raises(InputError, match="must be a function of a, got 3"):
        stp.sweep(3, {"a": [1]})


def test_what_cannot_be_sent_is_refused_before_it_is_sent(processes: Executor) -> None:
    lock = threading.Lock()
    with pytest.raises(InputError, match=r"cannot be sent to other processes .* top of a module"):
        stp.sweep(lambda a: a, {"a": [1.0]}, executor=processes)
    with pytest.raises(InputError, match="cannot be sent to other processes"):
        stp.sweep(functools.partial(functions.wave, b=lock), {"a": [1.0]}, executor=processes)


@pytest.mark.parametrize("given", ["text", None, 1j, [[1.0], [1.0, 2.0]], {"x": "text"}, {1: 2.0}])
def test_results_are_real_numbers(given) -> None:
    with pytest.raises(InputError, match=r"must give real numbers.*at a=1\.0"):
        stp.sweep(lambda a: given, {"a": [1.0]})


@pytest.mark.parametrize(
    "other", [{"x": [1.0, 2.0, 3.0]}, {"y": [1.0, 2.0]}, {"x": [1.0, 2.0], "y": 0.0}, {"x": 1.0}]
)
def test_results_keep_their_names_and_shapes(other) -> None:
    with pytest.raises(InputError, match=r"at a=1 they are {'x': \(2,\)}, at a=2"):
        stp.sweep(lambda a: {"x": [1.0, 2.0]} if a == 1 else other, {"a": [1, 2]})


def test_an_answer_that_the_function_changes_afterwards_stays() -> None:
    kept = np.zeros(2)

    def reuse(a: float) -> np.ndarray:
        kept[:] = a
        return kept

    np.testing.assert_array_equal(stp.sweep(reuse, {"a": [1.0, 2.0]}, chunk=2)["value"], [[1, 1], [2, 2]])
