"""Where a platform can go without turning: a cloud of points, what stops it there, and how well it moves.

Of six legs: at a fixed orientation the length of leg i is the distance of the platform origin from the fixed point
c_i = B_i - R P_i. The workspace is what six spherical shells around these points have in common; a leg length changes
at most as much as the position does, which makes the volume bounds below rigorous. Any other platform is led from cell
to cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy import ndimage

from stewart_pin.analysis.point_by_point import ChainLegs, GrownCells, Growth
from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths, leg_vectors
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.kernels.choosing import lengths_at
from stewart_pin.mechanics.closed_forms import admission, leg_form
from stewart_pin.mechanics.kinematics import inverse_kinematics, platform_pose
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray

Sheet = Literal["upper", "lower", "both"]
"""Side of the base points on which the platform stands."""

_ACROSS = 60
"""Points across the widest direction, when no spacing is given."""
_FEWER = 20
"""The same where each point is asked of the whole chain."""
_MOST = 20_000_000
_MOST_LED = 200_000
"""Cells to which a platform is led, some thousand in a second."""
_CHUNK = 200_000
"""Points that are evaluated at once: 100 MB of Jacobians."""
_COARSE = 20
"""Cells along each axis when the bounds are tightened."""
_SINGULAR = 1e-12
"""Determinant of the normalised Jacobian that is round-off."""
_NOISE = 1e-14
"""Smallest over largest singular value that is round-off."""


@dataclass(frozen=True, eq=False, repr=False)
class WorkspaceSamples(Brief):
    """Points of a regular grid that lie in the workspace or within a cell of its boundary.

    Attributes
    ----------
    position
        (N, 3) platform origins, in the base frame [m].
    inside
        (N,) of bool: whether all legs are within their stroke, and the other joints of a chain within their limits
        [dimensionless].
    clearance
        (N,) least distance of a leg length from a limit, negative outside; of a motor elsewhere, angles times `length`
        [m].
    limiting_leg
        (N,) index of the leg or motor that has this clearance, from 0.
    limiting_end
        (N,) -1 where its least length limits, +1 where its greatest does [dimensionless].
    condition
        (N,) condition number of the leg Jacobian, moments divided by `length`; elsewhere of the motors' rates per
        motion of the platform; infinite where it is singular [dimensionless].
    determinant_sign
        (N,) sign of its determinant; it changes where a singularity is crossed, and is 0 on one [dimensionless].
    index
        (N, 3) cell of each point in the grid.
    shape
        Number of cells of the whole grid along x, y, z.
    spacing
        Side of a cell [m].
    bounds
        (2, 3) least and greatest x, y, z that the legs allow, to a coarse cell, outwards [m].
    volume
        Of the cells whose centre is inside; one layer of cells where a platform keeps to a plane or a line [m³].
    volume_error
        Standard error of `volume`, as if one random point decided for each cell that the boundary cuts [m³].
    volume_bounds
        Volume of the cells that are inside as a whole, and of those that are not outside as a whole; where other joints
        have limits, the first is 0, since points do not prove it [m³].
    pieces
        Number of separate parts with a hundredth of the points or more each; single cells on sharp edges do not count.
    length
        Length that makes turning and shifting comparable [m].
    limits
        What `limiting_leg` counts: legs, or the motors by name.
    """

    position: FloatArray
    inside: np.ndarray
    clearance: FloatArray
    limiting_leg: np.ndarray
    limiting_end: np.ndarray
    condition: FloatArray
    determinant_sign: np.ndarray
    index: np.ndarray
    shape: tuple[int, int, int]
    spacing: float
    bounds: FloatArray
    volume: float
    volume_error: float
    volume_bounds: tuple[float, float]
    pieces: int
    length: float
    limits: tuple[str, ...] = tuple(f"leg {k + 1}" for k in range(6))

    @property
    def dexterity(self) -> FloatArray:
        """(N,) inverse of the condition number: 1 at best, 0 at a singularity [dimensionless]."""
        return 1.0 / self.condition

    @property
    def boundary(self) -> np.ndarray:
        """(N,) of bool: whether a point is inside and within one cell of the boundary [dimensionless]."""
        return self.inside & (self.clearance < self.spacing)

    @property
    def crosses_singularity(self) -> bool:
        """Whether the workspace holds points on both sides of a singularity, or on one."""
        return (
            np.unique(self.determinant_sign[self.inside]).size > 1
            or not self.determinant_sign[self.inside].all()
        )


def sample_workspace(
    hexapod: Hexapod | ClosedChain,
    rotation: ArrayLike,
    *,
    stroke: ArrayLike | None = None,
    sheet: Sheet = "upper",
    spacing: float | None = None,
    length: float | None = None,
    kernels: bool | None = None,
    start: ArrayLike | None = None,
) -> WorkspaceSamples:
    """Sample the positions that a platform can take at one orientation.

    Parameters
    ----------
    hexapod
        Geometry; or a chain, in the world frame, whose limits then count: of the strokes of six legs unless others are
        given, and of passive joints and joints that close loops, for which `inverse_kinematics` is asked at every point
        inside the strokes, from its neighbour on. It is asked for the lengths too, where no closed form stands for the
        chain (`closed_forms`). A platform on anything but six legs is led from home, or `start`, from cell to cell
        within its limits: a part that is not connected with it, or lies beyond a singularity, is not found.
    rotation
        (3, 3) platform axes in the base frame.
    stroke
        (2,) least and greatest leg length, or (6, 2) of each leg; default: what a chain states [m].
    sheet
        ``"upper"``: the mean of the platform points above that of the base points (along base z); ``"lower"``: below;
        or ``"both"``.
    spacing
        Distance of the points; default: a sixtieth of the widest extent, where other joints of a chain have limits a
        twentieth [m].
    length
        Length that divides the moments of the Jacobian; default: root mean square distance of the platform points
        from the platform origin [m].
    kernels
        Whether compiled code answers; None: for grids of millions of points, and for platforms on anything but six
        legs wherever the motors alone have limits.
    start
        (3,) platform origin from which a platform on anything but six legs is led; default: that of home [m].

    Returns
    -------
    WorkspaceSamples
        The points, and the volume. Empty, with volume 0, when six legs do not meet anywhere.

    Raises
    ------
    InputError
        If the stroke is empty or not stated, the spacing asks for more than twenty million points (led: two hundred
        thousand), or an argument is for six legs only, or for others.
    UnsupportedError
        If the platform cannot shift without turning.
    ClosureError
        If it does not reach `start` with these axes.
    UnreachableError
        If it does beyond its limits.
    SingularityError
        If it is singular there, as a stretched arm at home.
    """
    rotation = as_rotation("rotation", as_array("rotation", rotation, (3, 3)))
    chain = hexapod if isinstance(hexapod, ClosedChain) else None
    if chain is not None and admission(chain, "leg_lengths").geometry is None:
        if stroke is not None or sheet != "upper":
            raise InputError(f"stroke and sheet are for six legs, which '{chain.name}' has not")
        return _grown(chain, rotation, start, spacing, length, kernels)
    if start is not None:
        raise InputError(
            "start is for platforms on anything but six legs: the workspace of these is found as a whole"
        )
    return _by_legs(hexapod, rotation, stroke, sheet, spacing, length, kernels)


def _by_legs(
    hexapod: Hexapod | ClosedChain,
    rotation: FloatArray,
    stroke: ArrayLike | None,
    sheet: Sheet,
    spacing: float | None,
    length: float | None,
    kernels: bool | None,
) -> WorkspaceSamples:
    """Sample what six legs reach in the box around all that they may."""
    chain = hexapod if isinstance(hexapod, ClosedChain) else None
    if sheet not in ("upper", "lower", "both"):
        raise InputError(f"sheet must be 'upper', 'lower' or 'both', got {sheet!r}")
    joints = chain is not None and _others_limited(chain)
    geometry = Hexapod.from_chain(hexapod) if isinstance(hexapod, ClosedChain) else hexapod
    strokes = _strokes(chain, stroke)
    measured = None
    if chain is not None and leg_form(chain, "leg_lengths") is None:
        measured = ChainLegs(chain, geometry, rotation, strokes)
    radius = float(np.sqrt((geometry.platform_points**2).sum(axis=1).mean())) or 1.0
    length = radius if length is None else as_positive("length", length)
    bounds = _bounds(geometry, rotation, strokes, sheet)
    corner, shape, spacing = _grid(bounds, spacing, sheet, _FEWER if joints or measured else _ACROSS)
    lengths = lengths_at(geometry, rotation, int(np.prod(shape)), kernels)
    if measured is not None:
        lengths = partial(measured.lengths, reach=spacing)
    quality = partial(_quality, geometry, rotation, length, measured)
    samples = _evaluate(quality, lengths, strokes, corner, bounds, shape, spacing, length)
    return _judged(chain, rotation, samples) if chain is not None and joints else samples


def _grid(
    bounds: FloatArray, spacing: float | None, sheet: Sheet, across: int
) -> tuple[FloatArray, tuple[int, ...], float]:
    """Lay cells into a box: their corner, how many there are along each axis, and their sides."""
    extent = bounds[1] - bounds[0]
    if spacing is None:
        spacing = max(float(extent.max()), np.finfo(float).tiny) / across
    spacing = as_positive("spacing", spacing)
    cells = np.ceil(np.maximum(extent, 0.0) / spacing - 1e-9)
    if cells.prod() > _MOST:
        raise InputError(
            f"spacing {spacing:g} m makes {cells.prod():.3g} points in {extent[0]:.3g} x {extent[1]:.3g} x "
            f"{extent[2]:.3g} m; choose at least {(extent.prod() / _MOST) ** (1 / 3):.3g} m"
        )
    # Cells begin at the plane between the sheets, so that none belongs to both.
    corner = bounds[0].copy()
    if sheet == "lower":
        corner[2] = bounds[1, 2] - cells[2] * spacing
    return corner, tuple(int(n) for n in cells), spacing


def _grown(
    chain: ClosedChain,
    rotation: FloatArray,
    start: ArrayLike | None,
    spacing: float | None,
    length: float | None,
    kernels: bool | None,
) -> WorkspaceSamples:
    """Lead the platform of any chain from cell to cell."""
    home = platform_pose(chain, chain.q_home).translation
    begin = np.array(home) if start is None else as_array("start", start, (3,))
    growth = Growth(chain, rotation, begin, kernels=kernels)
    length = chain.length_scale if length is None else as_positive("length", length)
    extent = growth.extent()
    if spacing is None:
        spacing = extent / _FEWER
    spacing = as_positive("spacing", spacing)
    found = growth.cells(spacing, _MOST_LED)
    low = found.index.min(axis=0)
    shape = np.ptp(found.index, axis=0) + 1
    clearance, motor, end = _motor_clearance(chain, found.motors, length)
    condition, sign = _motor_quality(chain, found, length)
    position = growth.start + spacing * found.index
    filled = np.zeros(shape, dtype=bool)
    filled[tuple((found.index - low)[found.inside].T)] = True
    kept = position[found.inside]
    cell = spacing**3
    return WorkspaceSamples(
        position=position,
        inside=found.inside,
        clearance=clearance,
        limiting_leg=motor,
        limiting_end=end,
        condition=condition,
        determinant_sign=sign,
        index=found.index - low,
        shape=(int(shape[0]), int(shape[1]), int(shape[2])),
        spacing=spacing,
        bounds=np.array([kept.min(axis=0), kept.max(axis=0)]) + spacing * np.array([[-1.0], [1.0]]),
        volume=float(np.count_nonzero(found.inside) * cell),
        volume_error=float(np.sqrt(1.5 * _cut(filled) / 6.0) * cell),
        volume_bounds=(0.0, float("inf")),
        pieces=_pieces(filled),
        length=length,
        limits=chain.motors,
    )


def _arms(chain: ClosedChain, length: float) -> FloatArray:
    """Tell what makes lengths of the motors' coordinates: 1 of a slide, a length of a hinge [1 or m]."""
    kinds = [chain.mechanism.joint(name).kind for name in chain.motors]
    return np.array([length if kind is JointKind.REVOLUTE else 1.0 for kind in kinds])


