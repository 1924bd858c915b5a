"""Functions for sweeps, where worker processes find them."""

from __future__ import annotations

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache

import numpy as np
import pinocchio as pin

import stewart_pin as stp


def processes(workers: int) -> ProcessPoolExecutor:
    """Start workers afresh: a fork would copy the threads of other tests halfway through what they do."""
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("forkserver"))


def wave(a: float, b: float) -> dict[str, object]:
    """Answer with a number, an array and a matrix; sums of irrational numbers show the last bit."""
    return {"sum": np.sin(a) + np.cos(b), "vector": [a, b, a / 3 + b], "matrix": np.outer([a, 1], [b, 2, 3])}


def slow_wave(a: float, b: float) -> dict[str, object]:
    time.sleep(0.01)
    return wave(a, b)


def out_of_order(a: float, b: float) -> dict[str, object]:
    """Take the longer the earlier the point."""
    time.sleep(0.02 / (1 + 2 * a + b))
    return wave(a, b)


def unreachable_above_two(a: float) -> float:
    if a > 2:
        raise stp.errors.UnreachableError(
            f"{a:g} is too far", residual=1.0, iterations=3, q=np.zeros(2), violations={"leg": (a, 0.0, 2.0)}
        )
    return a


def broken_at_two(a: float) -> float:
    return 1 / (a - 2)


class HeavyError(Exception):
    """Cannot be built again from its arguments, as unpickling wants."""

    def __init__(self, one: int, *, other: int) -> None:
        super().__init__(f"{one} and {other}")


def heavy_at_two(a: float) -> float:
    if a == 2:
        raise HeavyError(1, other=2)
    return a


def deadly_at_two(a: float) -> float:
    """End the worker, as a machine does that is out of memory."""
    if a == 2:
        os._exit(1)
    return a


@lru_cache
def stewart() -> stp.ClosedChain:
    return stp.load("stewart")


def holding_forces(height: float, yaw: float) -> dict[str, object]:
    """Leg forces at rest."""
    chain = stewart()
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([0.0, 0.0, height]))
    q = stp.inverse_kinematics(chain, pose, limits=False).q
    return {"force": stp.inverse_dynamics(chain, q, np.zeros(chain.nv), np.zeros(chain.nv)).tau_motor}
