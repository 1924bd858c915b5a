"""Equality constraints of MuJoCo's compiled model as loops and couplings; two that make one joint become one loop.

References
----------
.. [1] MuJoCo documentation, "XML reference: equality" and "Computation: constraint model".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Coupling, JointKind, Loop, Note, Outcome
from stewart_pin.model.formats.mjcf.bodies import placement_of
from stewart_pin.model.formats.mjcf.compiling import Names, given_names, import_mujoco
from stewart_pin.model.formats.mjcf.tree import Tree
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Ties:
    """What the equality constraints tie together.

    Attributes
    ----------
    loops, couplings
        In the order of the file.
    notes
        What was made of them.
    """

    loops: tuple[Loop, ...]
    couplings: tuple[Coupling, ...]
    notes: tuple[Note, ...]


def read_ties(model: Any, tree: Tree, *, source: str) -> Ties:
    """Turn equality constraints into loops and couplings.

    A ``connect`` is a spherical loop, a ``weld`` a fixed one, ``joint`` a coupling. A ``tendon`` equality is a loop
    of constant distance where the tendon runs straight between two sites, and a coupling where it is a sum of joints,
    or stands in proportion to another sum.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    tree
        Its links and joints.
    source
        The file, for messages.

    Returns
    -------
    Ties
        Rigid loops, where MuJoCo has soft ones; several that make one revolute or universal joint are merged.

    Raises
    ------
    FileFormatError
        If a constraint is of a kind that has no counterpart; names it.
    """
    return _TieReader(model, tree, source).read()


class _TieReader:
    def __init__(self, model: Any, tree: Tree, source: str) -> None:
        self.model, self.tree, self.source = model, tree, source
        mujoco = import_mujoco()
        self.kinds, self.objects, self.wraps = mujoco.mjtEq, mujoco.mjtObj, mujoco.mjtWrap
        off = mujoco.mjtDisableBit
        self.disabled = bool(model.opt.disableflags & (off.mjDSBL_EQUALITY | off.mjDSBL_CONSTRAINT))
        given = given_names(model, "equality", model.neq)
        names = Names(given)
        words = [self._word(k) for k in range(model.neq)]
        self.names = [name or names.fresh(f"{words[k]}_{k + 1}") for k, name in enumerate(given)]
        self.words = words
        self.loops: list[Loop] = []
        self.couplings: list[Coupling] = []
        self.notes: list[Note] = []

    def read(self) -> Ties:
        for k in range(self.model.neq):
            if self.disabled or not self.model.eq_active0[k]:
                why = "the file disables all equality constraints" if self.disabled else "it is not active"
                self._note(k, f"left out: {why}")
                continue
            match self.words[k]:
                case "connect":
                    self._connect(k)
                case "weld":
                    self._weld(k)
                case "joint":
                    self._joint(k)
                case "tendon":
                    self._tendon(k)
                case word:
                    raise self._error(
                        k, f"equality constraints of kind '{word}' have no counterpart; remove it"
                    )
        loops, merged = merge_loops(self.loops)
        self.notes += merged
        if self.loops or self.couplings:
            soft = "solref, solimp: loops and couplings are rigid here, and soft in MuJoCo"
            self.notes.append(Note("<equality>", soft))
        return Ties(loops, tuple(self.couplings), tuple(self.notes))

    def _word(self, k: int) -> str:
        kind = self.kinds(int(self.model.eq_type[k]))
        return kind.name.removeprefix("mjEQ_").lower()

    def _connect(self, k: int) -> None:
        if self.model.eq_objtype[k] == self.objects.mjOBJ_SITE:
            self._add(k, JointKind.SPHERICAL, self._site(k, 1), self._site(k, 2))
            return
        data = self.model.eq_data[k]
        end1, end2 = ((self._body(k, end), _point(data[3 * end - 3 : 3 * end])) for end in (1, 2))
        self._add(k, JointKind.SPHERICAL, end1, end2)

    def _weld(self, k: int) -> None:
        data = self.model.eq_data[k]
        if self.model.eq_objtype[k] == self.objects.mjOBJ_SITE:
            end1, end2 = self._site(k, 1), self._site(k, 2)
        else:
            # Body 2, shifted to the anchor, stands at the relative pose in body 1.
            end1 = self._body(k, 1), placement_of(data[3:6], data[6:10])
            end2 = self._body(k, 2), _point(data[0:3])
        scale = float(data[10])
        if scale == 0:
            self._note(k, "torquescale 0: a weld that holds no moment is a spherical loop", Outcome.CHANGED)
        elif scale != 1:
            self._note(k, f"torquescale {scale:g}: loops are rigid, whatever their softness in MuJoCo")
        self._add(k, JointKind.FIXED if scale else JointKind.SPHERICAL, end1, end2)

    def _joint(self, k: int) -> None:
        model = self.model
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        coefficients = np.array(model.eq_data[k][:5])
        if second < 0:
            coefficients[1:] = 0.0
        else:
            # MuJoCo: y - y0 = poly(x - x0), counted from the configuration of the file.
            coefficients = moved_polynomial(coefficients, self._reference(second))
        coefficients[0] += self._reference(first)
        joint2 = self.tree.joint_names[second] if second >= 0 else None
        self._couple(k, self.tree.joint_names[first], joint2, coefficients)

    def _tendon(self, k: int) -> None:
        model = self.model
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        start, count = int(model.tendon_adr[first]), int(model.tendon_num[first])
        parts = range(start, start + count)
        kinds = {int(model.wrap_type[part]) for part in parts}
        # MuJoCo: length - (length at zero joint values) = first coefficient, where no second tendon says otherwise.
        constant = float(model.eq_data[k][0]) + float(model.tendon_length0[first])
        if second < 0 and kinds == {int(self.wraps.mjWRAP_SITE)} and count == 2:
            end1, end2 = (self._at_site(int(model.wrap_objid[part])) for part in parts)
            self._add(k, JointKind.DISTANCE, end1, end2, length=constant)
            return
        terms = sum_of_joints(model, first)
        if second >= 0:
            # Length 1 - that at zero = c0 + c1 (length 2 - that at zero).
            slope = float(model.eq_data[k][1])
            constant -= slope * float(model.tendon_length0[second])
            more = sum_of_joints(model, second)
            terms = _difference(terms, more, slope) if not model.eq_data[k][2:5].any() else None
        if terms is None:
            raise self._error(
                k,
                "of tendons, only a straight one between two sites (a rod) and sums of joints (gears) can be kept, two "
                "of them in proportion; remove it, or write <connect>, <weld> or <joint>",
            )
        self._sum(k, terms, constant)

    def _sum(self, k: int, factors: dict[int, float], constant: float) -> None:
        """Couple joints by c1 q1 + c2 q2 + ... = constant."""
        terms = [(self.tree.joint_names[joint], factor) for joint, factor in factors.items() if factor != 0]
        if not terms:
            raise self._error(k, "the tendon has no joint with a coefficient; remove it")
        (joint1, factor1), *others = terms
        if not others:
            self._couple(k, joint1, None, np.array([constant / factor1]))
            return
        (joint2, factor2), *rest = others
        ratios = tuple((name, -factor / factor1) for name, factor in rest)
        self._couple(k, joint1, joint2, np.array([constant, -factor2]) / factor1, ratios)

    def _couple(
        self,
        k: int,
        joint1: str,
        joint2: str | None,
        coefficients: FloatArray,
        others: tuple[tuple[str, float], ...] = (),
    ) -> None:
        size = int(np.max(np.flatnonzero(coefficients), initial=0)) + 1
        polynomial = tuple(float(value) for value in coefficients[:size])
        self.couplings.append(Coupling(self.names[k], joint1, joint2, polynomial, others))

    def _add(
        self,
        k: int,
        kind: JointKind,
        end1: tuple[str, pin.SE3],
        end2: tuple[str, pin.SE3],
        length: float = 0.0,
    ) -> None:
        (link1, placement1), (link2, placement2) = end1, end2
        self.loops.append(Loop(self.names[k], kind, link1, link2, placement1, placement2, length=length))

    def _reference(self, joint: int) -> float:
        return float(self.model.qpos0[self.model.jnt_qposadr[joint]])

    def _body(self, k: int, end: int) -> str:
        return self.tree.bodies[int((self.model.eq_obj1id if end == 1 else self.model.eq_obj2id)[k])]

    def _site(self, k: int, end: int) -> tuple[str, pin.SE3]:
        return self._at_site(int((self.model.eq_obj1id if end == 1 else self.model.eq_obj2id)[k]))

    def _at_site(self, site: int) -> tuple[str, pin.SE3]:
        placement = placement_of(self.model.site_pos[site], self.model.site_quat[site])
        return self.tree.bodies[int(self.model.site_bodyid[site])], placement

    def _note(self, k: int, text: str, outcome: Outcome = Outcome.IGNORED) -> None:
        self.notes.append(Note(f"{self.words[k]} '{self.names[k]}'", text, outcome))

    def _error(self, k: int, text: str) -> FileFormatError:
        name = self.names[k]
        return FileFormatError(
            f"<equality> <{self.words[k]}> '{name}': {text}", path=self.source, culprit=name
        )


def _difference(
    terms: dict[int, float] | None, others: dict[int, float] | None, slope: float
) -> dict[int, float] | None:
    """Subtract one sum of joints, times a slope, from another, where both are sums."""
    if terms is None or others is None:
        return None
    joints = dict.fromkeys((*terms, *others))
    return {joint: terms.get(joint, 0.0) - slope * others.get(joint, 0.0) for joint in joints}


def sum_of_joints(model: Any, tendon: int) -> dict[int, float] | None:
    """Read a tendon that is a sum of joints.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    tendon
        Its number.

    Returns
    -------
    dict or None
        Factor of each joint in its length, by the joint's number [m or rad per m or rad]; None for another tendon.
    """
    start, factors = int(model.tendon_adr[tendon]), dict[int, float]()
    for part in range(start, start + int(model.tendon_num[tendon])):
        if int(model.wrap_type[part]) != int(import_mujoco().mjtWrap.mjWRAP_JOINT):
            return None
        joint = int(model.wrap_objid[part])
        factors[joint] = factors.get(joint, 0.0) + float(model.wrap_prm[part])
    return factors


def moved_polynomial(coefficients: FloatArray, origin: float) -> FloatArray:
    """Expand a polynomial in x - origin in powers of x.

    Parameters
    ----------
    coefficients
        (n,) coefficients of the powers of x - origin, the constant one first [any unit per power of m or rad].
    origin
        Where the powers are counted from [m or rad].

    Returns
    -------
    numpy.ndarray
        (n,) coefficients of the powers of x, in the same units.
    """
    if origin == 0:
        return coefficients
    # Horner's scheme: exact where the coefficients and the origin are.
    expanded = np.zeros(1)
    for coefficient in coefficients[::-1]:
        expanded = np.append(0.0, expanded) - origin * np.append(expanded, 0.0)
        expanded[0] += coefficient
    return expanded[: len(coefficients)]


def _point(position: Sequence[float] | FloatArray) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array(position, dtype=float))


# ----------------------------------------------------------------------------------------------------
# Loops that make one joint together: MJCF writes a hinge as two points, a universal joint as a point and a rod
# ----------------------------------------------------------------------------------------------------

_SAME_LENGTH = 1e-9
"""How far two lengths may differ, relative to their size, and count as equal."""
_ROUNDED = 1e-4
"""The same for the two points of a hinge, printed with few digits: rigid links could not meet in both otherwise."""
_Z = np.array([0.0, 0.0, 1.0])


def merge_loops(loops: Sequence[Loop]) -> tuple[tuple[Loop, ...], list[Note]]:
    """Merge loops between the same two links where they allow exactly the motions of one joint.

    Two spherical loops whose points are equally far apart on both links hold the line through them: a revolute loop,
    with five rows where the two have six of rank five. Lengths that differ by their printed digits count as equal: as
    two loops, rigid links would never close. A spherical loop and a rod between points that stand square
    above its centre keep two directions perpendicular: a universal loop.

    Parameters
    ----------
    loops
        All loops of a file.

    Returns
    -------
    loops : tuple of Loop
        In the order of the file; a merged loop bears the name and place of its first.
    notes : list of Note
        What was merged.
    """
    merged, notes = list(loops), []
    for first in loops:
        if first.kind is not JointKind.SPHERICAL or first not in merged:
            continue
        for second in loops:
            if second is first or second not in merged:
                continue
            joined, misfit = _join(first, second)
            if joined is not None:
                merged[merged.index(first)] = joined
                merged.remove(second)
                rounded = f"; its points are {misfit:.3g} m farther apart on one link" if misfit else ""
                text = f"one {joined.kind} loop together with '{second.name}'{rounded}"
                notes.append(Note(f"loop '{first.name}'", text, Outcome.CHANGED))
                break
    return tuple(merged), notes


def _join(first: Loop, second: Loop) -> tuple[Loop | None, float]:
    """Merge two loops if they make one joint; tell by how much the points of a hinge miss each other [m]."""
    if {first.link1, first.link2} != {second.link1, second.link2}:
        return None, 0.0
    ends = [second.placement1.translation, second.placement2.translation]
    if second.link1 != first.link1:
        ends.reverse()
    arm1, arm2 = ends[0] - first.placement1.translation, ends[1] - first.placement2.translation
    length1, length2 = float(np.linalg.norm(arm1)), float(np.linalg.norm(arm2))
    size = max(length1, length2)
    far = max(float(np.linalg.norm(end)) for end in ends)
    if min(length1, length2) <= _ROUNDED * far:
        return None, 0.0
    misfit = abs(length1 - length2)
    if second.kind is JointKind.SPHERICAL and misfit <= _ROUNDED * size:
        hinge = _hinge(first, arm1 / length1, arm2 / length2)
        return hinge, misfit if misfit > _SAME_LENGTH * size else 0.0
    # Pythagoras: the rod spans the hypotenuse while the arms stand square.
    excess = second.length**2 - length1**2 - length2**2
    if second.kind is JointKind.DISTANCE and abs(excess) <= _SAME_LENGTH * second.length**2:
        return _cross(first, arm1 / length1, arm2 / length2), 0.0
    return None, 0.0


def _hinge(loop: Loop, axis1: FloatArray, axis2: FloatArray) -> Loop:
    """Turn the loop's frames so that z is the shared axis."""
    return replace(
        loop,
        kind=JointKind.REVOLUTE,
        placement1=pin.SE3(_frame_along(axis1), loop.placement1.translation),
        placement2=pin.SE3(_frame_along(axis2), loop.placement2.translation),
        axis=_Z,
    )


def _cross(loop: Loop, axis1: FloatArray, axis2: FloatArray) -> Loop:
    return replace(
        loop,
        kind=JointKind.UNIVERSAL,
        axis=loop.placement1.rotation.T @ axis1,
        axis2=loop.placement2.rotation.T @ axis2,
    )


def _frame_along(axis: FloatArray) -> FloatArray:
    n, x, y = orthonormal_triad(axis)
    return np.column_stack([x, y, n])
