"""Loops and couplings as arrays: where each sits on the Pinocchio tree, and the rows sorted by primitive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.polynomial.polynomial import polyder, polyval

from stewart_pin.model.description import Loop, Mechanism
from stewart_pin.model.loop_rows import AngleRow, LengthRow, NormalRow, Row, closure_rows, orthonormal_triad
from stewart_pin.model.tree import link_frame
from stewart_pin.typing import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Rows of one primitive.

    Attributes
    ----------
    index
        (r,) index of each row among all loop rows.
    loop
        (r,) index of the loop of each row.
    vector1
        (r, 3) unit vectors normal or u1 in loop frame 1; of length rows the swivel axis of a pulley.
    vector2
        (r, 3) unit vectors u2 in loop frame 2; unused by normal and length rows.
    length
        (r,) distance between the frame origins, or length of a cable [m], used by length rows.
    radius
        (r,) radius of the pulley [m], likewise.
    """

    index: np.ndarray
    loop: np.ndarray
    vector1: FloatArray
    vector2: FloatArray
    length: FloatArray
    radius: FloatArray


@dataclass(frozen=True, eq=False)
class ReelRows:
    """What reels add to the rows of their cables: ``ratio * q``.

    Attributes
    ----------
    index
        (r,) index of the cable's row among all loop rows.
    q, v
        (r,) indices of the reel in configuration and tangent.
    ratio
        (r,) cable that is wound in per unit of the reel [m per m or rad].
    """

    index: np.ndarray
    q: np.ndarray
    v: np.ndarray
    ratio: FloatArray


@dataclass(frozen=True, eq=False)
class CouplingRows:
    """Rows ``q1 - p(q2) - r q = 0``, one per coupling.

    Attributes
    ----------
    index
        (r,) index of each row among all loop rows.
    q1, q2
        (r,) indices of the joints in the configuration; q2 is -1 where there is no second joint.
    v1, v2
        (r,) indices of the joints in the tangent, likewise.
    polynomial
        (r, n) coefficients of p from the constant one on, padded with zeros [unit of joint 1 per power of that of 2].
    ratios_q
        (r, nq) ratios of the joints that are followed besides, in the configuration [unit of joint 1 per unit of each].
    ratios_v
        (r, nv) the same in the tangent [unit of joint 1 per unit of each].
    """

    index: np.ndarray
    q1: np.ndarray
    q2: np.ndarray
    v1: np.ndarray
    v2: np.ndarray
    polynomial: FloatArray
    ratios_q: FloatArray
    ratios_v: FloatArray

    def evaluate(self, q: FloatArray, order: int) -> FloatArray:
        """Evaluate the polynomials or a derivative of theirs.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        order
            0 for the values, 1 for the slopes, 2 for their rates.

        Returns
        -------
        numpy.ndarray
            (r,) where joint 1 should stand, or the derivative with respect to joint 2 [m or rad per power].
        """
        x = np.where(self.q2 >= 0, q[self.q2], 0.0) if self.index.size else np.zeros(0)
        slopes = polyder(self.polynomial, order, axis=1) if order else self.polynomial
        return polyval(x, slopes.T, tensor=False)


@dataclass(frozen=True, eq=False)
class LoopTable:
    """All loops and couplings of a chain; the rows of the couplings come last.

    Attributes
    ----------
    size
        Number of rows.
    names
        Readable name of every row.
    slices
        Rows of each loop.
    joint1, joint2
        (L,) Pinocchio joint ids that carry frames 1 and 2, as integers of Python.
    at1, at2
        (L,) indices of these joints, as arrays.
    carriers
        (K,) index of the joint that carries each of `carried`.
    carried
        (K, 3, 1) what the joints carry, in their frames: origins of frames 1, origins of frames 2 [m], then normals, u1
        and u2 of the rows, unit vectors.
    split
        Where in these the origins of frames 2, the normals, u1 and u2 begin.
    rotation1, rotation2
        (L, 3, 3) loop frames in their joints.
    translation1, translation2
        (L, 3) loop frames in their joints [m].
    supports
        (2 L, nv) 1 where a tangent entry moves frame 1, then the same of frames 2, else 0; dimensionless.
    difference
        (L, nv) the second less the first, dimensionless: 0 where a tangent entry moves both frames or neither.
    row_difference
        (nc, nv) the same for every row, of its loop; 0 for couplings; dimensionless.
    row_loop
        (nc,) index of the loop of every row; 0 for couplings.
    only_normals
        Whether all rows are normal ones, in their order.
    aligned
        (n,) index of the loop that holds directions of its frames together, one entry per direction.
    directions
        (n, 3) these directions in either frame, unit vectors.
    normal, angle, rod
        Rows of loops by primitive.
    reel
        What reels add to the rows of cables.
    coupling
        Rows of couplings.
    """

    size: int
    names: tuple[str, ...]
    slices: tuple[slice, ...]
    joint1: tuple[int, ...]
    joint2: tuple[int, ...]
    at1: np.ndarray
    at2: np.ndarray
    carriers: np.ndarray
    carried: FloatArray
    split: tuple[int, int, int, int]
    rotation1: FloatArray
    rotation2: FloatArray
    translation1: FloatArray
    translation2: FloatArray
    supports: FloatArray
    difference: FloatArray
    row_difference: FloatArray
    row_loop: np.ndarray
    only_normals: bool
    aligned: np.ndarray
    directions: FloatArray
    normal: RowGroup
    angle: RowGroup
    rod: RowGroup
    reel: ReelRows
    coupling: CouplingRows


