"""All poses of a six-legged platform that share six leg lengths, each with a proof of its existence.

A parameter homotopy in Study coordinates follows the 40 solutions of a generic complex platform to the one
asked for [1]_; what is real among the ends is polished and certified. The search for all complex
solutions, which takes as many start systems as it needs, stands below.

References
----------
.. [1] A. J. Sommese, C. W. Wampler, "The Numerical Solution of Systems of Polynomials", World Scientific,
   2005, sections 7.1 and 7.7 (coefficient-parameter homotopy; Stewart–Gough platforms).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from stewart_pin.analysis.assembly_modes import homotopy
from stewart_pin.analysis.assembly_modes.certificates import (
    StartSystem,
    beside,
    certify,
    classify,
    distinct,
    start_systems,
)
from stewart_pin.analysis.assembly_modes.description import AssemblyModes, lies_on_curve
from stewart_pin.analysis.assembly_modes.homotopy import Tracked, TrackerSettings, with_more_digits
from stewart_pin.analysis.assembly_modes.study import ComplexArray, Scaling, StudyPlatform
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, MissingExtraError, UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths, require_hexapod
from stewart_pin.geometry.hexapod_pose import as_leg_lengths
from stewart_pin.mechanics.closed_forms import admission, leg_form
from stewart_pin.mechanics.kinematics import (
    forward_kinematics,
    inverse_kinematics,
    motor_positions,
    platform_pose,
)
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray

_REAL = 1e-5
"""Relative imaginary part below which a solution may be real; the certificate decides."""
_SAME_SINGULAR = 1e-4
"""Distance within which two singular solutions, known to half the digits, are one."""
_SEED = 7
"""Of the generic lengths at which `AssemblySolver` prepares a geometry."""


def assembly_modes(
    hexapod: Hexapod | ClosedChain, lengths: ArrayLike, *, engine: Engine | None = None
) -> AssemblyModes:
    """Find all poses of a platform that have the given leg lengths.

    Parameters
    ----------
    hexapod
        Geometry; or a chain of which motors drive the legs.
    lengths
        (6,) leg lengths; for a chain what its motors read, wherever they have their zero and sign [m].
    engine
        ``"numba"`` (extra ``compiled``) or ``"numpy"``; None takes numba when it is installed.

    Returns
    -------
    AssemblyModes
        Look at ``complete`` before relying on the number of poses. Where no closed form stands for the chain
        (`closed_forms`), as with axes that miss each other by printed digits, each pose is taken up by
        `forward_kinematics` of the chain, and proven for none.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> hexapod = Hexapod(rng.normal(size=(6, 3)), rng.normal(size=(6, 3)))
    >>> modes = assembly_modes(hexapod, leg_lengths(hexapod, [0.1, 0.2, 1.0], np.eye(3)), engine="numpy")
    >>> modes.n_complex, modes.complete, bool(modes.certified.all())
    (40, True, True)
    """
    chain = hexapod if isinstance(hexapod, ClosedChain) else None
    readings = lengths
    if isinstance(hexapod, ClosedChain):
        found = admission(hexapod, "leg_lengths")
        if found.geometry is None:
            raise UnsupportedError(
                f"'{hexapod.name}' stands on no six legs alone ({found.reason}); forward_kinematics(..., all=True) "
                "searches poses of any chain"
            )
        sign, offset = hexapod.leg_readings
        readings = as_array("lengths", lengths, (hexapod.nu,))
        lengths = offset + sign * readings
        hexapod = Hexapod.from_chain(hexapod)
    require_hexapod(hexapod)
    checked = as_leg_lengths(lengths, (6,))
    scaling = Scaling.of(hexapod, checked)
    found = _solve(hexapod, checked, scaling, start_systems(), tracker_for(engine))
    if chain is not None and leg_form(chain, "leg_lengths") is None:
        return _on_chain(chain, np.asarray(readings), found)
    return found


class AssemblySolver:
    """Find all poses of one geometry for many sets of leg lengths.

    The solutions for generic complex lengths are found once; only lengths move afterwards, and only as many
    paths are followed as the geometry has finite solutions.

    Parameters
    ----------
    hexapod
        Geometry.
    engine
        ``"numba"`` (extra ``compiled``) or ``"numpy"``; None takes numba when it is installed.

    Attributes
    ----------
    hexapod
        Geometry.
    n_generic
        Number of finite complex solutions for generic lengths. Zero when the geometry is architecturally
        singular: it then has solutions for special lengths only, and moves with all legs locked.
    """

    def __init__(self, hexapod: Hexapod, *, engine: Engine | None = None) -> None:
        self.hexapod = hexapod
        self._engine: Engine | None = engine
        self._tracker = tracker_for(engine)
        self._scaling = Scaling.of(hexapod)
        self._starts: list[StartSystem] = []
        self._sure = True
        self.n_generic = len(self._start(0).points)

    def solve(self, lengths: ArrayLike) -> AssemblyModes | tuple[AssemblyModes, ...]:
        """Find all poses for one or many sets of leg lengths.

        Parameters
        ----------
        lengths
            (6,) or (N, 6) leg lengths [m].

        Returns
        -------
        AssemblyModes or tuple of AssemblyModes
            One record for (6,), N of them for (N, 6).

        Raises
        ------
        InputError
            If lengths have another shape.
        """
        if np.ndim(lengths) == 1:
            return self._solve_one(as_leg_lengths(lengths, (6,)))
        if np.ndim(lengths) != 2:
            raise InputError(f"lengths must have shape (6,) or (n, 6), got {np.shape(lengths)}")
        return tuple(self._solve_one(row) for row in as_leg_lengths(lengths, (None, 6)))

    def _solve_one(self, lengths: FloatArray) -> AssemblyModes:
        if self.n_generic == 0:
            return assembly_modes(self.hexapod, lengths, engine=self._engine)
        return _solve(
            self.hexapod, lengths, self._scaling, self._lazy_starts(), self._tracker, sure=self._sure
        )

    def _lazy_starts(self) -> Iterator[StartSystem]:
        for i in range(len(start_systems())):
            start = self._start(i)
            if len(start.points) == self.n_generic:
                yield start

    def _start(self, index: int) -> StartSystem:
        while len(self._starts) <= index:
            n = len(self._starts)
            rng = np.random.default_rng([_SEED, n])
            squares = 3.0 * (1.0 + 0.5 * (rng.normal(size=6) + 1j * rng.normal(size=6)) / np.sqrt(2.0))
            platform = StudyPlatform.from_points(*self._scaling.points(self.hexapod), squares)
            systems = start_systems()
            found = search(platform, systems[n:] + systems[:n], self._tracker, real=False)
            self._sure &= found.complete
            self._starts.append(StartSystem(platform, found.regular))
        return self._starts[index]


def _solve(
    hexapod: Hexapod,
    lengths: FloatArray,
    scaling: Scaling,
    starts: tuple[StartSystem, ...] | Iterator[StartSystem],
    tracker: Tracker,
    *,
    sure: bool = True,
) -> AssemblyModes:
    points, scaled = scaling.points(hexapod), lengths / scaling.size
    platform = StudyPlatform.from_points(*points, scaled**2)
    found = search(platform, starts, tracker, real=True)
    clusters = _clusters(found.singular)
    curve = any(lies_on_curve(platform, p) for p in clusters[:3])
    if curve:
        clusters = clusters[:0]
    proofs = certify(*points, scaled, _real_parts(found.regular))
    kept = proofs.certified | proofs.converged
    once = distinct(proofs.points[kept])
    regular, certified = proofs.points[kept][once], proofs.certified[kept][once]
    singular = _real_parts(clusters)
    position, rotation = scaling.pose(np.vstack([regular, singular]))
    certified = np.concatenate([certified, np.zeros(len(singular), dtype=bool)])
    residual = np.abs(leg_lengths(hexapod, position, rotation) - lengths).max(axis=1, initial=0.0)
    n_complex = len(found.regular) + len(clusters)
    order = np.lexsort(np.round(position / scaling.size, 9).T)[::-1]
    return AssemblyModes(
        position[order],
        rotation[order],
        residual[order],
        certified[order],
        n_complex,
        "positive-dimensional" if curve else "finite",
        # More solutions than paths account for: one that is nearly double has been taken for two.
        found.complete and sure and n_complex <= found.expected,
        found.expected,
        found.failed,
        found.searches,
    )


def _on_chain(chain: ClosedChain, readings: FloatArray, found: AssemblyModes) -> AssemblyModes:
    """Take poses of legs that are nearly the chain's up by the chain itself."""
    position, rotation, residual = found.position.copy(), found.rotation.copy(), np.full(len(found), np.inf)
    for k in range(len(found)):
        near = inverse_kinematics(chain, pin.SE3(rotation[k], position[k]), limits=False, throw=False)
        closure = forward_kinematics(chain, readings, q_guess=near.q, limits=False, throw=False)
        pose = platform_pose(chain, closure.q)
        position[k], rotation[k] = pose.translation, pose.rotation
        residual[k] = np.abs(motor_positions(chain, closure.q) - readings).max(initial=closure.gap)
    return replace(
        found,
        position=position,
        rotation=rotation,
        residual=residual,
        certified=np.zeros(len(found), dtype=bool),
    )


