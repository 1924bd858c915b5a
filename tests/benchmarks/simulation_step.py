"""One simulated step without kernels: `simulate` beside a bare Runge-Kutta loop on Pinocchio. Run by hand; a minute.

``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m tests.benchmarks.simulation_step`` runs both interleaved, in one
process. The bare loop takes Pinocchio's own constrained dynamics four times a step, and closes the loops by the least
displacement; it records, judges and checks nothing. CPU time of runs of two lengths, their difference: a step alone.
"""

from __future__ import annotations

import time
from statistics import median

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.benchmarks.states import Bare

DT, SHORT, LONG, ROUNDS = 1e-3, 20, 220, 15


def bare_run(bare: Bare, q: np.ndarray, v: np.ndarray, efforts: np.ndarray, steps: int) -> np.ndarray:
    """Step as a user of Pinocchio writes it."""
    model, h = bare.model, DT

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array(bare.forward_dynamics(q, v, efforts))

    for _ in range(steps):
        a1 = acceleration(q, v)
        v2 = v + h / 2 * a1
        a2 = acceleration(pin.integrate(model, q, h / 2 * v), v2)
        v3 = v + h / 2 * a2
        a3 = acceleration(pin.integrate(model, q, h / 2 * v2), v3)
        v4 = v + h * a3
        a4 = acceleration(pin.integrate(model, q, h * v3), v4)
        q = pin.integrate(model, q, h / 6 * (v + 2 * (v2 + v3) + v4))
        v = v + h / 6 * (a1 + 2 * (a2 + a3) + a4)
        jacobian = bare.loops(q)
        gap = np.concatenate([data.c1Mc2.translation for data in bare.datas])
        back = (
            np.linalg.pinv(jacobian)
            if len(gap) > model.nv
            else jacobian.T @ np.linalg.inv(jacobian @ jacobian.T)
        )
        q, v = pin.integrate(model, q, -back @ gap), v - back @ (jacobian @ v)
    return q


def main() -> None:
    """Measure and print."""
    chain = stp.load("stewart")
    bare = Bare(chain)
    q, v = chain.q_home, np.zeros(chain.nv)
    efforts = 1.01 * stp.inverse_dynamics(chain, q, v, v).tau_motor

    def ours(steps: int) -> np.ndarray:
        run = stp.simulate(chain, q, v, lambda t, q, v: efforts, duration=steps * DT, dt=DT, kernels=False)
        return run.or_raise().q[-1]

    runs = {"bare": lambda steps: bare_run(bare, q, v, efforts, steps), "simulate": ours}
    apart = np.abs(runs["bare"](LONG) - runs["simulate"](LONG)).max()
    costs: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            begin = time.process_time()
            run(SHORT)
            between = time.process_time()
            run(LONG)
            spent = (time.process_time() - between) - (between - begin)
            costs[name].append(spent / (LONG - SHORT) * 1e6)
    ratio = median(o / b for o, b in zip(costs["simulate"], costs["bare"], strict=True))
    of_bare, of_verb = (median(costs[name]) for name in ("bare", "simulate"))
    print(
        f"stewart, one step of {DT:g} s: bare {of_bare:.0f} µs, simulate {of_verb:.0f} µs, ratio {ratio:.2f};"
    )
    print(f"the ends of {LONG} steps are {apart:.1e} apart")


if __name__ == "__main__":
    main()
