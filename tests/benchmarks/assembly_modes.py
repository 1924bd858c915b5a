"""Time `assembly_modes` against multi-start Newton at equal completeness.

The peer runs a vectorised Newton iteration from random poses. From the share of starts that end in each known
pose follows how many starts find the rarest one with a probability of 99.95 %, the completeness asked of the
homotopy; the peer is charged the time of that many. (It cannot know that number by itself, and never knows
that it is done.) All run interleaved in one process; times are those of the one thread. Run by hand::

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m tests.benchmarks.assembly_modes
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from tests.analysis.platforms import draw

STARTS = 512
MISSES = 5e-4


def hits_of_newton(
    hexapod: stp.Hexapod, lengths: np.ndarray, known: stp.hexapods.AssemblyModes, rng: np.random.Generator
) -> np.ndarray:
    """Search from random poses; count the starts that end in each known pose."""
    size = lengths.mean()
    position = rng.normal(size=(STARTS, 3)) * size
    rotation = Rotation.random(STARTS, random_state=rng).as_matrix()
    for _ in range(25):
        gap = stp.leg_lengths(hexapod, position, rotation) - lengths
        jacobian = stp.leg_jacobian(hexapod, position, rotation)
        step = -np.linalg.solve(jacobian + 1e-14 * np.eye(6), gap[..., None])[..., 0]
        # Clamped as in `hexapod_pose`, or most starts are thrown far away.
        step *= np.minimum(1.0, 0.5 * size / (np.linalg.norm(step[:, :3], axis=1) + 1e-300))[:, None]
        step *= np.minimum(1.0, 0.7 / (np.linalg.norm(step[:, 3:], axis=1) + 1e-300))[:, None]
        position = position + step[:, :3]
        rotation = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ rotation
    gaps = np.abs(position[:, None] - known.position).max(axis=2)
    gaps += np.abs(rotation[:, None] - known.rotation).max(axis=(2, 3))
    return (gaps < 1e-6 * max(1.0, size)).sum(axis=0)


def starts_needed(hits: np.ndarray) -> float:
    """Give the number of starts that miss the rarest pose with the probability `MISSES`."""
    # A pose that was never hit counts as hit half a time: a bound in the peer's favour.
    share = min(max(hits.min(), 0.5) / STARTS, 0.999)
    return float(np.log(MISSES) / np.log1p(-share))


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    began = time.thread_time()
    result = call()
    return 1e3 * (time.thread_time() - began), result


def main() -> None:
    """Print medians over random geometries and the ratios to the first row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--classes", nargs="+", default=["general 6-6", "planar 6-6", "3-3"])
    options = parser.parse_args()
    for name in options.classes:
        rng = np.random.default_rng(5)
        hexapod, *pose = draw(name, rng)
        # Compile, or load the compiled kernel, before the clock starts.
        stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, *pose))
        times: dict[str, list[float]] = {}
        needed = []
        for _ in range(options.rounds):
            hexapod, *pose = draw(name, rng)
            lengths = stp.leg_lengths(hexapod, *pose)
            solvers = {engine: stp.AssemblySolver(hexapod, engine=engine) for engine in ("numba", "numpy")}
            known = solvers["numba"].solve(lengths)
            assert isinstance(known, stp.hexapods.AssemblyModes)
            milliseconds, hits = _timed(partial(hits_of_newton, hexapod, lengths, known, rng))
            needed.append(starts_needed(hits))
            times.setdefault("multi-start Newton", []).append(milliseconds * needed[-1] / STARTS)
            jobs: dict[str, Callable[[], object]] = {}
            for engine, solver in solvers.items():
                jobs[f"{engine}, arbitrary geometry"] = partial(
                    stp.assembly_modes, hexapod, lengths, engine=engine
                )
                jobs[f"{engine}, fixed geometry"] = partial(solver.solve, lengths)
            for job, call in jobs.items():
                times.setdefault(job, []).append(_timed(call)[0])
        print(f"{name}: {options.rounds} geometries; Newton needs {np.median(needed):.0f} starts (median)")
        peer = np.array(times["multi-start Newton"])
        for job, values in times.items():
            median, least, ratio = np.median(values), min(values), np.median(peer / np.array(values))
            print(f"  {job:28s} median {median:8.2f} ms, least {least:8.2f} ms, ratio {ratio:6.1f}")


if __name__ == "__main__":
    main()
