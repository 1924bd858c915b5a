"""How long loading takes: every bundled robot in every format, with all digits and with few.

    python -m tests.benchmarks.load_times [--formats urdf+ ...] [--styles full 4f ...] [--only NAME ...] [--rounds 3]

Medians in seconds of the processor. With few digits the frames of the robot are turned first, so that every number has
digits, and loops close only to these; what is refused has an exclamation mark. Then come the files of Cassie, where
`example-robot-data` is installed, and a tripod with cones at its balls that no home meets.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import StewartPinError, UnsupportedError
from tests.benchmarks.digits import FORMATS, SUFFIX, by_balls
from tests.building import cassie
from tests.building.test_home_within_limits import tripod
from tests.printed import round_places, turned_frames

STYLES = ("full", "4f", "6f", "9f")


def timed(call: Callable[[], object], rounds: int) -> str:
    """Tell the median of some calls, with a mark where they are refused."""
    seconds, mark = [], " "
    for _ in range(rounds):
        begin = time.process_time()
        try:
            call()
        except StewartPinError:
            mark = "!"
        seconds.append(time.process_time() - begin)
    return f"{statistics.median(seconds):.2f}{mark}"


def printed(chain: stp.ClosedChain, folder: Path, format: str, style: str) -> Path | None:
    """Write a chain with some digits, or return None where the format has no words for it."""
    path = folder / f"printed{SUFFIX.get(format, '.urdf')}"
    try:
        stp.export(chain, path, format=cast(Any, format))
    except UnsupportedError:
        return None
    if style != "full":
        for file in folder.iterdir():
            round_places(file, style)
    return path


def cell(exact: stp.ClosedChain, format: str, style: str, rounds: int) -> str:
    """Write a file and time its loading."""
    chain = exact if style == "full" else turned_frames(exact, seed=3)
    chain = chain if format in ("urdf+", "sdf", "usd") else by_balls(chain)
    with tempfile.TemporaryDirectory() as folder:
        path = printed(chain, Path(folder), format, style)
        if path is None:
            return "- "
        roles: dict[str, Any] = {"motors": exact.motors or None, "platform": exact.platform}
        return timed(lambda: stp.load(path, gravity=exact.gravity, **roles), rounds)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--formats", nargs="*", default=FORMATS)
    parser.add_argument("--styles", nargs="*", default=STYLES)
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--rounds", type=int, default=3)
    wanted = parser.parse_args()
    names = [name for name in stp.robots() if not wanted.only or name in wanted.only]
    for style in wanted.styles:
        print(
            f"\n{'all digits' if style == 'full' else style:24s}"
            + "".join(f"{f:>9s}" for f in wanted.formats)
        )
        for name in names:
            exact = stp.load(name)
            cells = [cell(exact, format, style, wanted.rounds) for format in wanted.formats]
            print(f"{name:24s}" + "".join(f"{text:>9s}" for text in cells), flush=True)
    others: dict[str, Callable[[], object]] = {}
    if (folder := cassie.folder()) is not None:
        for name in cassie.FILES:
            path = folder / "robots" / f"{name}.sdf"
            roles: dict[str, Any] = {"motors": cassie.motors(name), "platform": "pelvis"}
            others[f"{name}.sdf"] = partial(stp.load, path, **roles)
    tilted = tripod(swing=0.05, lean=-1.2)
    others["cones that no home meets"] = lambda: build_chain(tilted, motors=[])
    print()
    for name, call in others.items():
        if not wanted.only or name in wanted.only:
            print(f"{name:32s}{timed(call, wanted.rounds):>9s}", flush=True)


if __name__ == "__main__":
    main()
