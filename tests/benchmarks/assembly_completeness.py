"""Count how often `assembly_modes` misses a pose, and whether it says so.

Draws platforms and poses, asks for all poses of the lengths, and checks that the pose drawn is among them
and that the number of complex solutions is the known one of the class. Every portion that is done goes to a
file of JSON lines, and the next run goes on where the file ends; what another state of the package wrote
there is left alone. Run by hand::

    python -m tests.benchmarks.assembly_completeness --count 10000 --classes all
    python -m tests.benchmarks.assembly_completeness --count 10000 --classes all --show
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import stewart_pin as stp
from stewart_pin.analysis import assembly_modes as package
from tests.analysis.platforms import CLASSES, distance_to, draw

PORTION = 100


def outcome(name: str, seed: tuple[int, int], *, fixed: bool) -> Counter[str]:
    """Solve one random platform of a class; tell which of the countable things happened."""
    hexapod, position, rotation = draw(name, np.random.default_rng(seed))
    lengths = stp.leg_lengths(hexapod, position, rotation)
    modes = stp.AssemblySolver(hexapod).solve(lengths) if fixed else stp.assembly_modes(hexapod, lengths)
    assert isinstance(modes, stp.hexapods.AssemblyModes)
    # The pose returns to round-off times the condition of its Jacobian.
    size = 1.0 + np.abs(position).max()
    jacobian = stp.leg_jacobian(hexapod, position, rotation)
    hit = distance_to(modes, position, rotation) < 1e-12 * size * max(1e3, np.linalg.cond(jacobian))
    whole = hit and modes.n_complex == CLASSES[name][0]
    return Counter(
        {
            "count as known": int(modes.n_complex == CLASSES[name][0]),
            "pose found": int(hit),
            "complete": int(modes.complete),
            "miss reported": int(not whole and not modes.complete),
            "MISS UNREPORTED": int(not whole and modes.complete),
            "searched twice or more": int(modes.searches > 1),
            "real": len(modes),
            "certified": int(modes.certified.sum()),
        }
    )


def portion(name: str, seed: int, first: int, *, fixed: bool) -> dict[str, Any]:
    """Count the outcomes of `PORTION` platforms from number `first` on, and list the odd ones."""
    began, total, odd = time.perf_counter(), Counter[str](), {}
    for i in range(first, first + PORTION):
        one = outcome(name, (seed, i), fixed=fixed)
        total.update(one)
        if not (one["count as known"] and one["pose found"] and one["complete"]):
            odd[i] = one
    return {"outcomes": total, "odd": odd, "seconds": round(time.perf_counter() - began, 2)}


def state_of_package() -> str:
    """Give a short digest of the sources that the counts depend on."""
    files = sorted(Path(package.__file__).parent.glob("*.*"))
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def written(file: Path, key: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Read the portions of one class that this state of the package has written."""
    for line in file.read_text().splitlines() if file.exists() else ():
        row = json.loads(line)
        if key.items() <= row.items():
            yield row


def summary(rows: list[dict[str, Any]]) -> str:
    """Add up the portions of a class."""
    total = Counter[str]()
    for row in rows:
        total.update(row["outcomes"])
    seconds = sum(row["seconds"] for row in rows)
    odd = [int(i) for row in rows for i in row["odd"]]
    listed = ", ".join(f"{key} {value}" for key, value in total.items())
    return f"of {PORTION * len(rows)} ({seconds:.0f} s): {listed}; odd {sorted(odd)}"


def main() -> None:
    """Run the counts and print one line for each class."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="platforms of each class")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--classes", nargs="+", default=["general 6-6"], help="names, or all")
    parser.add_argument("--fixed", action="store_true", help="prepare each geometry by AssemblySolver")
    parser.add_argument("--file", type=Path, default=Path("output/assembly_completeness.jsonl"))
    parser.add_argument("--show", action="store_true", help="only print what the file holds")
    options = parser.parse_args()
    options.file.parent.mkdir(parents=True, exist_ok=True)
    state = state_of_package()
    names = list(CLASSES) if options.classes == ["all"] else options.classes
    keys = {n: {"class": n, "seed": options.seed, "fixed": options.fixed, "state": state} for n in names}
    rows = {name: list(written(options.file, key)) for name, key in keys.items()}
    # Class after class within each portion, so that an interrupted run has counted all alike.
    for first in () if options.show else range(0, options.count, PORTION):
        for name, key in keys.items():
            if first not in {row["first"] for row in rows[name]}:
                row = {**key, "first": first, **portion(name, options.seed, first, fixed=options.fixed)}
                rows[name].append(row)
                with options.file.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    for name in names:
        print(f"{name}: {summary(rows[name])}")


if __name__ == "__main__":
    main()
