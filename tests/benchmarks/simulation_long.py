"""A million steps of a six-legged platform: gap, energy and memory stay flat. Run by hand; about ten minutes.

``python -m tests.benchmarks.simulation_long [steps]``
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

import stewart_pin as stp


def main() -> None:
    """Run, and print a line after every tenth of the way."""
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    chain = stp.load("stewart")
    # No gravity and a soft spring on every leg: a conservative machine that stays about its home.
    chain.model.gravity.linear[:] = 0.0
    index_q, index_v = chain.motor_q_index, chain.motor_index
    home = stp.motor_positions(chain, chain.q_home)
    stiffness = 2000.0

    def springs(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return stiffness * (home - q[index_q])

    twist = np.array([0.1, -0.2, 0.15, 0.3, 0.2, -0.1])
    pose = stp.platform_pose(chain, chain.q_home)
    v = stp.platform_motion(chain, pose, twist, np.zeros(6)).v
    part, dt = steps // 10, 1e-3
    run = stp.simulate(chain, chain.q_home, v, springs, duration=dt, dt=dt)

    def total(run: stp.simulation.Simulation) -> float:
        stretch = run.q[-1][index_q] - home
        return float(run.energy[-1] + stiffness * stretch @ stretch / 2)

    begin = total(run)
    print(
        f"{'steps':>9} {'CPU us/step':>12} {'largest gap [m]':>16} {'energy change':>14} {'memory [MB]':>12}"
    )
    for k in range(10):
        start = time.process_time()
        run = stp.simulation.resume(
            chain, run.final_state, springs, duration=part * dt, record_rate=1 / (part * dt)
        ).or_raise()
        cost = (time.process_time() - start) / part * 1e6
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        change = (total(run) - begin) / begin
        print(f"{(k + 1) * part:>9} {cost:>12.0f} {run.largest_gap:>16.1e} {change:>14.1e} {memory:>12.1f}")
    print(f"leg1 speed at the end {abs(run.v[-1][index_v[0]]):.3f} m/s")


if __name__ == "__main__":
    main()
