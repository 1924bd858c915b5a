"""Count how often `assembly_modes` misses a pose, and whether it says so.

Draws platforms and poses, asks for all poses of the lengths, and checks that the pose drawn is among them
and that the number of complex solutions is the known one of the class. Run by hand::

    python -m tests.benchmarks.assembly_completeness --count 10000
    python -m tests.benchmarks.assembly_completeness --count 300 --classes all
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

import stewart_pin as stp
from tests.analysis.platforms import CLASSES, distance_to, draw


def check(name: str, count: int, seed: int, *, fixed: bool) -> Counter[str]:
    """Count the outcomes for random platforms of a class."""
    outcomes: Counter[str] = Counter()
    for i in range(count):
        hexapod, position, rotation = draw(name, np.random.default_rng([seed, i]))
        lengths = stp.leg_lengths(hexapod, position, rotation)
        modes = stp.AssemblySolver(hexapod).solve(lengths) if fixed else stp.assembly_modes(hexapod, lengths)
        assert isinstance(modes, stp.AssemblyModes)
        # The pose returns to round-off times the condition of its Jacobian.
        size = 1.0 + np.abs(position).max()
        jacobian = stp.leg_jacobian(hexapod, position, rotation)
        hit = distance_to(modes, position, rotation) < 1e-12 * size * max(1e3, np.linalg.cond(jacobian))
        whole = hit and modes.n_complex == CLASSES[name][0]
        outcomes["pose found"] += hit
        outcomes["count as known"] += modes.n_complex == CLASSES[name][0]
        outcomes["complete"] += modes.complete
        outcomes["searched twice or more"] += modes.searches > 1
        outcomes["real"] += len(modes)
        outcomes["certified"] += int(modes.certified.sum())
        outcomes["MISS REPORTED"] += not whole and not modes.complete
        if not whole and modes.complete:
            outcomes["MISS UNREPORTED"] += 1
            print(f"  unreported: class {name!r}, seed {[seed, i]}, pose {hit}, count {modes.n_complex}")
    return outcomes


def main() -> None:
    """Run the counts and print one line for each class."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--classes", nargs="+", default=["general 6-6"], help="names, or all")
    parser.add_argument("--fixed", action="store_true", help="prepare each geometry by AssemblySolver")
    options = parser.parse_args()
    names = list(CLASSES) if options.classes == ["all"] else options.classes
    for name in names:
        began = time.perf_counter()
        outcomes = check(name, options.count, options.seed, fixed=options.fixed)
        listed = ", ".join(f"{key} {value}" for key, value in outcomes.items())
        print(f"{name} ({time.perf_counter() - began:.0f} s): of {options.count}: {listed}", flush=True)


if __name__ == "__main__":
    main()