def _motor_clearance(
    chain: ClosedChain, read: FloatArray, length: float
) -> tuple[FloatArray, np.ndarray, np.ndarray]:
    """Least distance of a motor from a limit, the motor, and the end of its range; angles times a length."""
    bounds = chain.limits.bounds("position", chain.motor_index)
    sizes = _arms(chain, length)
    ends = np.concatenate([read - bounds[:, 0], bounds[:, 1] - read], axis=1) * np.tile(sizes, 2)
    worst = ends.argmin(axis=1)
    least = np.take_along_axis(ends, worst[:, None], axis=1)[:, 0]
    return least, worst % chain.nu, np.where(worst < chain.nu, -1, 1)


def _motor_quality(chain: ClosedChain, found: GrownCells, length: float) -> tuple[FloatArray, np.ndarray]:
    """Condition number of the motors' rates per motion of the platform, and the sign of their determinant."""
    jacobian = found.jacobian * _arms(chain, length)[:, None]
    # Per motion of size one, whichever axes tell it: a platform of few freedoms moves along others as well.
    twists = found.twists * np.repeat([1.0, length], 3)[:, None]
    singular = np.linalg.svd(jacobian @ np.linalg.pinv(twists), compute_uv=False)[:, : len(found.axes)]
    regular = singular[:, -1] > _NOISE * singular[:, 0]
    condition = np.divide(singular[:, 0], singular[:, -1], out=np.full(len(singular), np.inf), where=regular)
    jacobian = jacobian / np.repeat([1.0, length], 3)[found.axes]
    if jacobian.shape[1] != jacobian.shape[2]:  # spare motors: no determinant
        return condition, regular.astype(int)
    determinant = np.linalg.det(jacobian)
    return condition, np.where(np.abs(determinant) < _SINGULAR, 0, np.sign(determinant)).astype(int)


