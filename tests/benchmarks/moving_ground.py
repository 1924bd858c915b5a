"""Inverse dynamics of a six-legged platform on a ship beside one on firm ground. Run by hand; some seconds.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.moving_ground`` calls all in turn in one process, round after round, and
prints medians of the time for a state. Each is first checked against the verb of one state.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.kernels.hexapod_graph import sample_states

N, ROUNDS = 16384, 21


def main() -> None:
    """Measure and print."""
    chain, rng = stp.load("stewart"), np.random.default_rng(1)
    pose, twist, acceleration = sample_states(rng, N)
    moves = rng.normal(size=(N, 12))
    rows = np.hstack([np.array([pin.Quaternion(pin.exp3(x)).coeffs() for x in moves[:, :3]]), moves])
    ship = stp.dynamics.BaseMotion(pin.exp3(moves[0, :3]), moves[0, :6], moves[0, 6:])
    firm, afloat = (stp.compile_kernels(chain, base_motion=moving) for moving in (False, True))
    first = stp.platform_motion(chain, pin.XYZQUATToSE3(pose[0]), twist[0], acceleration[0])
    there = chain.at(first.q, first.v, first.a, base_motion=ship)
    calls: dict[str, tuple[int, Callable[[], np.ndarray]]] = {
        "kernels, firm ground": (N, lambda: firm.inverse_dynamics(pose, twist, acceleration)),
        "kernels, ship": (N, lambda: afloat.inverse_dynamics(pose, twist, acceleration, base_motion=rows)),
        "one state, ship": (
            1,
            lambda: stp.inverse_dynamics(chain.at(first.q, first.v, first.a, base_motion=ship)).tau_motor,
        ),
    }
    expected = stp.inverse_dynamics(there).tau_motor
    found = calls["kernels, ship"][1]()[0]
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()
    times: dict[str, list[float]] = {title: [] for title in calls}
    for _ in range(ROUNDS):
        for title, (count, call) in calls.items():
            begin = time.perf_counter()
            call()
            times[title].append((time.perf_counter() - begin) / count)
    for title, seconds in times.items():
        print(f"{title:22s} {1e6 * median(seconds):8.3f} µs a state")


if __name__ == "__main__":
    main()
