"""Print how far `close_loops` moves, over the distance to the nearest closed configuration, for the whole zoo.

Run by hand; median and worst over random displacements of home, by mechanism and by size of the displacement::

    python -m tests.benchmarks.nearest

The nearest configuration is sought by another way: Lagrange's conditions by successive projection in the tangent of the
displaced point, with the rank that the literature tells, from several starts (home, where `close_loops` ended, points
between and beside them). The nearest of what is found counts, so a ratio is never too small for lack of starts, and a
branch that `close_loops` missed shows as a large one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

import stewart_pin as stp
from tests.zoo.table import ZOO, Row, zoo_chain

SPREADS = (0.05, 0.15, 0.4)
COUNT = 30
_CLOSED = 1e-11


def projected(chain: stp.ClosedChain, q: np.ndarray, x: np.ndarray, rank: int) -> np.ndarray | None:
    """Refine a displacement of q, in natural units, to a stationary point of its length with the loops closed."""
    scale, damping = chain.tangent_scale, 1.0
    for _ in range(300):
        at = pin.integrate(chain.model, q, scale * x)
        slope = pin.dIntegrate(chain.model, q, scale * x)[1]
        rows = (stp.loop_jacobian(chain, at) @ slope) * scale / chain.row_sizes[:, None]
        gap = stp.loop_gap(chain, at) / chain.row_sizes
        u, s, vt = np.linalg.svd(rows)
        if s[rank - 1] < 1e-7 * s[0]:
            return None
        step = vt[:rank].T @ ((u[:, :rank].T @ (rows @ x - gap)) / s[:rank]) - x
        if np.linalg.norm(step) < 1e-12 and np.abs(gap).max(initial=0.0) < _CLOSED:
            return x
        # Where the loops bend more than the distance, full steps do not settle.
        damping = max(0.2, 0.98 * damping)
        x = x + damping * step
        if not np.abs(x).max() < 10:
            return None
    return x if np.linalg.norm(step) < 1e-6 and np.abs(gap).max() < _CLOSED else None


def _starts(
    chain: stp.ClosedChain, q: np.ndarray, ends: list[np.ndarray], rng: np.random.Generator
) -> Iterator[np.ndarray]:
    known = [pin.difference(chain.model, q, end) / chain.tangent_scale for end in ends]
    yield np.zeros(chain.nv)
    for x in known:
        yield x
        yield x / 2
        yield x + 0.3 * np.linalg.norm(x) * rng.normal(size=chain.nv) / np.sqrt(chain.nv)


def ratios(row: Row, spread: float, count: int = COUNT) -> tuple[np.ndarray, int, int]:
    """Ratios of distances; how often `close_loops` failed, and how often no other way found anything."""
    chain, rng = zoo_chain(row.name), np.random.default_rng(17)
    rank = chain.nv - row.mobility
    found, failed, unknown = [], 0, 0
    for _ in range(count):
        step = rng.uniform(-spread, spread, chain.nv)
        q = pin.integrate(chain.model, chain.q_home, chain.tangent_scale * step)
        closure = stp.close_loops(chain, q, throw=False)
        if not closure.success:
            failed += 1
            continue
        moved = np.linalg.norm(pin.difference(chain.model, q, closure.q) / chain.tangent_scale)
        # Rank zero: every configuration is closed.
        others = (
            [projected(chain, q, x, rank) for x in _starts(chain, q, [closure.q, chain.q_home], rng)]
            if rank
            else []
        )
        lengths = [np.linalg.norm(x) for x in others if x is not None]
        unknown += not lengths and rank > 0
        if lengths:
            found.append(moved / max(min(lengths), 1e-300))
    return np.array(found), failed, unknown


def main() -> None:
    """Print the table."""
    table = Table(
        "mechanism", *(f"{what} {spread:g}" for spread in SPREADS for what in ("median", "worst", "failed"))
    )
    everything: dict[float, list[np.ndarray]] = {spread: [] for spread in SPREADS}
    failures = dict.fromkeys(SPREADS, 0)
    for row in ZOO:
        cells = []
        for spread in SPREADS:
            found, failed, unknown = ratios(row, spread)
            everything[spread].append(found)
            failures[spread] += failed
            cells += (
                [
                    f"{np.median(found):.9f}",
                    f"{found.max():.4f}",
                    f"{failed}" + (f" ({unknown}?)" if unknown else ""),
                ]
                if found.size
                else ["-", "-", str(failed)]
            )
        table.add_row(row.name, *cells)
    total = []
    for spread in SPREADS:
        found = np.concatenate(everything[spread])
        total += [f"{np.median(found):.9f}", f"{found.max():.4f}", str(failures[spread])]
        below = float(np.mean(found < 1.01))
        print(f"displaced by {spread:g}: {found.size} cases, {below:.1%} within 1 % of the nearest")
    table.add_row("all", *total)
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
