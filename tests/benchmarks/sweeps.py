"""Time of sweeps for a state or a point, with and without kernels, with one and two workers. Run by hand; two minutes.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.sweeps``. All run in turn in one process, round after round, workers
being started before; medians, and ratios to the first way of the same table in the same round. Each way is first
checked to give the same figures. Times hold the making of the motions, the figures and all transport.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import stewart_pin as stp

INSTANTS = 400
"""States of a motion."""
Way = Callable[[], stp.sweeps.Sweep]


def shake(chain: stp.ClosedChain, amplitude: float, frequency: float) -> stp.motions.PlatformSamples:
    """Shake along x for a period."""
    return stp.motions.sinusoidal_motion(
        np.arange(INSTANTS) / INSTANTS / frequency,
        home=stp.platform_pose(chain, chain.q_home),
        amplitude=(amplitude * chain.length_scale, 0.0, 0.0),
        frequency=(frequency, 0.0, 0.0),
    )


def product(a: float, b: float) -> float:
    """Take no time."""
    return a * b


def demand_ways(name: str, side: int, careful: bool, workers: dict[str, Any]) -> dict[str, Way]:
    """Sweep side × side motions of a robot by kernels, and without them if `careful`."""
    chain = stp.load(name)
    axes = {"amplitude": np.geomspace(0.001, 0.05, side), "frequency": np.geomspace(0.5, 12.0, side)}
    sweep = partial(stp.sweep_demand, chain, shake, axes)
    ways: dict[str, Way] = {}
    for kernels in (False, True) if careful else (True,):
        for kind, executor in workers.items():
            # A few tasks for each worker, however small the grid.
            chunk = 1 if not kernels else max(1, min(125, side**2 // 8))
            label = f"{'kernels' if kernels else 'no kernels'}, {kind}"
            ways[label] = partial(sweep, kernels=kernels, executor=executor, chunk=chunk)
    return ways


def point_ways(side: int, workers: dict[str, Any], folder: Path) -> dict[str, Way]:
    """Sweep a function that takes no time: what a point costs by itself."""
    axes = {"a": np.arange(float(side)), "b": np.arange(float(side))}

    def journalled() -> stp.sweeps.Sweep:
        path = folder / "journal"
        path.unlink(missing_ok=True)
        return stp.sweep(product, axes, journal=path)

    return {
        "here": partial(stp.sweep, product, axes),
        "here, with a journal": journalled,
        "2 processes, chunk=100": partial(
            stp.sweep, product, axes, chunk=100, executor=workers["2 processes"]
        ),
    }


def measure(title: str, ways: dict[str, Way], count: int, unit: str, rounds: int) -> None:
    """Check, time in turn, print."""
    first, *others = (way() for way in ways.values())
    for other in others:
        for name, values in first.results.items():
            assert np.abs(other[name] - values).max() <= 1e-10 * np.abs(values).max(), name
    times: dict[str, list[float]] = {label: [] for label in ways}
    for _ in range(rounds):
        for label, way in ways.items():
            begin = time.perf_counter()
            way()
            times[label].append((time.perf_counter() - begin) / count)
    base = next(iter(times.values()))
    print(f"{title:30s} {f'median [µs per {unit}]':>24} {'best':>9} {'times as fast':>14} {'of best':>8}")
    for label, values in times.items():
        ratio = median(b / x for b, x in zip(base, values, strict=True))
        of_best = min(base) / min(values)
        print(
            f"  {label:28s} {1e6 * median(values):>24.3f} {1e6 * min(values):>9.3f} {ratio:>14.2f} {of_best:>8.2f}"
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(2, context) as processes,
        ThreadPoolExecutor(2) as threads,
    ):
        workers = {"1 worker": None, "2 threads": threads, "2 processes": processes}
        for name, side, careful in (("stewart", 8, True), ("delta", 2, True), ("stewart", 50, False)):
            ways = demand_ways(name, side, careful, workers)
            states = side**2 * INSTANTS
            measure(f"{name}, {states} states", ways, states, "state", options.rounds)
        measure(
            "nothing, 40000 points", point_ways(200, workers, Path(folder)), 40_000, "point", options.rounds
        )


if __name__ == "__main__":
    main()
