"""Large models: how long loading and counting freedoms take, beside the decompositions that a count cannot do without.

``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m tests.benchmarks.large_models`` puts mechanisms of many loops
together and prints medians in seconds: `load` of a written file, and `mobility` of a chain that knows nothing of itself
yet, with its motors, with none and with every joint a motor; interleaved with these one singular value decomposition of
all loop rows at each of its samples.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import stewart_pin as stp
from tests.large_mechanisms import joined, scissors

ROUNDS = 3
CASES: dict[str, Callable[[], stp.ClosedChain]] = {
    "52 four-bars side by side": lambda: joined(["four_bar"] * 52),
    "6 hexapods, each on the next": lambda: joined(["stewart"] * 6, stacked=True),
    "50 scissors, each on the next": lambda: scissors(50),
    "78 scissors, each on the next": lambda: scissors(78),
    "13 hexapods side by side": lambda: joined(["stewart"] * 13),
    "14 hexapods, each on the next": lambda: joined(["stewart"] * 14, stacked=True),
}


def plain(rows: list[np.ndarray]) -> None:
    """Decompose the loop rows of each sample once."""
    for sample in rows:
        np.linalg.svd(sample)


def timed(call: Callable[[], object]) -> float:
    """Seconds of one call."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def main() -> None:
    """Print the table."""
    print(f"{'':30s} {'nv':>4s} {'plain':>7s} {'load':>7s} {'mobility':>9s} {'no motors':>10s} {'all':>7s}")
    with tempfile.TemporaryDirectory() as folder:
        for name, make in CASES.items():
            chain, path = make(), Path(folder) / "model.urdf"
            stp.write_urdf(chain, path)
            joints = tuple(joint.name for joint in chain.mechanism.joints if joint.has_axis)
            rows = [np.array(chain.at(q).rows) for q in chain.generic.samples]
            rounds = []
            for _ in range(ROUNDS):
                fresh = [stp.load(path, motors=motors) for motors in (None, (), joints)]
                calls: list[Callable[[], object]] = [partial(plain, rows), partial(stp.load, path)]
                calls += [partial(stp.mobility, chain) for chain in fresh]
                rounds.append([timed(call) for call in calls])
            plainly, load, own, none, every = (statistics.median(c) for c in zip(*rounds, strict=True))
            print(
                f"{name:30s} {chain.nv:4d} {plainly:7.2f} {load:7.2f} {own:9.2f} {none:10.2f} {every:7.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
