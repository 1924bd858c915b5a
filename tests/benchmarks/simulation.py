"""Cost of a simulated second, against MuJoCo, at equal accuracy of the platform's path. Run by hand; one minute.

``python -m tests.benchmarks.simulation``. Both move the same six-legged platform under the same constant motor efforts
from the same state; the reference is DOP853 in independent coordinates. CPU time, one thread, runs interleaved.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median

import mujoco
import numpy as np

import stewart_pin as stp
from tests.oracles.test_mujoco import compiled
from tests.oracles.test_mujoco_simulation import EFFORTS, TWIST

DURATION, ROUNDS = 0.2, 5
INTEGRATORS = {"Euler": mujoco.mjtIntegrator.mjINT_EULER, "RK4": mujoco.mjtIntegrator.mjINT_RK4}


def main() -> None:
    """Measure and print."""
    chain = stp.load("stewart")
    state = stp.platform_motion(chain, stp.platform_pose(chain, chain.q_home), TWIST, np.zeros(6))

    def push(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return EFFORTS

    def ours(dt: float, **options) -> np.ndarray:
        run = stp.simulate(
            chain, state.q, state.v, push, duration=DURATION, dt=dt, record_rate=1 / DURATION, **options
        )
        return run.or_raise().platform.position[-1]

    with tempfile.TemporaryDirectory() as folder:
        engine = compiled(chain, Path(folder))
    model, data = engine.model, engine.data
    body = model.body(chain.platform).id
    motors = [int(model.joint(name).dofadr[0]) for name in chain.motors]

    def theirs(integrator: str, dt: float) -> np.ndarray:
        model.opt.timestep, model.opt.integrator = dt, int(INTEGRATORS[integrator])
        mujoco.mj_resetData(model, data)
        engine.set(state.q, state.v)
        data.qfrc_applied[motors] = EFFORTS
        for _ in range(round(DURATION / dt)):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        return data.xpos[body].copy()

    reference = ours(DURATION, method="DOP853", rtol=1e-12, atol=1e-12)
    cases = {f"ours, dt {dt:g} s": (lambda dt=dt: ours(dt)) for dt in (4e-2, 2e-2, 1e-2, 1e-3)}
    for name, steps in (("Euler", (2e-3, 1e-3, 1e-4)), ("RK4", (1e-2, 5e-3, 1e-3))):
        cases |= {f"MuJoCo {name}, dt {dt:g} s": (lambda name=name, dt=dt: theirs(name, dt)) for dt in steps}
    costs: dict[str, list[float]] = {name: [] for name in cases}
    error: dict[str, float] = {}
    for _ in range(ROUNDS):
        for name, case in cases.items():
            start = time.process_time()
            there = case()
            costs[name].append((time.process_time() - start) / DURATION)
            error[name] = float(np.linalg.norm(there - reference))
    print(f"{'':28s} {'path error [m]':>15} {'CPU s per simulated s':>23}")
    for name, values in costs.items():
        print(f"{name:28s} {error[name]:>15.1e} {median(values):>23.4f}")


if __name__ == "__main__":
    main()