def _strokes(chain: ClosedChain | None, stroke: ArrayLike | None) -> FloatArray:
    """Least and greatest length of each leg (6, 2) [m]."""
    if stroke is not None:
        strokes = np.asarray(stroke, dtype=float)
        strokes = np.broadcast_to(as_array("stroke", stroke, (6, 2) if strokes.ndim == 2 else (2,)), (6, 2))
    elif chain is not None:
        sign, offset = chain.leg_readings
        ends = offset[:, None] + sign[:, None] * chain.limits.bounds("position", chain.motor_index)
        strokes = np.sort(ends, axis=1)
        strokes[:, 0] = np.maximum(strokes[:, 0], 0.0)
        if not np.isfinite(strokes).all():
            endless = chain.motors[int(np.argmax(~np.isfinite(strokes).all(axis=1)))]
            raise InputError(
                f"motor '{endless}' of '{chain.name}' states no stroke; pass stroke=(least, greatest)"
            )
    else:
        raise InputError("stroke must be (least, greatest) leg length: points alone state none")
    for low, high in strokes:
        if not 0 <= low < high:
            raise InputError(
                f"stroke must be (least, greatest) leg length with 0 <= least < greatest, got ({low:g}, {high:g})"
            )
    return strokes


def _others_limited(chain: ClosedChain) -> bool:
    return bool(np.setdiff1d(chain.limits.stated("position"), chain.motor_index).size)