def _clusters(points: ComplexArray) -> ComplexArray:
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    kept: list[int] = []
    for i, u in enumerate(unit):
        if all(1.0 - abs(u.conj() @ unit[j]) ** 2 > _SAME_SINGULAR**2 for j in kept):
            kept.append(i)
    return unit[kept]


def _real_parts(points: ComplexArray) -> FloatArray:
    """Turn the phase so that the largest rotation coordinate is one, and keep what is then nearly real."""
    if len(points) == 0:
        return np.empty((0, 8))
    largest = np.argmax(np.abs(points[:, :4]), axis=1)
    x = points / points[np.arange(len(points)), largest][:, None]
    near = np.abs(x.imag).max(axis=1) < _REAL * np.abs(x).max(axis=1)
    return x[near].real


# ----------------------------------------------------------------------------------------------------
# Search for all complex solutions of one platform, from as many start systems as it takes to be sure
# ----------------------------------------------------------------------------------------------------

Engine = Literal["numba", "numpy"]
Tracker = Callable[[StudyPlatform, StudyPlatform, ComplexArray, TrackerSettings], Tracked]


@dataclass(frozen=True, eq=False)
class Solutions:
    """The complex solutions of one platform.

    Attributes
    ----------
    regular
        (n, 8) regular finite solutions.
    singular
        (m, 8) singular finite solutions, with repetition.
    complete
        Whether all paths are accounted for.
    expected
        Finite solutions, with multiplicity, that the paths account for.
    failed
        Undecided paths of the last search.
    searches
        Start systems used.
    """

    regular: ComplexArray
    singular: ComplexArray
    complete: bool
    expected: int
    failed: int
    searches: int


