"""Many regular states of any chain, in all coordinates of kernels, and what becomes of them there.

States are drawn by displacing home, or a state drawn before, and closing the loops, with no regard to motors, platform
or branch; velocities keep the loops closed, accelerations follow from drawn efforts. What kernels find from the motors
or the platform alone is then known beforehand. Where they find something else, the state may lie on another branch than
that of home: then the verbs of one state tell what is right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import casadi as ca
import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.errors import ClosureError, InputError, SingularityError, UnsupportedError
from stewart_pin.kernels.graph.driven_tree import integrated
from stewart_pin.kernels.graph.loop_rows import opposed_axes
from stewart_pin.kernels.graph.platform_kinematics import platform_bias, platform_columns
from stewart_pin.kernels.graph.whole_tree import ClosedTree, close_tree
from stewart_pin.kernels.planning.spatial import shared
from stewart_pin.kernels.verbs.configurations import as_poses
from stewart_pin.programs.array_kernel import Engine
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.generic import regularity
from tests.closed_states import robot

Coordinates = Literal["tree", "motor", "platform"]
COORDINATES: tuple[Coordinates, ...] = ("tree", "motor", "platform")
REGULAR = 1e-2
"""Share of the usual regularity from which on a state must be answered; nearer to a singularity it may be refused."""
SPREAD = 0.4
"""How far a state is displaced at a time, in robot sizes and radians."""
TURN = 7.0
"""How far from home a joint may be, in robot sizes and radians: a little more than a turn."""
GENERATIONS = 5
"""How often a state has been displaced, at most."""
DETOURS = 30
"""Other poses over which a way from home is looked for, where the straight one leaves the workspace."""
AGREEMENT = 1e-11
"""Share of efforts by which they may differ at states where no digits are lost: a thousand operations in a row."""


@dataclass(frozen=True, eq=False)
class States:
    """Closed states that move, and the efforts that make them move so."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau_motor: np.ndarray
    pose: np.ndarray | None
    twist: np.ndarray | None
    acceleration: np.ndarray | None

    def __len__(self) -> int:
        return len(self.q)

    def given(
        self, chain: stp.ClosedChain, coordinates: Coordinates
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Say what kernels are given."""
        if coordinates == "tree":
            return self.q, self.v, self.a
        if coordinates == "motor":
            return self.q[:, chain.motor_q_index], self.v[:, chain.motor_index], self.a[:, chain.motor_index]
        assert self.pose is not None and self.twist is not None and self.acceleration is not None
        return self.pose, self.twist, self.acceleration


@dataclass
class Found:
    """Counts of states.

    `other` are those that kernels find on the branch of home where the drawn one lies on another, `refused` those that
    have no right to an answer: singular, or out of reach of home for the verbs of one state as well. What must not be:
    `missing`, refused though regular, `bold`, answers where the verbs of one state find no way, and `wrong`.
    """

    states: int = 0
    answered: int = 0
    other: int = 0
    refused: int = 0
    bold: int = 0
    missing: int = 0
    wrong: int = 0
    worst: float = 0.0
    undone: float = 0.0
    examples: list[tuple[str, int, float]] = field(default_factory=list)


class Mechanism:
    """A chain with its kernels, compiled when they are asked for."""

    def __init__(self, name: str, engine: Engine | None = None) -> None:
        self.chain = robot(name)
        self._engine: Engine | None = engine
        self._kernels: dict[Coordinates, stp.compiled.Kernels | None] = {}
        self._closed = close_tree(self.chain)
        self._compiled: dict[str, Callable[..., tuple[np.ndarray, ...]]] = {}

    def kernels(self, coordinates: Coordinates) -> stp.compiled.Kernels | None:
        """Kernels, or None where the coordinates do not determine the chain."""
        if coordinates not in self._kernels:
            try:
                made = stp.compile_kernels(self.chain, coordinates=coordinates, engine=self._engine)
            except UnsupportedError:
                made = None
            self._kernels[coordinates] = made
        return self._kernels[coordinates]

    @property
    def by_tree(self) -> stp.compiled.Kernels:
        kernels = self.kernels("tree")
        assert kernels is not None
        return kernels

    def compiled(
        self, what: str | Callable[[ClosedTree], ca.Function]
    ) -> Callable[..., tuple[np.ndarray, ...]]:
        """Compile a function of the kernels of the tree, or one that is written here, once."""
        key = what if isinstance(what, str) else what.__name__
        if key not in self._compiled:
            written = self.by_tree.casadi(what) if isinstance(what, str) else what(self._closed)
            self._compiled[key] = stp.compile_function(written, engine=self._engine)
        return self._compiled[key]

    def draw(self, count: int, rng: np.random.Generator, *, moving: bool = True) -> States:
        """Draw states; their number is about the count, less those whose loops did not close."""
        chain = self.chain
        q = self._configurations(count, rng)
        project = self.compiled("tree_projection")
        push = 9.81 * pin.computeTotalMass(chain.model) * chain.length_scale
        tau = rng.normal(size=(len(q), chain.nu)) * push / chain.tangent_scale[chain.motor_index]
        status = np.zeros(len(q), dtype=np.int8)
        if moving:
            v = project(q, rng.normal(size=(len(q), chain.nv)) * chain.tangent_scale)[1]
            a = self.by_tree.forward_dynamics(q, v, tau, status=status)
        else:
            v, a = np.zeros((2, len(q), chain.nv))
        tau = self.by_tree.inverse_dynamics(q, v, a)
        good = np.isfinite(v).all(axis=1) & (status == StateStatus.OK)
        q, v, a, tau = q[good], v[good], a[good], tau[good]
        if chain.platform is None:
            return States(q, v, a, tau, None, None, None)
        pose = as_poses(*self.compiled("platform_pose")(q))
        return States(q, v, a, tau, pose, *self.compiled(_moved_platform)(q, v, a))

    def _configurations(self, count: int, rng: np.random.Generator) -> np.ndarray:
        chain = self.chain
        if not chain.nc:
            step = rng.uniform(-2, 2, (count, chain.nv)) * chain.tangent_scale
            return np.array([pin.integrate(chain.model, chain.q_home, one) for one in step])
        project = self.compiled("tree_projection")
        displace = self.compiled(_displaced)
        home, still = np.tile(chain.q_home, (-(-count // GENERATIONS), 1)), np.zeros(chain.nv)
        joints = [joint for joint in chain.model.joints[1:] if joint.nq == joint.nv == 1]
        plain, size = [j.idx_q for j in joints], chain.tangent_scale[[j.idx_v for j in joints]]
        now, drawn = home, []
        for _ in range(GENERATIONS):
            now = displace(now, rng.uniform(-SPREAD, SPREAD, (len(now), chain.nv)) * chain.tangent_scale)[0]
            left = np.full((len(now), 1), np.inf)
            for _ in range(8):
                now, _, _, _, left = project(now, still)
            closed = (left[:, 0] <= 1e-13) & (displace(now, still)[1][:, 0] == 0)
            closed &= (np.abs((now - home)[:, plain]) / size <= TURN).all(axis=1)
            drawn.append(now[closed])
            now = np.where(closed[:, None], now, home)
        return np.concatenate(drawn)[:count]


def _displaced(closed: ClosedTree) -> ca.Function:
    """Displaced configuration, and whether a loop has closed with its axes opposed."""
    step = ca.SX.sym("step", closed.tree.nv)
    opposed = opposed_axes(closed.tree, closed.at)
    turned = ca.norm_inf(opposed) > 0 if opposed.numel() else ca.SX(0)
    return shared(
        "displaced",
        {"q": closed.q, "step": step},
        {"next": integrated(closed.tree, closed.q, step), "turned": turned},
    )


def _moved_platform(closed: ClosedTree) -> ca.Function:
    v, a = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("a", closed.tree.nv)
    rows = platform_columns(closed).T
    return shared(
        "moved",
        {"q": closed.q, "v": v, "a": a},
        {"twist": rows @ v, "acceleration": rows @ a + platform_bias(closed, v)},
    )


def examine(
    mechanism: Mechanism, coordinates: Coordinates, states: States, rng: np.random.Generator, judged: int
) -> Found | None:
    """See what kernels make of states; None where the chain does not admit the coordinates.

    All are compared with the efforts that are known; of those that agree, and of those that do not, and of those that
    are refused, up to `judged` each are put before the verbs of one state.
    """
    chain, kernels = mechanism.chain, mechanism.kernels(coordinates)
    if kernels is None:
        return None
    try:
        kernels.casadi("inverse_dynamics")
    except UnsupportedError:
        return None
    status, conditioning = np.empty(len(states), dtype=np.int8), np.empty(len(states))
    given = states.given(chain, coordinates)
    tau = kernels.inverse_dynamics(*given, status=status, conditioning=conditioning)
    ok = status == StateStatus.OK
    assert np.isfinite(tau[ok]).all() and np.isnan(tau[~ok]).all()
    number = Found(len(states), int(ok.sum()))
    off = _off(chain, tau, states.tau_motor)
    allowed = _allowed(conditioning)
    agree = ok & (off <= allowed)
    number.worst = float((off / allowed)[agree].max(initial=0.0))
    back = np.empty(len(states), dtype=np.int8)
    motion = kernels.forward_dynamics(given[0], given[1], tau, status=back)
    both = agree & (back == StateStatus.OK)
    number.undone = _undone(chain, coordinates, motion[both], given[2][both])
    judge = Judge(kernels, coordinates, states, tau, allowed, rng)
    for k in _some(np.flatnonzero(agree), judged, rng):
        if judge.of(k) != "right":
            number.wrong += judge.last == "wrong"
            number.bold += judge.last == "unknown"
            number.examples.append((f"agrees, but is {judge.last}", int(k), judge.regular))
    differ = np.flatnonzero(ok & ~agree)
    for k in _some(differ, judged, rng):
        verdict = judge.of(k)
        number.other += verdict == "right"
        number.bold += verdict == "unknown"
        number.wrong += verdict == "wrong"
        if verdict != "right":
            number.examples.append((f"differs, and is {verdict}", int(k), judge.regular))
    for k in _some(np.flatnonzero(~ok), judged, rng):
        missing = judge.of(k) == "right" and judge.regular >= REGULAR
        number.missing += missing
        number.refused += not missing
        if missing:
            number.examples.append(
                (f"refused with {StateStatus(int(status[k])).name}", int(k), judge.regular)
            )
    return number


def _some(rows: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return rows if len(rows) <= most else rng.choice(rows, most, replace=False)


def _weight(chain: stp.ClosedChain) -> np.ndarray:
    push = 9.81 * pin.computeTotalMass(chain.model) * chain.length_scale
    return push / chain.tangent_scale[chain.motor_index]


def _off(chain: stp.ClosedChain, found: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Largest difference of the efforts of each state, relative to the largest of them, or the weight."""
    scale = _weight(chain)
    size = np.maximum(1.0, np.abs(right / scale).max(axis=-1))
    return np.abs((found - right) / scale).max(axis=-1) / size


def _allowed(conditioning: np.ndarray) -> np.ndarray:
    return AGREEMENT / np.clip(conditioning, 1e-9, 1.0)


def _undone(chain: stp.ClosedChain, coordinates: Coordinates, found: np.ndarray, right: np.ndarray) -> float:
    """Largest difference of accelerations, relative to the largest of a state."""
    if not len(found):
        return 0.0
    size = {
        "tree": chain.tangent_scale,
        "motor": chain.tangent_scale[chain.motor_index],
        "platform": chain.twist_sizes,
    }[coordinates]
    off = np.abs((found - right) / size).max(axis=1)
    return float((off / np.maximum(9.81 / chain.length_scale, np.abs(right / size).max(axis=1))).max())


class Judge:
    """What the verbs of one state say to an answer of kernels."""

    def __init__(
        self,
        kernels: stp.compiled.Kernels,
        coordinates: Coordinates,
        states: States,
        tau: np.ndarray,
        allowed: np.ndarray,
        rng: np.random.Generator,
    ) -> None:
        chain = kernels.chain
        self._rng = rng
        self._given = (chain, coordinates, states, tau, allowed)
        self._kernels = kernels
        # From a singular home, where branches meet, any of them will do: that which the kernels took.
        self._from_home = regularity(chain.home_state()) >= 1e-3
        self.regular, self.last = 0.0, ""

    def of(self, k: int) -> str:
        """Return "right" or "wrong", "right" of a refusal where there is an answer, "unknown" where there is none."""
        chain, _, _, tau, allowed = self._given
        state = self._state(k)
        self.last = "unknown"
        self.regular = 0.0
        if state is None:
            return self.last
        self.regular = regularity(state)
        try:
            right = stp.inverse_dynamics(state).tau_motor
        except (SingularityError, InputError):  # an acceleration beyond all measure keeps no loops closed
            return self.last
        off = float(_off(chain, tau[k], right))
        limit = max(float(allowed[k]), AGREEMENT / self.regular**3)  # see `lost_on_the_way`
        self.last = "right" if not off > limit else "wrong"
        return self.last

    def _state(self, k: int) -> stp.State | None:
        chain, coordinates, states = self._given[:3]
        place, rate, acceleration = (x[k] for x in states.given(chain, coordinates))
        if coordinates == "tree":
            return chain.at(place, rate, acceleration)
        guess = None if self._from_home else self._kernels._configurations(place[None], 1).states[0]
        try:
            if coordinates == "motor":
                closure = stp.forward_kinematics(chain, place, q_guess=guess, limits=False, throw=False)
                if not closure.success:
                    return None
                here = stp.dynamics.motion_map(closure.state)
                v = here.G @ rate
                gamma = stp.dynamics.motion_map(chain, closure.q, v).gamma
                moving = rate.any() or acceleration.any()
                return chain.at(closure.q, v, here.G @ acceleration + gamma if moving else 0 * v)
            pose, still = pin.XYZQUATToSE3(place), np.zeros(chain.nv)
            q = self._configuration(pose, guess)
            if q is None:
                return None
            if not rate.any() and not acceleration.any():
                return chain.at(q, still, still)
            return stp.platform_motion(chain, pose, rate, acceleration, q_guess=q, limits=False)
        except (ClosureError, SingularityError):
            return None

    def _configuration(self, pose: pin.SE3, guess: np.ndarray | None) -> np.ndarray | None:
        """Find the configuration of a pose; where legs with closed forms have one, by a detour at least."""
        chain, states = self._kernels.chain, self._given[2]
        closure = stp.inverse_kinematics(chain, pose, q_guess=guess, limits=False, throw=False)
        if closure.success or not self._kernels.by_legs:
            return closure.q if closure.success else None
        assert states.pose is not None
        for k in self._rng.choice(len(states), DETOURS):
            over = pin.XYZQUATToSE3(states.pose[k])
            first = stp.inverse_kinematics(chain, over, q_guess=guess, limits=False, throw=False)
            if first.success:
                closure = stp.inverse_kinematics(chain, pose, q_guess=first.q, limits=False, throw=False)
                if closure.success:
                    return closure.q
        return None
