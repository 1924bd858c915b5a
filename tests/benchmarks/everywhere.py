"""What becomes of kernels at random regular states of every bundled robot and every mechanism of the zoo. Run by hand.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.everywhere``: 1e5 states of each in all its coordinates; an hour or two.
``--states`` draws fewer, names choose robots. See `tests.kernels.everywhere` for how states are drawn and judged.

``other`` are states that lie on another branch than that of home, where kernels agree with the verbs of one state on
that of home; ``bold`` are answers where these find no way from home. Neither ``missing`` (regular, but refused) nor
``wrong`` may be; both are counted among states that the verbs of one state have judged.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import stewart_pin as stp
from tests.kernels.everywhere import COORDINATES, Mechanism, examine
from tests.zoo.table import ZOO

HEAD = f"{'':36s}{'states':>8s}{'answered':>10s}{'other':>7s}{'refused':>9s}{'bold':>6s}{'missing':>9s}{'wrong':>7s}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="robots and mechanisms; default: all")
    parser.add_argument("--states", type=int, default=100_000)
    parser.add_argument(
        "--judged", type=int, default=200, help="states of each kind before the verbs of one state"
    )
    chosen = parser.parse_args()
    print(f"{HEAD}{'worst':>9s}{'undone':>9s}{'time [s]':>10s}")
    for name in chosen.names or [*stp.robots(), *(row.name for row in ZOO)]:
        rng, mechanism = np.random.default_rng(1), Mechanism(name)
        states = mechanism.draw(chosen.states, rng)
        idle = bool(mechanism.chain.generic.count.idle)
        still = mechanism.draw(chosen.states, rng, moving=False) if idle else states
        for coordinates in COORDINATES:
            begin = time.process_time()
            drawn = states if coordinates == "tree" else still
            found = examine(mechanism, coordinates, drawn, rng, chosen.judged)
            row = f"{name} {coordinates}"
            if found is None:
                print(f"{row:36s} not admitted", flush=True)
                continue
            counts = (found.other, found.refused, found.bold, found.missing, found.wrong)
            print(
                f"{row:36s}{found.states:8d}{found.answered:10d}"
                + "".join(f"{n:{w}d}" for n, w in zip(counts, (7, 9, 6, 9, 7), strict=True))
                + f"{found.worst:9.1g}{found.undone:9.1g}{time.process_time() - begin:10.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