def tracker_for(engine: Engine | None) -> Tracker:
    """Choose the tracker.

    Parameters
    ----------
    engine
        ``"numba"`` needs the extra ``compiled``; None takes it when it is installed.

    Returns
    -------
    callable
        `homotopy.track` or its compiled twin.

    Raises
    ------
    InputError
        If there is no such engine.
    MissingExtraError
        If numba is asked for and not installed.
    """
    if engine not in (None, "numba", "numpy"):
        raise InputError(f"engine must be 'numba', 'numpy' or None, got {engine!r}")
    if engine != "numpy":
        try:
            from stewart_pin.analysis.assembly_modes import compiled_homotopy  # noqa: PLC0415
        except ImportError:
            if engine == "numba":
                raise MissingExtraError("numba", "compiled") from None
        else:
            return compiled_homotopy.track
    return homotopy.track


def search(
    target: StudyPlatform, starts: Iterable[StartSystem], tracker: Tracker, *, real: bool
) -> Solutions:
    """Collect the solutions of a platform.

    A path that fails is not followed again with smaller steps, which would lead it into the same trouble,
    but the whole search is repeated from another start system, whose paths run elsewhere.

    Parameters
    ----------
    target
        The platform.
    starts
        Start systems, all with the same number of solutions.
    tracker
        From `tracker_for`.
    real
        Whether the parameters are real, so that the conjugate of a solution is one.

    Returns
    -------
    Solutions
        Complete when all paths of one start end at different regular solutions, or when two starts agree.
    """
    regular = np.empty((0, 8), dtype=complex)
    singular, complete, expected, failed, searches = regular, False, 0, 0, 0
    for start in starts:
        known = len(regular)
        tracked = tracker(start.platform, target, start.points, homotopy.DEFAULT)
        ends = classify(target, with_more_digits(start.platform, target, tracked))
        regular = ends.regular if searches == 0 else np.vstack([regular, ends.regular])
        regular = regular[distinct(regular)] if searches else regular
        if real and len(regular) < len(start.points):
            regular = np.vstack([regular, regular.conj()])
            regular = regular[distinct(regular)]
        searches += 1
        singular = ends.singular if len(ends.singular) >= len(singular) else singular
        failed = ends.failed
        expected = max(len(start.points) - ends.infinite, len(regular))
        agrees = searches > 1 and failed == 0 and known == len(regular) == len(ends.regular)
        complete = len(regular) == len(start.points) or agrees
        if complete:
            break
    singular = singular[~beside(singular, regular)]
    return Solutions(regular, singular, complete, expected, 0 if complete else failed, searches)