def build_loop_table(mechanism: Mechanism, model: pin.Model) -> LoopTable:
    """Tabulate the loops of a mechanism on its Pinocchio tree.

    Parameters
    ----------
    mechanism
        Description with the loops.
    model
        Tree built from it.

    Returns
    -------
    LoopTable
        The loops as arrays.
    """
    loops = mechanism.loops
    first = _ends(model, [(loop.link1, loop.placement1) for loop in loops])
    second = _ends(model, [(loop.link2, loop.placement2) for loop in loops])
    names, slices, groups = _rows(loops)
    first_coupling = len(names)
    names += [coupling.name for coupling in mechanism.couplings]
    owner = np.full(len(names), -1)
    for number, rows_of_loop in enumerate(slices):
        owner[rows_of_loop] = number
    normal, angle = _group(groups[NormalRow]), _group(groups[AngleRow])
    carried = [
        first.translation,
        second.translation,
        (first.rotation[normal.loop] @ normal.vector1[:, :, None])[:, :, 0],
        (first.rotation[angle.loop] @ angle.vector1[:, :, None])[:, :, 0],
        (second.rotation[angle.loop] @ angle.vector2[:, :, None])[:, :, 0],
    ]
    split = np.cumsum([len(part) for part in carried])[:4].tolist()
    aligned, directions = _aligned(loops)
    difference = second.supports - first.supports
    return LoopTable(
        size=len(names),
        names=tuple(names),
        slices=tuple(slices),
        joint1=tuple(first.joint.tolist()),
        joint2=tuple(second.joint.tolist()),
        rotation1=first.rotation,
        rotation2=second.rotation,
        translation1=first.translation,
        translation2=second.translation,
        at1=first.joint,
        at2=second.joint,
        carriers=np.concatenate(
            [
                first.joint,
                second.joint,
                first.joint[normal.loop],
                first.joint[angle.loop],
                second.joint[angle.loop],
            ]
        ),
        carried=np.concatenate(carried)[:, :, None],
        split=(split[0], split[1], split[2], split[3]),
        supports=np.concatenate([first.supports, second.supports]),
        aligned=aligned,
        directions=directions,
        row_difference=np.vstack([difference, np.zeros((1, model.nv))])[owner],
        row_loop=np.maximum(owner, 0),
        only_normals=len(normal.index) == len(names),
        difference=difference,
        normal=normal,
        angle=angle,
        rod=_group(groups[LengthRow]),
        reel=_reels(groups[LengthRow], model),
        coupling=_couplings(mechanism, model, first_coupling),
    )


@dataclass(frozen=True, eq=False)
class _Ends:
    """One side of all loops: (L,) joints, (L, 3, 3), (L, 3) frames in them, (L, nv) tangent entries that move them."""

    joint: np.ndarray
    rotation: FloatArray
    translation: FloatArray
    supports: FloatArray


def _ends(model: pin.Model, frames: Sequence[tuple[str, pin.SE3]]) -> _Ends:
    """Place frames of links in the joints that carry them."""
    carriers = [model.frames[link_frame(model, link)] for link, _ in frames]
    placed = [carrier.placement * at for carrier, (_, at) in zip(carriers, frames, strict=True)]
    joints = [carrier.parentJoint for carrier in carriers]
    return _Ends(
        joint=np.array(joints, dtype=int),
        rotation=np.array([at.rotation for at in placed]).reshape(-1, 3, 3),
        translation=np.array([at.translation for at in placed]).reshape(-1, 3),
        supports=np.array([support(model, joint) for joint in joints]).reshape(-1, model.nv),
    )


_Entry = tuple[int, int, Row]
"""A row, its index among all and that of its loop."""


def _rows(loops: Sequence[Loop]) -> tuple[list[str], list[slice], dict[type, list[_Entry]]]:
    """List the rows of loops: their names, which are whose, and the rows by kind."""
    names: list[str] = []
    slices: list[slice] = []
    groups: dict[type, list[_Entry]] = {NormalRow: [], AngleRow: [], LengthRow: []}
    for number, loop in enumerate(loops):
        start = len(names)
        for k, row in enumerate(closure_rows(loop)):
            groups[type(row)].append((start + k, number, row))
            names.append(f"{loop.name} row {k + 1}")
        slices.append(slice(start, len(names)))
    return names, slices, groups


_HELD = (0, 0, 1, 3)
"""Directions that are held together by as many angle rows: two hold the axis, three all."""


def _angles(loop: Loop) -> int:
    """Count the angle rows of a loop."""
    return sum(isinstance(row, AngleRow) for row in closure_rows(loop))


