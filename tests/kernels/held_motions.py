"""Motions of a rebuilt chain of which some coordinates are held: by Newton steps and least squares on Pinocchio's rows.

This is the judge of the derivatives by the geometry: it shares nothing with the kernels but the names of what is held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.state.freedom import TWIST_AXES
from tests.closed_states import random_configuration, random_motion

_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class HeldState:
    """A state of a chain, the rows of it that are held, and the efforts that go with it.

    Rates and accelerations are those of all coordinates that drive (platform, motors, or the whole tree).
    """

    chain: stp.ClosedChain
    coordinates: str
    rows: tuple[int, ...]
    q: np.ndarray
    rates: np.ndarray
    accelerations: np.ndarray
    efforts: np.ndarray
    wrenches: Mapping[str, np.ndarray] | None = None

    @property
    def pose(self) -> pin.SE3:
        return stp.platform_pose(self.chain, self.q)

    @property
    def inputs(self) -> dict[str, list[np.ndarray]]:
        """What the functions that take a configuration are given."""
        return {
            "inverse_dynamics": [self.q, self.rates, self.accelerations],
            "forward_dynamics": [self.q, self.rates, self.efforts],
        }

    def answer(self, verb: str, displacements: Mapping[stp.build.GeometryParameter, float]) -> np.ndarray:
        """Rebuild the chain, let the rest follow, and ask the verb of one state."""
        chain = stp.build.displace_geometry(self.chain, displacements)
        q = self._closed(chain)
        jacobian = self._jacobian(chain, q)
        v = self._least(jacobian, np.concatenate([np.zeros(chain.nc), self.rates[list(self.rows)]]))
        if self.coordinates != "tree":  # idle freedoms carry no momentum
            idle, M = self._idle(jacobian), chain.at(q).M
            v = v - idle @ np.linalg.pinv(idle.T @ M @ idle) @ (idle.T @ M @ v)
        bias = _bias(chain, self.coordinates, q, v)
        if verb == "forward_dynamics":
            moved = stp.forward_dynamics(chain, q, v, self.efforts, wrenches=self.wrenches).a
            return _drive(chain, self.coordinates, q) @ moved + bias
        wanted = np.concatenate([-stp.loop_bias(chain, q, v), (self.accelerations - bias)[list(self.rows)]])
        a = self._least(jacobian, wanted)
        return stp.inverse_dynamics(chain, q, v, a, wrenches=self.wrenches).tau_motor

    def _jacobian(self, chain: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
        return np.vstack([chain.at(q).J_c, _drive(chain, self.coordinates, q)[list(self.rows)]])

    def _least(self, jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Least norm, with the rank of the chain as it was: what a displacement adds is of the second order."""
        rank = self._rank
        left, s, across = np.linalg.svd(jacobian, full_matrices=False)
        return across[:rank].T @ ((left[:, :rank].T @ right) / s[:rank])

    def _idle(self, jacobian: np.ndarray) -> np.ndarray:
        return np.linalg.svd(jacobian)[2][self._rank :].T

    @property
    def _rank(self) -> int:
        own = np.linalg.svd(self._jacobian(self.chain, self.q), compute_uv=False)
        return int(np.count_nonzero(own > _RANK * own[0]))

    def _closed(self, chain: stp.ClosedChain) -> np.ndarray:
        q = self.q
        for _ in range(8):
            gap = np.concatenate([stp.loop_gap(chain, q), self._off(chain, q)])
            step = -self._least(self._jacobian(chain, q), gap)
            q = pin.integrate(chain.model, q, step)
            if np.abs(step).max() < 1e-15:
                break
        return q

    def _off(self, chain: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
        if self.coordinates == "platform":
            here = stp.platform_pose(chain, q)
            turn = pin.log3(here.rotation @ self.pose.rotation.T)
            off = np.concatenate([here.translation - self.pose.translation, turn])
        elif self.coordinates == "motor":
            off = (q - self.q)[chain.motor_q_index]
        else:
            off = pin.difference(chain.model, self.q, q)
        return off[list(self.rows)]


def held_state(
    chain: stp.ClosedChain, coordinates: str, names: tuple[str, ...], rng: np.random.Generator
) -> HeldState:
    """Draw a state, the most regular of some; of a drive, idle freedoms at rest."""
    known = {
        "platform": [f"platform {axis}" for axis in TWIST_AXES],
        "motor": list(chain.motors),
        "tree": list(chain.tangent_names),
    }[coordinates]
    rows = tuple(known.index(name) for name in names)
    # An arm may be far from home, where it is stretched.
    spread = 0.15 if chain.nc else 0.8
    drawn = [random_configuration(chain, rng, spread) for _ in range(5)]
    q = max(drawn, key=lambda q: _regularity(chain, coordinates, rows, q))
    v, step = (random_motion(chain, rng, q)[0] for _ in range(2))
    drive = _drive(chain, coordinates, q)
    if coordinates != "tree":
        v = v - _without_effect(chain, coordinates, q) @ v
    scale = chain.tangent_scale
    jacobian = stp.loop_jacobian(chain, q) * scale
    a = step - scale * np.linalg.lstsq(jacobian, stp.loop_bias(chain, q, v), rcond=1e-10)[0]
    efforts = stp.inverse_dynamics(chain, q, v, a).tau_motor
    return HeldState(
        chain, coordinates, rows, q, drive @ v, drive @ a + _bias(chain, coordinates, q, v), efforts
    )


def _regularity(chain: stp.ClosedChain, coordinates: str, rows: tuple[int, ...], q: np.ndarray) -> float:
    """Smallest singular value but those of idle freedoms and redundant rows."""
    held = np.vstack([chain.at(q).J_c, _drive(chain, coordinates, q)[list(rows)]])
    s = np.linalg.svd(held, compute_uv=False)
    return float(s[s > _RANK * s[0]][-1])


def _without_effect(chain: stp.ClosedChain, coordinates: str, q: np.ndarray) -> np.ndarray:
    """Projector on the motions that neither loops nor drive see."""
    rows = np.vstack([chain.at(q).J_c, _drive(chain, coordinates, q)])
    return np.eye(chain.nv) - np.linalg.pinv(rows, rcond=_RANK) @ rows


def _drive(chain: stp.ClosedChain, coordinates: str, q: np.ndarray) -> np.ndarray:
    if coordinates == "platform":
        return chain.at(q).P
    return np.eye(chain.nv) if coordinates == "tree" else np.eye(chain.nv)[chain.motor_index]


def _bias(chain: stp.ClosedChain, coordinates: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    if coordinates == "platform":
        return chain.at(q, v).platform_bias
    return np.zeros(chain.nv if coordinates == "tree" else chain.nu)


def slope(f: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Central differences of order 6."""
    one, two, three = (f(k * h) - f(-k * h) for k in (1, 2, 3))
    return (45 * one - 9 * two + three) / (60 * h)
