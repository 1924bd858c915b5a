"""Workspaces point by point where no closed form stands for a chain: six legs, any platform; closed paths."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, SingularityError, UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.kernels.choosing import kernels_for
from stewart_pin.mechanics.kinematics import inverse_kinematics, motor_jacobian
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import turning_motors
from stewart_pin.state.limits import AT_LIMIT
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_chain, as_configuration
from stewart_pin.tolerances import PRINTED, SINGULAR
from stewart_pin.typing import ArrayLike, Configuration, FloatArray


class ChainLegs:
    """Legs of a chain that are read off it as nearly as printed digits allow, and measured by inverse kinematics.

    Parameters
    ----------
    chain
        Closed chain of six legs.
    hexapod
        Its leg ends, nearly.
    rotation
        (3, 3) platform axes in the world frame.
    stroke
        (6, 2) least and greatest length of each leg [m].
    """

    def __init__(
        self, chain: ClosedChain, hexapod: Hexapod, rotation: FloatArray, stroke: FloatArray
    ) -> None:
        self._chain, self._hexapod, self._rotation, self._stroke = chain, hexapod, rotation, stroke
        self._found: dict[bytes, FloatArray | None] = {}
        self._last: FloatArray | None = None

    def lengths(self, position: FloatArray, reach: float) -> FloatArray:
        """Measure the legs where they may be within their strokes.

        Parameters
        ----------
        position
            (n, 3) platform origins in the world frame [m].
        reach
            How far outside the strokes a leg may be and still count [m].

        Returns
        -------
        numpy.ndarray
            (n, 6) lengths; as read off further outside, infinite where the chain does not reach [m].
        """
        sign, offset = self._chain.leg_readings
        lengths = leg_lengths(self._hexapod, position, self._rotation)
        slack = reach + 10 * PRINTED * self._chain.length_scale
        near = (lengths > self._stroke[:, 0] - slack) & (lengths < self._stroke[:, 1] + slack)
        for k in np.flatnonzero(near.all(axis=1)):
            q = self._configuration(position[k])
            lengths[k] = np.inf if q is None else offset + sign * q[self._chain.motor_q_index]
        return lengths

    def jacobian(self, position: FloatArray) -> FloatArray:
        """Measure how the legs change with the platform's motion.

        Parameters
        ----------
        position
            (n, 3) platform origins that the chain reaches, in the world frame [m].

        Returns
        -------
        numpy.ndarray
            (n, 6, 6) leg rates per twist [1 and m].
        """
        sign = self._chain.leg_readings[0][:, None]
        rows = np.zeros((len(position), 6, 6))
        for k, at in enumerate(position):
            q = self._configuration(at)
            if q is not None:
                rows[k] = sign * motor_jacobian(self._chain, q)
        return rows

    def _configuration(self, position: FloatArray) -> FloatArray | None:
        key = position.tobytes()
        if key not in self._found:
            pose = pin.SE3(self._rotation, position)
            closure = inverse_kinematics(self._chain, pose, q_guess=self._last, limits=False, throw=False)
            if not closure.success and self._last is not None:
                closure = inverse_kinematics(self._chain, pose, limits=False, throw=False)
            self._found[key] = self._last = closure.q if closure.success else None
        return self._found[key]


# ----------------------------------------------------------------------------------------------------
# The workspace of any platform, grown from a point: every cell is reached from one beside it
# ----------------------------------------------------------------------------------------------------

_MANY = 1000
"""States that are worth kernels."""
_WALK = 40
"""Steps to the size of the robot, when its workspace is measured."""
_FAR = 20.0
"""Robot sizes beyond which a workspace counts as endless."""
_ALONG = 1e-6
"""Share of an axis, in natural units, by which a platform that moves along it may fail to."""
_ATTEMPTS = 2
"""Neighbours from which a cell is tried: near a fold it may be reached from one and not from another."""


@dataclass(frozen=True, eq=False)
class GrownCells:
    """Cells of a grid that a chain reaches, each from one beside it, and those beyond a limit beside these.

    Attributes
    ----------
    index
        (N, 3) cells, counted from where the growth began.
    motors
        (N, nu) what the motors read [m or rad].
    inside
        (N,) of bool: whether all limits hold [dimensionless].
    jacobian
        (N, nu, k) rates of the motors per motion of the platform along as many axes as it has freedoms [m or rad per m
        or rad].
    twists
        (N, 6, k) the platform's whole motion per motion along each of these axes [m or rad per m or rad].
    axes
        (k,) these axes, of `TWIST_AXES`.
    """

    index: np.ndarray
    motors: FloatArray
    inside: np.ndarray
    jacobian: FloatArray
    twists: FloatArray
    axes: np.ndarray


class Growth:
    """A platform that is led from point to point without turning, within all limits of its chain.

    Parameters
    ----------
    chain
        Closed chain.
    rotation
        (3, 3) platform axes in the world frame.
    start
        (3,) platform origin to begin at, in the world frame [m].
    kernels
        Whether compiled kernels answer, where the motors alone have limits, of less than a turn, and drive legs with
        closed forms; None: where they can be had. They change nothing but the time.

    Raises
    ------
    UnsupportedError
        If the platform cannot shift along an axis of the world without turning.
    ClosureError
        If the chain does not reach the beginning.
    UnreachableError
        If it does beyond its limits.
    SingularityError
        If it is singular there, as a stretched arm.
    """

    def __init__(
        self, chain: ClosedChain, rotation: FloatArray, start: FloatArray, *, kernels: bool | None = None
    ) -> None:
        self._chain, self._rotation, self.start = chain, rotation, start
        self._begin = inverse_kinematics(chain, pin.SE3(rotation, start)).state
        twists = (self._begin.P / chain.twist_sizes[:, None]) @ self._begin.freedom.motions
        count = chain.generic.count.platform
        self.axes = np.sort(np.asarray(qr(twists.T, mode="r", pivoting=True)[-1])[:count])
        """Axes of twists, as many as freedoms, by which the platform's motion is told."""
        basis = np.linalg.svd(twists, full_matrices=False)[0][:, :count]
        free = np.linalg.norm(basis, axis=1) > 1 - _ALONG
        self.shifts = np.flatnonzero(free[:3])
        """Axes of the world along which the platform shifts without turning."""
        if not len(self.shifts):
            raise self._fixed()
        if not self._regular(self._begin.P[self.axes] @ self._begin.freedom.motions):
            raise SingularityError(
                f"where the workspace of '{chain.name}' would begin, its platform does not tell the joints which way "
                "to bend; begin elsewhere (start=)",
                smallest_singular_value=0.0,
            )
        others = np.setdiff1d(chain.limits.stated("position"), chain.motor_index)
        plain = not others.size and free[self.axes].all() and not self._counts_turns()
        compiled = kernels_for(chain, _MANY, kernels) if plain else None
        self._kernels = compiled if compiled is not None and compiled.by_legs else None

    def _counts_turns(self) -> bool:
        """Whether a motor may stand where a pose does not tell: beyond half a turn to either side."""
        bounds = self._chain.limits.bounds("position", self._chain.motor_index)
        return bool((np.abs(bounds[turning_motors(self._chain)]) > np.pi).any())

    def _fixed(self) -> UnsupportedError:
        return UnsupportedError(
            f"the platform of '{self._chain.name}' does not shift along an axis of the world without turning; a "
            "workspace at one orientation is of platforms that do"
        )

    def extent(self) -> float:
        """Measure how far the platform goes along each axis of the world, and back, from the beginning.

        Returns
        -------
        float
            The longest way, to a fortieth of the robot's size [m].

        Raises
        ------
        InputError
            If no limit ends it.
        UnsupportedError
            If it goes nowhere.
        """
        step = self._chain.length_scale / _WALK
        longest = 0
        for axis in self.shifts:
            taken = [self._steps(step * np.eye(3)[axis] * side) for side in (1.0, -1.0)]
            if max(taken) > _FAR * _WALK:
                raise InputError(
                    f"nothing ends the way of the platform of '{self._chain.name}' along {'xyz'[axis]}; state "
                    "limits of its joints (with_limits)"
                )
            longest = max(longest, sum(taken))
        if not longest:
            raise self._fixed()
        return longest * step

    def _steps(self, step: FloatArray) -> int:
        q, count = self._begin.q, 0
        while count <= _FAR * _WALK:
            pose = pin.SE3(self._rotation, self.start + (count + 1) * step)
            found = inverse_kinematics(self._chain, pose, q_guess=q, limits=False, throw=False)
            if not found.success or self._chain.judge.positions(found.q):
                break
            q, count = found.q, count + 1
        return count

    def cells(self, spacing: float, most: int) -> GrownCells:
        """Grow the workspace from cell to cell.

        Parameters
        ----------
        spacing
            Side of a cell [m].
        most
            Number of cells that are too many.

        Returns
        -------
        GrownCells
            The cells.

        Raises
        ------
        InputError
            If there are more.
        """
        answer = self._by_states if self._kernels is None else self._by_kernels
        begin: tuple[int, ...] = (0, 0, 0)
        steps = [tuple(side * int(k == axis) for k in range(3)) for axis in self.shifts for side in (-1, 1)]
        found: dict[tuple[int, ...], _Cell | None] = {begin: answer(np.zeros((1, 3)), [self._begin.q])[0]}
        tried: Counter[tuple[int, ...]] = Counter([begin])
        front = [begin] if found[begin] is not None else []
        while front:
            following = _following(front, steps, found, tried)
            tried.update(following.keys())
            if len(tried) > most:
                raise InputError(
                    f"spacing {spacing:g} m makes more than {most} cells; choose a larger one, or state limits"
                )
            front = []
            answers = answer(
                spacing * np.array(list(following), dtype=float).reshape(-1, 3), list(following.values())
            )
            for cell, one in zip(following, answers, strict=True):
                if one is None or (cell in found and not one.inside):
                    continue
                found[cell] = one
                if one.inside and one.leads:
                    front.append(cell)
        reached = {cell: one for cell, one in found.items() if one is not None}
        return GrownCells(
            index=np.array(list(reached)),
            motors=np.array([one.motors for one in reached.values()]),
            inside=np.array([one.inside for one in reached.values()]),
            jacobian=np.array([one.jacobian for one in reached.values()]),
            twists=np.array([one.twists for one in reached.values()]),
            axes=self.axes,
        )

    def _by_states(self, shift: FloatArray, guesses: list[Configuration]) -> list[_Cell | None]:
        chain = self._chain
        answers: list[_Cell | None] = []
        for by, guess in zip(shift, guesses, strict=True):
            pose = pin.SE3(self._rotation, self.start + by)
            closure = inverse_kinematics(chain, pose, q_guess=guess, limits=False, throw=False)
            if not closure.success:
                answers.append(None)
                continue
            state, jacobian, twists = closure.state, np.zeros((chain.nu, len(self.axes))), self._plain()
            motions = state.freedom.motions
            platform = state.P[self.axes] @ motions
            leads = self._regular(platform)
            if leads:  # spare motors: the least motion
                along = np.linalg.pinv(platform)
                jacobian, twists = motions[chain.motor_index] @ along, state.P @ motions @ along
            inside = not chain.judge.positions(closure.q)
            answers.append(_Cell(closure.q, closure.q[chain.motor_q_index], inside, jacobian, twists, leads))
        return answers

    def _plain(self) -> FloatArray:
        """Motions along the axes alone."""
        return np.eye(6)[:, self.axes]

    def _regular(self, platform: FloatArray) -> bool:
        """Whether the platform leads its joints one way: where a leg is stretched they may bend to either side."""
        singular = np.linalg.svd(platform / self._chain.twist_sizes[self.axes, None], compute_uv=False)
        return bool(singular[-1] > SINGULAR * singular[0])

    def _by_kernels(self, shift: FloatArray, guesses: list[Configuration]) -> list[_Cell | None]:
        """Ask kernels of legs with closed forms: on the branch of home whatever the guess."""
        assert self._kernels is not None
        pose = np.tile(pin.SE3ToXYZQUAT(pin.SE3(self._rotation, self.start)), (len(shift), 1))
        pose[:, :3] += shift
        status, graded = np.zeros((2, len(shift)), dtype=np.int8)
        motors = self._kernels.inverse_kinematics(pose, status=status)
        jacobian = self._kernels.motor_jacobian(pose, status=graded)[..., self.axes]
        bounds = self._chain.limits.bounds("position", self._chain.motor_index)
        slack = AT_LIMIT * self._chain.tangent_scale[self._chain.motor_index]
        inside = np.all((motors >= bounds[:, 0] - slack) & (motors <= bounds[:, 1] + slack), axis=1)
        leads = graded == StateStatus.OK
        jacobian = np.where(leads[:, None, None], jacobian, 0.0)
        return [
            _Cell(self._begin.q, motors[k], bool(inside[k]), jacobian[k], self._plain(), bool(leads[k]))
            if status[k] == StateStatus.OK
            else None
            for k in range(len(shift))
        ]


