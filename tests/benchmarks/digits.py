"""What files of few digits load as: every mechanism of the zoo in every format at 4 to 17 digits.

    python -m tests.benchmarks.digits [--formats urdf+ sdf ...] [--styles 4f 6f ...] [--only NAME ...]

For each file: right (freedoms at and around home, home and efforts as with exact numbers, to the accuracy of the
digits), refused (an error), or wrong.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any, cast

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.errors import StewartPinError, UnsupportedError
from tests.printed import half_unit, round_places, turned_frames
from tests.zoo.table import ZOO, Row, zoo_chain

SUFFIX = {"mjcf": ".xml", "sdf": ".sdf", "usd": ".usda"}
FORMATS = ("urdf+", "drake", "isaac", "gepetto", "mjcf", "sdf", "usd")
STYLES = ("4f", "5f", "6f", "7f", "9f", "12f", "17f")
HOME, EFFORT = 600.0, 600.0
"""How far an answer may be off per half unit: balls that stand close together as a hinge turn it by more than they are
off, and levers do the rest."""


def effort(chain: stp.ClosedChain) -> np.ndarray:
    rest = np.zeros(chain.nv)
    return stp.inverse_dynamics(chain, chain.q_home, rest, rest, throw=False).tau_motor


def judged(exact: stp.ClosedChain, path: Path, style: str) -> tuple[str, str]:
    """Load a printed file and compare it with the exact mechanism."""
    try:
        printed = stp.load(path, gravity=exact.gravity, motors=exact.motors or None, platform=exact.platform)
    except StewartPinError as error:
        return "refused", str(error)
    if printed.generic.count.dof != exact.generic.count.dof:
        return "wrong", f"{printed.generic.count.dof} freedoms, not {exact.generic.count.dof}"
    off = half_unit(style)
    poses = [stp.platform_pose(chain, chain.q_home) for chain in (exact, printed)]
    apart = np.abs(pin.log6(poses[0].actInv(poses[1])).vector / exact.twist_sizes).max()
    if apart > HOME * off + 1e-9:
        return "wrong", f"home is {apart:.1e} away"
    right = effort(exact)
    error = np.abs(effort(printed) - right).max(initial=0.0) / max(1.0, np.abs(right).max(initial=0.0))
    return ("right", "") if error <= EFFORT * off + 1e-9 else ("wrong", f"efforts are {error:.1e} off")


def by_balls(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Replace hinges by balls where that can be done; what has other loops is not written either."""
    try:
        return stp.build.loops_by_balls(chain)
    except UnsupportedError:
        return chain


def kind(row: Row) -> str:
    """Sort a mechanism by what its loops repeat."""
    if not row.excess:
        return "nothing repeated"
    return {3: "one planar or spherical loop", 1: "one row repeated"}.get(row.excess, "several rows or loops")


def main() -> None:
    """Print a table of formats, digits and kinds of loops."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--formats", nargs="*", default=FORMATS)
    parser.add_argument("--styles", nargs="*", default=STYLES)
    parser.add_argument("--only", nargs="*")
    wanted = parser.parse_args()
    rows = [row for row in ZOO if not wanted.only or row.name in wanted.only]
    counts: Counter[tuple[str, str, str, str]] = Counter()
    seconds: list[float] = []
    for row in rows:
        plain = turned_frames(zoo_chain(row.name), seed=3)
        for format in wanted.formats:
            exact = plain if format in ("urdf+", "sdf", "usd") else by_balls(plain)
            for style in wanted.styles:
                with tempfile.TemporaryDirectory() as folder:
                    path = Path(folder) / f"printed{SUFFIX.get(format, '.urdf')}"
                    try:
                        stp.export(exact, path, format=cast(Any, format))
                    except UnsupportedError:
                        counts[format, style, kind(row), "not written"] += 1
                        continue
                    for file in Path(folder).iterdir():
                        round_places(file, style)
                    begin = time.perf_counter()
                    verdict, why = judged(exact, path, style)
                    seconds.append(time.perf_counter() - begin)
                counts[format, style, kind(row), verdict] += 1
                if verdict != "right":
                    print(f"{verdict}: {row.name} in {format} at {style}: {why[-230:]}", flush=True)
    kinds = sorted({key[2] for key in counts})
    times = f"median {np.median(seconds):.2f} s, {max(seconds):.1f} s at most"
    print(f"\nright / refused / wrong; {len(seconds)} files, {times}")
    for loops in kinds:
        print(f"\n{loops:32s}" + "".join(f"{style:>14s}" for style in wanted.styles))
        for format in wanted.formats:
            cells = [
                " / ".join(
                    str(counts[format, style, loops, verdict]) for verdict in ("right", "refused", "wrong")
                )
                for style in wanted.styles
            ]
            print(f"{format:32s}" + "".join(f"{cell:>14s}" for cell in cells))


if __name__ == "__main__":
    main()