def _judged(chain: ClosedChain, rotation: FloatArray, samples: WorkspaceSamples) -> WorkspaceSamples:
    """Leave out the points at which other joints than the motors are beyond their limits."""
    inside = samples.inside.copy()
    before, guess = None, None
    for k in np.flatnonzero(inside):
        here = samples.index[k]
        if before is None or np.abs(here - before).max() > 1:
            guess = None
        pose = pin.SE3(rotation, samples.position[k])
        closure = inverse_kinematics(chain, pose, q_guess=guess, limits=False, throw=False)
        own = closure.success and not [
            excess for excess in chain.judge.positions(closure.q) if excess.joint not in chain.motors
        ]
        inside[k] = own
        before, guess = (here, closure.q) if closure.success else (None, None)
    filled = np.zeros(samples.shape, dtype=bool)
    filled[tuple(samples.index[inside].T)] = True
    return replace(
        samples,
        inside=inside,
        volume=float(np.count_nonzero(inside) * samples.spacing**3),
        volume_error=float(np.sqrt(1.5 * _cut(filled) / 6.0) * samples.spacing**3),
        volume_bounds=(0.0, samples.volume_bounds[1]),
        pieces=_pieces(filled),
    )


def _cut(filled: np.ndarray) -> int:
    """Cells on either side of the boundary, about as many as it cuts."""
    return int(np.count_nonzero(filled & np.logical_not(ndimage.binary_erosion(filled))))


