"""What every joint may do, in one record: positions, velocities, accelerations, efforts and jerks, at both ends.

What a file does not state is ``nan``, a value of its own: no comparison with it holds, and no sum hides it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.model.description import BALL, Bounds, JointKind, Mechanism, loop_coordinates
from stewart_pin.typing import BoolArray, FloatArray

LimitKind = Literal["position", "velocity", "acceleration", "effort", "jerk"]
KINDS: tuple[LimitKind, ...] = get_args(LimitKind)
"""What can be limited."""
_UNITS: dict[LimitKind, tuple[str, str]] = {
    "position": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "acceleration": ("m/s²", "rad/s²"),
    "effort": ("N", "N m"),
    "jerk": ("m/s³", "rad/s³"),
}
_AXES = {1: ("",), 3: (" wx", " wy", " wz"), 6: (" vx", " vy", " vz", " wx", " wy", " wz")}


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Brief):
    """Limits of all joints of a chain, those that close loops included; ``nan`` where nothing is stated.

    The first nv rows are the tangent entries of the chain, so that ``chain.motor_index`` picks those of the motors; a
    joint of several freedoms has no position there. Then come the coordinates that only limits know: the swing of a
    ball's axis and the whole angle by which it has turned, and the coordinates of the joints that close loops.

    Attributes
    ----------
    names
        (n,) joint of each row, with the coordinate where a joint has several.
    position
        (n, 2) least and greatest position [m or rad].
    velocity
        (n, 2) least and greatest velocity [m/s or rad/s].
    acceleration
        (n, 2) least and greatest acceleration [m/s² or rad/s²].
    effort
        (n, 2) least and greatest effort of a motor; (0, f) is a cable [N or N m].
    jerk
        (n, 2) least and greatest rate of the acceleration [m/s³ or rad/s³].
    is_length
        (n,) whether a row is a length, in metres, and not an angle [dimensionless].

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> print(chain.limits)
    leg1_x, leg1_y and 10 more: position -1.5 to 1.5 rad
    leg1, leg2 and 4 more: position 0.5 to 1.8 m, velocity -2 to 2 m/s, effort -10000 to 10000 N
    """

    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray
    jerk: FloatArray
    is_length: BoolArray

    def __post_init__(self) -> None:
        for kind in KINDS:
            self.of(kind).setflags(write=False)

    def of(self, kind: LimitKind) -> FloatArray:
        """Return the limits of one kind.

        Parameters
        ----------
        kind
            ``"position"``, ``"velocity"``, ``"acceleration"``, ``"effort"`` or ``"jerk"``.

        Returns
        -------
        numpy.ndarray
            (n, 2) least and greatest, nan where nothing is stated [any unit].
        """
        return getattr(self, kind)

    def bounds(self, kind: LimitKind, rows: np.ndarray | slice = slice(None)) -> FloatArray:
        """Return limits to reckon with: infinite where nothing is stated.

        Parameters
        ----------
        kind
            What is limited.
        rows
            Which rows; default: all [index].

        Returns
        -------
        numpy.ndarray
            (k, 2) least and greatest [any unit].
        """
        found = self.of(kind)[rows]
        return np.where(np.isnan(found), [-np.inf, np.inf], found)

    def stated(self, kind: LimitKind) -> np.ndarray:
        """List the rows that have a limit of one kind, at one end at least.

        Parameters
        ----------
        kind
            What is limited.

        Returns
        -------
        numpy.ndarray
            (k,) rows [index].
        """
        return np.flatnonzero(~np.isnan(self.of(kind)).all(axis=1))

    def unit(self, kind: LimitKind, row: int) -> str:
        """Name the unit of a limit.

        Parameters
        ----------
        kind
            What is limited.
        row
            Of which coordinate [index].

        Returns
        -------
        str
            For example ``"m/s"``.
        """
        return _UNITS[kind][0 if self.is_length[row] else 1]

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        """Tell what is stated, joints of the same limits together, one line each."""
        owners: dict[str, list[str]] = {}
        for row, name in enumerate(self.names):
            said = ", ".join(self.words(row))
            if said:
                owners.setdefault(said, []).append(name)
        lines: list[str] = []
        for said, names in owners.items():
            shown = ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")
            lines.append(f"{shown}: {said}")
        return "\n".join(lines) or "no limit is stated"

    def words(self, row: int) -> Iterator[str]:
        """Tell the limits of one coordinate.

        Parameters
        ----------
        row
            Of which coordinate [index].

        Yields
        ------
        str
            One kind of limit, with its unit.
        """
        for kind in KINDS:
            least, most = self.of(kind)[row]
            if np.isnan(least) and np.isnan(most):
                continue
            if np.isnan(least) or np.isnan(most):
                ends = f"up to {most:g}" if np.isnan(least) else f"from {least:g}"
            else:
                ends = f"{least:g} to {most:g}"
            yield f"{kind} {ends} {self.unit(kind, row)}"


def build_limits(mechanism: Mechanism, model: pin.Model) -> Limits:
    """Gather what the description states.

    Parameters
    ----------
    mechanism
        Description.
    model
        Pinocchio model of its spanning tree, which tells the order of the coordinates.

    Returns
    -------
    Limits
        One row per tangent entry, then swing and angle of the balls, then the coordinates of loops.
    """
    joints = {joint.name: joint for joint in mechanism.joints}
    rows: list[tuple[str, bool, Bounds]] = []
    extra: list[tuple[str, bool, Bounds]] = []
    for name, entry in zip(model.names[1:], model.joints[1:], strict=True):
        joint = joints[name]
        if joint.has_axis:
            rows.append((name, joint.kind is JointKind.PRISMATIC, joint.bounds))
            continue
        rows += [(name + axis, axis.startswith(" v"), Bounds()) for axis in _AXES[entry.nv]]
        if joint.kind is JointKind.SPHERICAL:
            extra += [
                (f"{name} {said}", False, Bounds(position=(-np.inf, most)))
                for said, most in zip(BALL, (joint.swing, joint.turn), strict=True)
            ]
    for loop in mechanism.loops:
        own = loop_coordinates(loop.kind)
        for k, coordinate in enumerate(own):
            name = loop.name if len(own) == 1 else f"{loop.name} {coordinate}"
            bounds = loop.bounds[k] if loop.bounds else Bounds()
            extra.append((name, coordinate in ("length", "x", "y"), bounds))
    rows += extra

    def table(kind: LimitKind) -> FloatArray:
        values = np.array([getattr(bounds, kind) for _, _, bounds in rows], dtype=float).reshape(-1, 2)
        return np.where(np.isfinite(values), values, np.nan)

    return Limits(
        names=tuple(name for name, _, _ in rows),
        position=table("position"),
        velocity=table("velocity"),
        acceleration=table("acceleration"),
        effort=table("effort"),
        jerk=table("jerk"),
        is_length=np.array([length for _, length, _ in rows], dtype=bool),
    )
