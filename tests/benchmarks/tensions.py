"""Tensions of eight cables within limits: one state, many states, and along a motion. Run by hand; a minute.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.tensions`` calls all in turn in one process, round after round; medians,
and the ratio to the first line of each group. Peers are given what they start from, wrench and columns of each state;
ours computes these from pose, twist and acceleration as well. Each answer is first checked against an independent one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin
import proxsuite
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import linprog

import stewart_pin as stp
from stewart_pin.compiled import StateStatus
from stewart_pin.errors import EffortLimitError
from stewart_pin.mechanics.sharing import Sharer, Sharing
from tests.cable_robots import cables_8
from tests.pulled import boxed

STATES = 256
MANY = 16384


class Proxsuite:
    """A dense quadratic programme in the tensions, as one would write it: min |f - goal|² with A f = w and limits."""

    def __init__(self, bounds: np.ndarray, goal: np.ndarray, *, warm: bool) -> None:
        self.low, self.high, self.goal = *bounds.T.copy(), goal
        self.qp = proxsuite.proxqp.dense.QP(8, 6, 8)
        self.qp.settings.eps_abs = 1e-9
        guess = proxsuite.proxqp.InitialGuess
        if warm:
            self.qp.settings.initial_guess = guess.WARM_START_WITH_PREVIOUS_RESULT
        self.begun = False

    def __call__(self, A: np.ndarray, w: np.ndarray) -> np.ndarray:
        if self.begun:
            self.qp.update(A=A, b=w)
        else:
            self.qp.init(np.eye(8), -self.goal, A, w, np.eye(8), self.low, self.high)
            self.begun = True
        self.qp.solve()
        return self.qp.results.x


def quadprog_like(A: np.ndarray, w: np.ndarray, bounds: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Exchange limits in NumPy, on the normal equations of the free tensions, as small dense solvers do."""
    low, high = np.zeros(8, dtype=bool), np.zeros(8, dtype=bool)
    for _ in range(50):
        free = ~(low | high)
        f = np.where(low, bounds[:, 0], np.where(high, bounds[:, 1], goal))
        square = A[:, free] @ A[:, free].T
        try:
            y = cho_solve(cho_factor(square), w - A @ f, check_finite=False)
        except np.linalg.LinAlgError:  # too many limits at once
            break
        f[free] += A[:, free].T @ y
        push = goal - f + A.T @ y
        keep_low, keep_high = low & (push < 0), high & (push > 0)
        passed_low, passed_high = f < bounds[:, 0] - 1e-9, f > bounds[:, 1] + 1e-9
        if not (passed_low | passed_high).any() and (keep_low == low).all() and (keep_high == high).all():
            return f
        low, high = keep_low | passed_low, keep_high | passed_high
    return np.full(8, np.nan)


