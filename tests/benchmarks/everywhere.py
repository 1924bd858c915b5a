"""What becomes of kernels at random regular states of every bundled robot and every mechanism of the zoo. Run by hand.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.everywhere``: 1e5 states of each in all its coordinates; an hour or two.
``--states`` draws fewer, names choose robots. See `tests.kernels.everywhere` for how states are drawn and judged. What
is done stands in a journal, a line for each mechanism; called again, the same run goes on from there and prints all.

``other`` are states that lie on another branch than that of home, where kernels agree with the verbs of one state on
that of home. There must be no ``bold`` (answers where these find no way from home), no ``missing`` (regular, but
refused) and no ``wrong``; all three are counted among states that the verbs of one state have judged.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

import stewart_pin as stp
from tests.kernels.everywhere import COORDINATES, Mechanism, examine
from tests.zoo.table import ROBOTS, ZOO

COUNTS = ("states", "answered", "other", "refused", "bold", "missing", "wrong")
WIDTHS = (8, 10, 7, 9, 6, 9, 7)
Rows = dict[str, dict[str, float] | None]
"""By coordinates; None where the mechanism does not admit them."""


def measured(name: str, states: int, judged: int) -> Rows:
    """Examine a mechanism in all its coordinates."""
    rng, mechanism, rows = np.random.default_rng(1), Mechanism(name), Rows()
    drawn = mechanism.draw(states, rng)
    idle = bool(mechanism.chain.generic.count.idle)
    still = mechanism.draw(states, rng, moving=False) if idle else drawn
    for coordinates in COORDINATES:
        begin = time.process_time()
        found = examine(mechanism, coordinates, drawn if coordinates == "tree" else still, rng, judged)
        if found is None:
            rows[coordinates] = None
            continue
        row: dict[str, float] = {count: getattr(found, count) for count in COUNTS}
        rows[coordinates] = row | {
            "worst": found.worst,
            "undone": found.undone,
            "seconds": time.process_time() - begin,
        }
    return rows


def show(name: str, rows: Rows) -> None:
    """Print the lines of a mechanism."""
    for coordinates, row in rows.items():
        head = f"{name} {coordinates}"
        if row is None:
            print(f"{head:36s} not admitted", flush=True)
            continue
        counts = "".join(f"{int(row[c]):{w}d}" for c, w in zip(COUNTS, WIDTHS, strict=True))
        print(f"{head:36s}{counts}{row['worst']:9.1g}{row['undone']:9.1g}{row['seconds']:10.1f}", flush=True)


def main() -> None:
    """Measure what the journal does not have, and print all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="robots and mechanisms; default: all")
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument(
        "--judged", type=int, default=200, help="states of each kind before the verbs of one state"
    )
    parser.add_argument("--journal", type=Path, default=Path("output/everywhere.jsonl"), help="what is done")
    chosen = parser.parse_args()
    chosen.journal.parent.mkdir(parents=True, exist_ok=True)
    done: dict[str, Rows] = {}
    wanted = {"states": chosen.states, "judged": chosen.judged, "version": stp.__version__}
    if chosen.journal.exists():
        for line in chosen.journal.read_text().splitlines():
            entry = json.loads(line)
            if entry["run"] == wanted:
                done[entry["name"]] = entry["rows"]
    heads = "".join(f"{count:>{width}s}" for count, width in zip(COUNTS, WIDTHS, strict=True))
    print(f"{'':36s}{heads}{'worst':>9s}{'undone':>9s}{'time [s]':>10s}")
    for name in chosen.names or [*ROBOTS, *(row.name for row in ZOO)]:
        if name not in done:
            done[name] = measured(name, chosen.states, chosen.judged)
            with chosen.journal.open("a") as journal:
                journal.write(json.dumps({"name": name, "run": wanted, "rows": done[name]}) + "\n")
        show(name, done[name])


if __name__ == "__main__":
    main()