def _aligned(loops: Sequence[Loop]) -> tuple[np.ndarray, FloatArray]:
    """Directions that loops hold together, and the loop of each."""
    held = [
        (number, direction)
        for number, loop in enumerate(loops)
        for direction in orthonormal_triad(loop.axis)[: _HELD[_angles(loop)]]
    ]
    numbers = np.array([number for number, _ in held], dtype=int)
    return numbers, np.array([direction for _, direction in held], dtype=float).reshape(-1, 3)


def _reels(entries: Sequence[_Entry], model: pin.Model) -> ReelRows:
    wound = [
        (index, model.joints[model.getJointId(row.cable.reel)], row.cable.ratio)
        for index, _, row in entries
        if isinstance(row, LengthRow) and row.cable.reel is not None
    ]
    return ReelRows(
        index=np.array([index for index, _, _ in wound], dtype=int),
        q=np.array([joint.idx_q for _, joint, _ in wound], dtype=int),
        v=np.array([joint.idx_v for _, joint, _ in wound], dtype=int),
        ratio=np.array([ratio for _, _, ratio in wound], dtype=float),
    )


def _couplings(mechanism: Mechanism, model: pin.Model, first: int) -> CouplingRows:
    couplings = mechanism.couplings

    def at(name: str | None) -> tuple[int, int]:
        if name is None:
            return -1, -1
        joint = model.joints[model.getJointId(name)]
        return joint.idx_q, joint.idx_v

    ones = np.array([at(c.joint1) for c in couplings], dtype=int).reshape(-1, 2)
    twos = np.array([at(c.joint2) for c in couplings], dtype=int).reshape(-1, 2)
    width = max((len(c.polynomial) for c in couplings), default=1)
    padded = [[*c.polynomial, *[0.0] * (width - len(c.polynomial))] for c in couplings]
    ratios_q, ratios_v = np.zeros((len(couplings), model.nq)), np.zeros((len(couplings), model.nv))
    for k, coupling in enumerate(couplings):
        for name, ratio in coupling.others:
            in_q, in_v = at(name)
            ratios_q[k, in_q], ratios_v[k, in_v] = ratio, ratio
    return CouplingRows(
        index=np.arange(first, first + len(couplings)),
        q1=ones[:, 0],
        q2=twos[:, 0],
        v1=ones[:, 1],
        v2=twos[:, 1],
        polynomial=np.array(padded, dtype=float).reshape(-1, width),
        ratios_q=ratios_q,
        ratios_v=ratios_v,
    )


def support(model: pin.Model, joint: int) -> FloatArray:
    """Mark the tangent entries that move a joint.

    Parameters
    ----------
    model
        Model.
    joint
        Number of the joint.

    Returns
    -------
    numpy.ndarray
        (nv,) of 0 and 1, dimensionless.
    """
    mask = np.zeros(model.nv)
    while joint:
        first = model.joints[joint].idx_v
        mask[first : first + model.joints[joint].nv] = 1.0
        joint = model.parents[joint]
    return mask


def _group(entries: list) -> RowGroup:
    zero = np.zeros(3)
    first = [getattr(row, "normal", getattr(row, "u1", getattr(row, "axis", zero))) for _, _, row in entries]
    return RowGroup(
        index=np.array([index for index, _, _ in entries], dtype=int),
        loop=np.array([loop for _, loop, _ in entries], dtype=int),
        vector1=np.array(first, dtype=float).reshape(-1, 3),
        vector2=np.array([getattr(row, "u2", zero) for _, _, row in entries], dtype=float).reshape(-1, 3),
        length=np.array([getattr(row, "length", 0.0) for _, _, row in entries], dtype=float),
        radius=np.array(
            [row.cable.radius if isinstance(row, LengthRow) else 0.0 for _, _, row in entries], dtype=float
        ),
    )


def independent_groups(table: LoopTable, model: pin.Model) -> list[tuple[BoolArray, BoolArray]]:
    """Sort loops and couplings into sets that share no joint.

    Parameters
    ----------
    table
        Loops and couplings.
    model
        Pinocchio model of the tree.

    Returns
    -------
    list of tuple
        (nc,) rows and (nv,) tangent entries of each set, in the order of their first rows; joints in no loop and no
        coupling are in none.
    """
    touched = table.row_difference != 0
    coupling = table.coupling
    for k, row in enumerate(coupling.index):
        touched[row, [entry for entry in (coupling.v1[k], coupling.v2[k]) if entry >= 0]] = True
        touched[row] |= coupling.ratios_v[k] != 0
    touched[table.reel.index, table.reel.v] = True
    # Entries of one joint move together.
    for joint in model.joints[1:]:
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        touched[:, own] = touched[:, own].any(axis=1, keepdims=True)
    left = np.ones(table.size, dtype=bool)
    groups: list[tuple[BoolArray, BoolArray]] = []
    while left.any():
        rows = np.zeros(table.size, dtype=bool)
        rows[np.argmax(left)] = True
        while True:
            entries = touched[rows].any(axis=0)
            more = touched[:, entries].any(axis=1) | rows
            if (more == rows).all():
                break
            rows = more
        groups.append((rows, entries))
        left &= ~rows
    return groups