def _evaluate(
    quality: Callable[[FloatArray], tuple[FloatArray, np.ndarray]],
    lengths: Callable[[FloatArray], FloatArray],
    stroke: FloatArray,
    start: FloatArray,
    bounds: FloatArray,
    shape: tuple[int, ...],
    spacing: float,
    length: float,
) -> WorkspaceSamples:
    reach = spacing * np.sqrt(3.0) / 2
    kept: list[tuple[np.ndarray, ...]] = []
    total = int(np.prod(shape))
    for first in range(0, total, _CHUNK):
        index = np.stack(np.unravel_index(np.arange(first, min(first + _CHUNK, total)), shape), axis=-1)
        clearance, leg, end = _clearance(lengths(start + (index + 0.5) * spacing), stroke)
        near = clearance > -reach
        kept.append((index[near], clearance[near], leg[near], end[near]))
    if not kept:
        kept.append(
            (np.zeros((0, 3), dtype=int), np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
        )
    index, clearance, leg, end = (np.concatenate(part) for part in zip(*kept, strict=True))
    position = start + (index + 0.5) * spacing
    inside = clearance >= 0.0
    condition, sign = quality(position)
    filled = np.zeros(shape, dtype=bool)
    filled[tuple(index[inside].T)] = True
    cell = spacing**3
    # As many cells are cut by the boundary as 1.5 times those whose centre is within half a cell of it (the mean of
    # |n_x| + |n_y| + |n_z|); one random point in a cut cell is inside or not with variance p (1 - p), 1/6 on average.
    cut = 1.5 * np.count_nonzero(np.abs(clearance) < spacing / 2)
    return WorkspaceSamples(
        position=position,
        inside=inside,
        clearance=clearance,
        limiting_leg=leg,
        limiting_end=end,
        condition=condition,
        determinant_sign=sign,
        index=index,
        shape=(shape[0], shape[1], shape[2]),
        spacing=spacing,
        bounds=bounds,
        volume=float(np.count_nonzero(inside) * cell),
        volume_error=float(np.sqrt(cut / 6.0) * cell),
        volume_bounds=(float(np.count_nonzero(clearance >= reach) * cell), float(len(index) * cell)),
        pieces=_pieces(filled),
        length=length,
    )


def _pieces(filled: np.ndarray) -> int:
    labels = np.zeros(filled.shape, dtype=np.int32)
    ndimage.label(filled, structure=np.ones((3, 3, 3)), output=labels)
    sizes = np.bincount(labels.ravel())[1:]
    return int(np.count_nonzero(sizes >= 0.01 * sizes.sum()))


def _bounds(hexapod: Hexapod, rotation: FloatArray, stroke: FloatArray, sheet: Sheet) -> FloatArray:
    """Box around the workspace: what the outer spheres have in common, less the cells that are certainly empty."""
    centres = hexapod.base_points - hexapod.platform_points @ rotation.T
    box = np.array([(centres - stroke[:, 1:]).max(axis=0), (centres + stroke[:, 1:]).min(axis=0)])
    between = float(centres[:, 2].mean())
    if sheet == "upper":
        box[0, 2] = max(box[0, 2], between)
    elif sheet == "lower":
        box[1, 2] = min(box[1, 2], between)
    nothing = np.array([centres.mean(axis=0)] * 2)
    for _ in range(3):
        if (box[0] >= box[1]).any():
            return nothing
        side = (box[1] - box[0]) / _COARSE
        index = np.stack(np.meshgrid(*[np.arange(_COARSE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        lengths = leg_lengths(hexapod, box[0] + (index + 0.5) * side, rotation)
        clearance, _, _ = _clearance(lengths, stroke)
        left = index[clearance > -np.linalg.norm(side) / 2]
        if not len(left):
            return nothing
        box = np.array([box[0] + left.min(axis=0) * side, box[0] + (left.max(axis=0) + 1) * side])
    return box


def _clearance(lengths: FloatArray, stroke: FloatArray) -> tuple[FloatArray, np.ndarray, np.ndarray]:
    """Least distance of a leg length from a limit, the leg, and the end of its stroke."""
    ends = np.concatenate([lengths - stroke[:, 0], stroke[:, 1] - lengths], axis=-1)
    worst = ends.argmin(axis=-1)
    clearance = np.take_along_axis(ends, worst[:, None], axis=-1)[:, 0]
    return clearance, worst % 6, np.where(worst < 6, -1, 1)


def _quality(
    hexapod: Hexapod, rotation: FloatArray, length: float, measured: ChainLegs | None, position: FloatArray
) -> tuple[FloatArray, np.ndarray]:
    """Condition number of the normalised leg Jacobian, and the sign of its determinant."""
    condition, sign = np.empty(len(position)), np.empty(len(position), dtype=int)
    for first in range(0, len(position), _CHUNK):
        part = slice(first, first + _CHUNK)
        legs, arms = leg_vectors(hexapod, position[part], rotation)
        size = np.linalg.norm(legs, axis=-1, keepdims=True)
        # A leg without length has no direction; its row of zeros makes the point singular.
        u = legs / np.where(size == 0.0, 1.0, size)
        jacobian = np.concatenate([u, np.cross(arms, u) / length], axis=-1)
        if measured is not None:
            jacobian = measured.jacobian(position[part]) / np.repeat([1.0, length], 3)
        singular = np.linalg.svd(jacobian, compute_uv=False)
        regular = singular[:, -1] > _NOISE * singular[:, 0]
        condition[part] = np.divide(
            singular[:, 0], singular[:, -1], out=np.full(len(legs), np.inf), where=regular
        )
        determinant = np.linalg.det(jacobian)
        sign[part] = np.where(np.abs(determinant) < _SINGULAR, 0, np.sign(determinant))
    return condition, sign
