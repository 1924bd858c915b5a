"""Print what each loop dialect of URDF can say, how long it takes to load, and how far the answers differ.

Run as ``python -m tests.benchmarks.loop_dialects``.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import LOOP_KINDS
from stewart_pin.model.formats.dialect import dialects
from tests.mechanisms import two_bodies

REPEATS = 5


def main() -> None:
    rows = [("dialect", "reads", "writes loops", "load stewart", "efforts differ")]
    with tempfile.TemporaryDirectory() as folder:
        for dialect in dialects():
            path = Path(folder) / f"{dialect.name}.urdf"
            tags = dict.fromkeys(f"<{tag.split('/')[1]}>" for tag in dialect.tags)
            reads = ", ".join([*tags, *dialect.suffixes]) or "names of frames"
            if dialect.write is None:
                rows.append((dialect.name, reads, "-", "-", "-"))
            else:
                rows.append(
                    (dialect.name, reads, written_kinds(dialect.name, path), *loaded(dialect.name, path))
                )
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def written_kinds(format: str, path: Path) -> str:
    """List the kinds of loops that a dialect writes."""
    kinds = []
    for kind in LOOP_KINDS:
        try:
            stp.export(two_bodies(kind, np.random.default_rng(1)), path, format=format)
        except UnsupportedError:
            continue
        kinds.append(str(kind))
    return "all" if len(kinds) == len(LOOP_KINDS) else ", ".join(kinds)


def loaded(format: str, path: Path) -> tuple[str, str]:
    """Write the Stewart platform, time reading it, and compare the motor efforts of one state."""
    chain = stp.load("stewart")
    stp.export(chain, path, format=format)
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        again = stp.load(path)
        times.append(time.perf_counter() - start)
    zero = np.zeros(chain.nv)
    ours, theirs = (stp.inverse_dynamics(c, c.q_home, zero, zero).tau_motor for c in (chain, again))
    return f"{1e3 * min(times):.0f} ms", f"{np.abs(ours - theirs).max() / np.abs(ours).max():.1e}"


if __name__ == "__main__":
    main()