def _following(
    front: Sequence[tuple[int, ...]],
    steps: Sequence[tuple[int, ...]],
    found: Mapping[tuple[int, ...], _Cell | None],
    tried: Counter[tuple[int, ...]],
) -> dict[tuple[int, ...], Configuration]:
    """Cells beside those of a layer, each with the configuration from which it is tried.

    A cell is reached from the first of its neighbours of this layer; one that is not, or only beyond limits, is tried
    again from another.
    """
    following: dict[tuple[int, ...], Configuration] = {}
    for cell in front:
        here = found[cell]
        for step in steps if here else ():
            beside = tuple(k + d for k, d in zip(cell, step, strict=True))
            known = found.get(beside)
            done = beside in following or tried[beside] >= _ATTEMPTS or (known and known.inside)
            if here and not done:
                following[beside] = here.q
    return following


@dataclass(frozen=True, eq=False)
class _Cell:
    """A cell that is reached: a guess for those beside it, and whether these may be reached from it."""

    q: Configuration
    motors: FloatArray
    inside: bool
    jacobian: FloatArray
    twists: FloatArray
    leads: bool


# ----------------------------------------------------------------------------------------------------
# Paths between configurations on which the loops stay closed
# ----------------------------------------------------------------------------------------------------

Path = Callable[[float], Configuration]
"""Configuration (nq,) as a function of one parameter."""


def closed_path(chain: ClosedChain, configurations: ArrayLike) -> Path:
    """Join closed configurations by a path whose every point has closed loops.

    Parameters
    ----------
    chain
        Closed chain.
    configurations
        (n, nq) two or more configurations, the loops nearly closed [m, rad, unit quaternions].

    Returns
    -------
    callable
        Configuration (nq,) of a parameter from 0 to n - 1: the tangent's straight line between neighbours, moved to
        the nearest configuration with closed loops.

    Raises
    ------
    InputError
        If there are fewer than two.
    ClosureError
        When called: if the loops do not close in between; give more configurations.
    """
    as_chain(chain)
    stops = as_array("configurations", configurations, (None, chain.nq))
    if len(stops) < 2:
        raise InputError(f"configurations must be two or more, got {len(stops)}")
    stops = [close_loops(chain, as_configuration(chain, "configurations", q)).q for q in stops]

    def path(s: float) -> Configuration:
        k = min(max(int(np.floor(s)), 0), len(stops) - 2)
        if s == k or s == k + 1:
            return stops[k + int(s != k)]
        return close_loops(chain, pin.interpolate(chain.model, stops[k], stops[k + 1], s - k)).q

    return path
