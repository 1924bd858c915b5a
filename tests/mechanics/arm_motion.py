"""Simulation of arms with tight tolerances, for the tests that need an exact motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import stewart_pin as stp

START = np.deg2rad([0.0, -90.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Motion:
    time: np.ndarray
    q: np.ndarray
    v: np.ndarray


def source_torque(t: float) -> np.ndarray:
    """S2.2."""
    s, c = np.sin(t), np.cos(t)
    return 0.1 * np.array([s, 0.5 * c, 0.5 * s, 0.1 * c, 0.1 * s, 0.05 * s, 0.01 * s])


def simulate(
    chain: stp.ClosedChain,
    q: np.ndarray,
    v: np.ndarray,
    torque: Callable[[float], np.ndarray],
    duration: float,
    *,
    samples: int = 2,
    rtol: float = 1e-12,
) -> Motion:
    """Integrate a tree whose last joints are its motors; quaternions as four numbers, normalised on use."""
    n = chain.nq
    passive = np.zeros(chain.nv - chain.nu)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, v = pin.normalize(chain.model, y[:n]), y[n:]
        tau = np.concatenate([passive, torque(t)])
        a = stp.articulated_body_acceleration(chain, q, v, tau)
        return np.concatenate([pin.tangentMap(chain.model, q) @ v, a])

    time = np.linspace(0.0, duration, samples)
    done = solve_ivp(
        rate, (0.0, duration), np.concatenate([q, v]), method="DOP853", t_eval=time, rtol=rtol, atol=1e-14
    )
    assert done.success, done.message
    states = [(pin.normalize(chain.model, y[:n]), y[n:]) for y in done.y.T]
    return Motion(time, np.array([x[0] for x in states]), np.array([x[1] for x in states]))
