"""Time the intervals of S1.7: sign scans of f(θ), as the source does, against eigenvalues and transitions.

Run by hand: ``python -m tests.benchmarks.planar_modes``. The methods take turns in one process.

The source reports 26 s for intervals printed to two digits, on an unknown machine and with its own grids.
Its method is rebuilt here: for each length on a grid of 0.01 m, f is evaluated on a grid of angles and its
changes of sign are counted; once in plain Python, once as one NumPy array. Neither can see a pair of roots
between two angles, nor an end of an interval between two lengths.
"""

from __future__ import annotations

import math
from statistics import median
from time import perf_counter

import numpy as np

import stewart_pin as stp

ANGLES = 721
LENGTHS = np.round(np.arange(3.0, 10.0, 0.01), 2)
ROUNDS = 5


def scan_in_python() -> list[int]:
    """Count sign changes of f with two loops, formulas as printed."""
    l2, l3, gamma, x1, x2, y2, p1, p3 = 3 * math.sqrt(2), 3.0, math.pi / 4, 5.0, 0.0, 6.0, 5.0, 3.0
    counts = []
    for p2 in LENGTHS.tolist():
        before, count = None, 0
        for n in range(ANGLES):
            theta = -math.pi + 2 * math.pi * n / (ANGLES - 1)
            a2, b2 = l3 * math.cos(theta) - x1, l3 * math.sin(theta)
            a3, b3 = l2 * math.cos(theta + gamma) - x2, l2 * math.sin(theta + gamma) - y2
            right2, right3 = p2**2 - p1**2 - a2**2 - b2**2, p3**2 - p1**2 - a3**2 - b3**2
            n1, n2, d = b3 * right2 - b2 * right3, -a3 * right2 + a2 * right3, 2 * (a2 * b3 - b2 * a3)
            positive = n1**2 + n2**2 - p1**2 * d**2 > 0
            count += before is not None and positive != before
            before = positive
        counts.append(count)
    return counts


def scan_in_numpy() -> list[int]:
    """Count sign changes of f on the whole grid at once."""
    l2, l3, gamma, x1, x2, y2, p1, p3 = 3 * np.sqrt(2), 3.0, np.pi / 4, 5.0, 0.0, 6.0, 5.0, 3.0
    theta, p2 = np.linspace(-np.pi, np.pi, ANGLES), LENGTHS[:, None]
    a2, b2 = l3 * np.cos(theta) - x1, l3 * np.sin(theta)
    a3, b3 = l2 * np.cos(theta + gamma) - x2, l2 * np.sin(theta + gamma) - y2
    right2, right3 = p2**2 - p1**2 - a2**2 - b2**2, p3**2 - p1**2 - a3**2 - b3**2
    n1, n2, d = b3 * right2 - b2 * right3, -a3 * right2 + a2 * right3, 2 * (a2 * b3 - b2 * a3)
    return np.diff(n1**2 + n2**2 - p1**2 * d**2 > 0, axis=1).sum(axis=1).tolist()


def modes_on_the_grid(planar: stp.PlanarRPR) -> list[int]:
    """Find all poses for each length, to round-off."""
    lengths = np.column_stack([np.full_like(LENGTHS, 5.0), LENGTHS, np.full_like(LENGTHS, 3.0)])
    return stp.planar.planar_assembly_modes_batch(planar, lengths).count.tolist()


def transitions(planar: stp.PlanarRPR) -> list[int]:
    """Find the ends of the intervals, to round-off, and the counts between them."""
    found = stp.planar.planar_transition_lengths(planar, [5.0, 0.0, 3.0], 1)
    return found.counts[np.searchsorted(found.lengths, LENGTHS)].tolist()


def main() -> None:
    """Print median times, ratios, and how many counts of the grid each method gets wrong."""
    planar = stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)
    methods = {
        "sign scan, plain Python": scan_in_python,
        "sign scan, NumPy": scan_in_numpy,
        "all poses on the grid (ours)": lambda: modes_on_the_grid(planar),
        "transition lengths (ours)": lambda: transitions(planar),
    }
    times: dict[str, list[float]] = {name: [] for name in methods}
    counts: dict[str, list[int]] = {}
    for _ in range(ROUNDS):
        for name, method in methods.items():
            start = perf_counter()
            counts[name] = method()
            times[name].append(perf_counter() - start)
    exact = counts["transition lengths (ours)"]
    slowest = median(times["sign scan, plain Python"])
    print(f"{len(LENGTHS)} lengths, {ANGLES} angles, median of {ROUNDS}")
    for name, measured in times.items():
        wrong = sum(a != b for a, b in zip(counts[name], exact, strict=True))
        print(
            f"{name:30s} {1e3 * median(measured):10.2f} ms   {slowest / median(measured):8.1f} x   "
            f"{wrong} counts differ"
        )


if __name__ == "__main__":
    main()