def timed(calls: dict[str, Callable[[], Any]], counts: dict[str, int], rounds: int) -> None:
    """Print medians per state, and the median of the ratios within rounds."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            times[name].append((time.perf_counter() - begin) / counts[name])
    first = next(iter(calls))
    for name, spent in times.items():
        ratio = median(a / b for a, b in zip(spent, times[first], strict=True))
        print(f"  {name:<58}{median(spent) * 1e6:>10.3f} us  {ratio:>9.2f}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument(
        "--legs", action="store_true", help="eight massless legs that pull, in place of cables"
    )
    options = parser.parse_args()
    chain = boxed() if options.legs else cables_8()
    limits = chain.limits
    bounds = limits.bounds("effort", chain.motor_index)
    rng = np.random.default_rng(1)
    pose = np.tile(pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home)), (MANY, 1))
    pose[:, :3] += 0.03 * chain.length_scale * rng.uniform(-1, 1, (MANY, 3))
    twist, acceleration = 0.3 * rng.normal(size=(MANY, 6)), 2 * rng.normal(size=(MANY, 6))
    kernels = stp.compile_kernels(chain)
    status = np.empty(MANY, dtype=np.int8)
    goals: dict[Sharing, np.ndarray] = {"least_norm": np.zeros(8), "mid_range": bounds.mean(axis=1)}
    least, jacobian = kernels.inverse_dynamics(pose, twist, acceleration), kernels.motor_jacobian(pose)
    natural = chain.tangent_scale[chain.motor_index]
    for sharing, goal in goals.items():
        kernels.inverse_dynamics(
            pose, twist, acceleration, effort_limit=limits, sharing=sharing, status=status
        )
        good = np.flatnonzero(status == StateStatus.OK)
        some = good[:STATES]
        print(f"{chain.name}, {sharing}: {len(good)} of {MANY} states have tensions within the limits")
        # Lengths in robot sizes, so that the equations of the peers are of one size.
        scale = np.repeat([1.0, 1 / chain.length_scale], 3)
        columns = [scale[:, None] * jacobian[k].T for k in some]
        wrenches = [A @ least[k] for A, k in zip(columns, some, strict=True)]
        ours = kernels.inverse_dynamics(
            pose[some], twist[some], acceleration[some], effort_limit=limits, sharing=sharing
        )
        single = kernels.single_state("inverse_dynamics", effort_limit=limits, sharing=sharing)
        cold, warm = (Proxsuite(bounds, goal, warm=flag) for flag in (False, True))
        worst, unsolved = 0.0, 0
        for k, (A, w) in enumerate(zip(columns, wrenches, strict=True)):
            found = warm(A, w)
            if warm.qp.results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED:
                worst = max(worst, float(np.abs(found - ours[k]).max() / np.abs(ours[k]).max()))
            else:
                unsolved += 1
            other = quadprog_like(A, w, bounds, goal)
            assert np.isnan(other).any() or np.abs(other - ours[k]).max() < 1e-8 * np.abs(ours[k]).max()
        print(
            f"  off from proxsuite, stopped at 1e-9: {worst:.2g}; unsolved by it: {unsolved} of {len(some)}"
        )
        pairs = list(zip(columns, wrenches, strict=True))
        solver = Sharer(chain, bounds, sharing)
        calls: dict[str, Callable[[], Any]] = {
            "kernels, one state from pose and motion": lambda one=single, some=some: [
                one(pose[k], twist[k], acceleration[k]) for k in some
            ],
            "kernels, all states at once": lambda sharing=sharing: kernels.inverse_dynamics(
                pose, twist, acceleration, effort_limit=limits, sharing=sharing, status=status
            ),
            "kernels, least norm whatever the limits": lambda: kernels.inverse_dynamics(
                pose, twist, acceleration
            ),
            "solver of the verb of one state, from wrench and columns": lambda solver=solver, pairs=pairs: [
                solver.efforts(A / natural, w, 6) for A, w in pairs
            ],
            "proxsuite, cold": lambda cold=cold, pairs=pairs: [cold(A, w) for A, w in pairs],
            "proxsuite, warm": lambda warm=warm, pairs=pairs: [warm(A, w) for A, w in pairs],
            "exchanges in NumPy": lambda pairs=pairs, goal=goal: [
                quadprog_like(A, w, bounds, goal) for A, w in pairs
            ],
            "linprog of SciPy, least sum": lambda pairs=pairs: [
                linprog(np.ones(8), A_eq=A, b_eq=w, bounds=bounds.tolist(), method="highs-ds")
                for A, w in pairs[:32]
            ],
        }
        counts = dict.fromkeys(calls, len(some))
        counts["kernels, all states at once"] = counts["kernels, least norm whatever the limits"] = MANY
        counts["linprog of SciPy, least sum"] = 32
        timed(calls, counts, options.rounds)
    along_a_motion(chain, options.rounds)


def along_a_motion(chain: stp.ClosedChain, rounds: int) -> None:
    """Compare a sharer that remembers the limits that held with one that begins anew at every instant."""
    samples = stp.motions.sinusoidal_motion(
        np.linspace(0, 1, 200),
        home=stp.platform_pose(chain, chain.q_home),
        amplitude=(0.02 * chain.length_scale * np.ones(3)).tolist(),
        frequency=[1.0, 1.0, 1.0],
    )
    motion = samples.twist, samples.acceleration
    states = [stp.platform_motion(chain, samples.pose(k), *(x[k] for x in motion)) for k in range(200)]
    limits = chain.limits.bounds("effort", chain.motor_index)
    loads = []
    for state in states:
        share = state.freedom.motions[chain.motor_index].T / chain.tangent_scale[chain.motor_index]
        loads.append((share, state.freedom.motions.T @ state.tree_efforts(state.require_accelerating())))
    for sharing in ("least_norm", "least_peak", "mid_range"):
        print(f"{chain.name}, 200 instants of a motion, {sharing}; without kinematics")

        def warm(sharing: Any = sharing) -> None:
            solver = Sharer(chain, limits, sharing)
            for share, load in loads:
                solver.efforts(share, load, 6)

        def cold(sharing: Any = sharing) -> None:
            for share, load in loads:
                Sharer(chain, limits, sharing).efforts(share, load, 6)

        try:
            warm()
        except EffortLimitError as error:
            print(f"  {error}")
            continue
        calls = {"limits of the instant before": warm, "anew": cold}
        timed(calls, dict.fromkeys(calls, 200), rounds)


if __name__ == "__main__":
    main()
