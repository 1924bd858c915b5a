"""Axes of SDFormat joints: directions, limits, and other axes that they follow."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import pinocchio as pin
from lxml import etree

from stewart_pin.model.formats.sdf.elements import direction
from stewart_pin.model.formats.sdf.frames import MODEL, Scope
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Follow:
    """An axis that follows another one: ``follower = multiplier (leader - reference) + offset``.

    Attributes
    ----------
    leader, leader_axis
        Full name of the joint, and which axis of it.
    multiplier, offset, reference
        The law, in the units of both axes [m or rad].
    """

    leader: str
    leader_axis: str
    multiplier: float
    offset: float
    reference: float


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a joint.

    Attributes
    ----------
    direction
        (3,) unit vector in the joint frame, dimensionless.
    lower, upper
        Position limits [m or rad].
    effort
        Largest effort [N or N m], or None where the file states none.
    velocity
        Largest speed [m/s or rad/s].
    acceleration
        Largest acceleration, Drake's extension [m/s² or rad/s²].
    follow
        The axis that it follows, or None.
    """

    direction: FloatArray
    lower: float = -inf
    upper: float = inf
    effort: float | None = None
    velocity: float = inf
    acceleration: float = inf
    follow: Follow | None = None


def read_axis(
    scope: Scope, joint: etree._Element, tag: str, placement: pin.SE3, owner: str, *, endless: bool
) -> Axis:
    """Read an axis of a joint.

    Parameters
    ----------
    scope
        Model that holds the joint.
    joint
        Its element.
    tag
        ``axis`` or ``axis2``.
    placement
        Joint in the world.
    owner
        The joint, for messages.
    endless
        Whether the joint is continuous.

    Returns
    -------
    Axis
        Direction, limits, and what it follows.
    """
    reader = scope.reader
    element = reader.child(joint, tag, owner)
    reader.note_strangers(element, owner, {"xyz", "limit", "use_parent_model_frame", "mimic"})
    axis = axis_direction(scope, element, placement, owner)
    limit = reader.optional(element, "limit", owner)
    follow = _follow(scope, joint, element, tag, owner)
    if limit is None:
        return Axis(axis, follow=follow)
    reader.note_strangers(
        limit,
        owner,
        {"lower", "upper", "effort", "velocity", "stiffness", "dissipation", "drake:acceleration"},
    )
    lower, upper, effort, velocity, acceleration = (
        reader.bound(limit, key, owner)
        for key in ("lower", "upper", "effort", "velocity", "drake:acceleration")
    )
    if endless:
        if lower is not None or upper is not None:
            reader.note(owner, "<limit> lower, upper: the joint is continuous")
        lower = upper = None
    return Axis(
        axis,
        lower=-inf if lower is None else lower,
        upper=inf if upper is None else upper,
        # A negative limit is none.
        effort=inf if effort is not None and effort < 0 else effort,
        velocity=inf if velocity is None or velocity < 0 else velocity,
        acceleration=inf if acceleration is None or acceleration < 0 else acceleration,
        follow=follow,
    )


def axis_direction(scope: Scope, element: etree._Element, placement: pin.SE3, owner: str) -> FloatArray:
    """Read an axis in the frame of its joint.

    Parameters
    ----------
    scope
        Model that holds the joint.
    element
        ``<axis>`` or ``<axis2>``.
    placement
        Joint in the world.
    owner
        The joint, for messages.

    Returns
    -------
    numpy.ndarray
        (3,) unit vector in the joint frame, dimensionless.
    """
    reader = scope.reader
    xyz = reader.child(element, "xyz", owner)
    reader.only(xyz, owner, ("expressed_in",))
    vector = reader.vector(element, "xyz", 3, owner)
    frame = xyz.get("expressed_in") or ""
    old = reader.flag(element, "use_parent_model_frame", owner)
    if old and scope.version >= (1, 7):
        raise reader.error(
            f"{owner}: <use_parent_model_frame> (line {element.sourceline}) ended with version 1.6; write "
            f"<xyz expressed_in='{MODEL}'>",
            owner,
        )
    if old or scope.version < (1, 5):
        frame = MODEL
    if frame:
        vector = placement.rotation.T @ (scope.pose(frame, owner).rotation @ vector)
    return direction(reader, vector, owner)


def _follow(scope: Scope, joint: etree._Element, axis: etree._Element, tag: str, owner: str) -> Follow | None:
    reader = scope.reader
    mimic = reader.optional(axis, "mimic", owner)
    drakes = reader.optional(joint, "drake:mimic", owner) if tag == "axis" else None
    if mimic is not None and drakes is not None:
        raise reader.error(f"{owner} has a <mimic> and a <drake:mimic>; keep one", owner)
    if drakes is not None:
        reader.only(drakes, owner, ("joint", "multiplier", "offset"))
        multiplier, offset = (
            float(reader.numbers(drakes, key, 1, owner)[0]) for key in ("multiplier", "offset")
        )
        leader = scope.prefix + reader.text(drakes, "joint", owner)
        return Follow(leader, "axis", multiplier, offset, 0.0)
    if mimic is None:
        return None
    reader.only(mimic, owner, ("joint", "axis"), ("multiplier", "offset", "reference"))
    which = mimic.get("axis", "axis")
    if which not in ("axis", "axis2"):
        raise reader.error(
            f"{owner}: <mimic axis='{which}'> (line {mimic.sourceline}) must be axis or axis2", owner
        )
    return Follow(
        leader=scope.prefix + reader.text(mimic, "joint", owner),
        leader_axis=which,
        multiplier=reader.number(mimic, "multiplier", owner, "1"),
        offset=reader.number(mimic, "offset", owner, "0"),
        reference=reader.number(mimic, "reference", owner, "0"),
    )
