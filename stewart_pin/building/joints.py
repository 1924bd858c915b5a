"""What joints carry, handed on to another chain: limits, and the inertia of rotors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isnan
from typing import Any

import numpy as np

from stewart_pin.errors import InputError, MechanismError, UnsupportedError
from stewart_pin.model.description import (
    BALL,
    Bounds,
    Joint,
    JointKind,
    Loop,
    Mechanism,
    Span,
    loop_coordinates,
)
from stewart_pin.model.tree import KINDS, set_limits
from stewart_pin.model.validation import validate
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain
from stewart_pin.tolerances import HOME_IN_FILE


def with_limits(
    chain: ClosedChain,
    limits: Mapping[str, Mapping[str, float | Sequence[float | None] | None]],
) -> ClosedChain:
    """Give joints other limits: motors, passive joints, balls and joints that close loops.

    Parameters
    ----------
    chain
        Closed chain.
    limits
        ``{joint: {kind: limit}}``; what is not named stays. The joint is one of ``chain.limits.names``. The kind is
        ``"position"`` [m or rad], ``"velocity"`` [m/s or rad/s], ``"acceleration"`` [m/s² or rad/s²], ``"effort"`` of a
        motor [N or N m] or ``"jerk"`` [m/s³ or rad/s³]. The limit is (least, greatest), either of them None where there
        is none; or one number for both sides; or None for no limit at all. The swing and the angle of a ball have a
        greatest position only, which is one number.

    Returns
    -------
    ClosedChain
        Same links, joints, loops, motors, platform and home.

    Raises
    ------
    InputError
        If a name, a kind or a limit is none; names those that there are.
    MechanismError
        If home is beyond a limit of a position.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.with_limits(
    ...     stp.load("stewart"),
    ...     {"leg1": {"effort": (0, 500), "velocity": None}, "leg1_ball swing": {"position": 0.5}},
    ... )
    >>> print(chain.limits)  # doctest: +ELLIPSIS
    leg1_x, leg1_y and 10 more: position -1.5 to 1.5 rad
    leg1: position 0.5 to 1.8 m, effort 0 to 500 N
    leg2, leg3 and 3 more: position 0.5 to 1.8 m, velocity -2 to 2 m/s, effort -10000 to 10000 N
    leg1_ball swing: position up to 0.5 rad
    """
    as_chain(chain)
    mechanism = chain.mechanism
    if not isinstance(limits, Mapping):
        raise InputError(f"limits must be a mapping of joints, got {type(limits).__name__}")
    for name, kinds in limits.items():
        if not isinstance(kinds, Mapping):
            raise InputError(f"limits[{name!r}] must be a mapping of kinds of limits, got {kinds!r}")
        for kind, value in kinds.items():
            if kind not in KINDS:
                raise InputError(f"limits[{name!r}] has the kind {kind!r}; the kinds are: {', '.join(KINDS)}")
            mechanism = _changed(mechanism, chain, name, kind, value)
    validate(mechanism)
    changed = replace(chain, mechanism=mechanism, model=set_limits(chain.model, mechanism))
    beyond = changed.judge.positions(changed.q_home, slack=HOME_IN_FILE)
    if beyond:
        raise MechanismError(
            f"home of '{chain.name}' has {'; '.join(map(str, beyond))}; choose wider limits, or another home first",
            path=mechanism.source,
            culprit=beyond[0].joint,
        )
    return changed


def _changed(mechanism: Mechanism, chain: ClosedChain, name: str, kind: str, value: Any) -> Mechanism:
    """Change one limit of one coordinate."""
    owner = f"limits[{name!r}][{kind!r}]"
    for joint in mechanism.joints:
        if joint.name == name and joint.has_axis:
            return _with_joint(mechanism, _limited(joint, kind, _span(owner, value)))
        if joint.kind is JointKind.SPHERICAL and name in (f"{joint.name} {said}" for said in BALL):
            most = _cone(owner, kind, value)
            field = "swing" if name.endswith(BALL[0]) else "turn"
            return _with_joint(mechanism, replace(joint, **{field: most}))
    for loop in mechanism.loops:
        own = loop_coordinates(loop.kind)
        names = [loop.name] if len(own) == 1 else [f"{loop.name} {said}" for said in own]
        if name in names:
            return _with_loop(mechanism, loop, names.index(name), kind, _loop_span(loop, owner, kind, value))
    taken = [*(joint.name for joint in mechanism.joints if joint.has_axis), *chain.limits.names[chain.nv :]]
    raise InputError(
        f"limits name {name!r}, which has no coordinate to limit; those that have: {', '.join(taken)}"
    )


def _loop_span(loop: Loop, owner: str, kind: str, value: Any) -> Span:
    """Read a limit of a joint that closes a loop."""
    if kind == "effort":
        raise InputError(f"{owner}: joint '{loop.name}' closes a loop, and no motor drives it")
    return (-inf, _cone(owner, kind, value)) if loop.kind is JointKind.SPHERICAL else _span(owner, value)


def _with_joint(mechanism: Mechanism, changed: Joint) -> Mechanism:
    joints = tuple(changed if joint.name == changed.name else joint for joint in mechanism.joints)
    return replace(mechanism, joints=joints)


def _with_loop(mechanism: Mechanism, loop: Loop, number: int, kind: str, span: Span) -> Mechanism:
    bounds = list(loop.bounds) or [Bounds() for _ in loop_coordinates(loop.kind)]
    bounds[number] = replace(bounds[number], **{kind: span})
    changed = replace(loop, bounds=tuple(bounds))
    return replace(mechanism, loops=tuple(changed if each is loop else each for each in mechanism.loops))


def _limited(joint: Joint, kind: str, span: Span) -> Joint:
    if kind == "position":
        return replace(joint, lower=span[0], upper=span[1])
    # One number where both sides are alike, as in files.
    alike = span[0] == -span[1]
    return replace(joint, **{kind: span[1] if alike else span})


def _span(owner: str, value: Any) -> Span:
    if value is None:
        return -inf, inf
    try:
        if isinstance(value, str):
            raise TypeError
        if isinstance(value, Sequence) or hasattr(value, "__len__"):
            least, most = (end if end is not None else None for end in value)
            least, most = -inf if least is None else float(least), inf if most is None else float(most)
        else:
            most = float(value)
            least = -most
    except (TypeError, ValueError):
        raise InputError(f"{owner} must be (least, greatest), one number or None, got {value!r}") from None
    least, most = -inf if isnan(least) else least, inf if isnan(most) else most
    if not least <= most or least == inf or most == -inf:
        raise InputError(f"{owner}: the least, {least:g}, is above the greatest, {most:g}")
    return least, most


def _cone(owner: str, kind: str, value: Any) -> float:
    if kind != "position":
        raise InputError(f"{owner}: the swing and the angle of a ball have limits of position only")
    least, most = _span(owner, value)
    if not most > 0 or (least != -most and least not in (0.0, -inf)):
        raise InputError(f"{owner} must be one number above zero, got {value!r}")
    return most


# ----------------------------------------------------------------------------------------------------
# Inertia of rotors, Pinocchio's armature: no description has a place for it, so it is carried over or asked for
# ----------------------------------------------------------------------------------------------------


def with_rotors_of(chain: ClosedChain, rebuilt: ClosedChain) -> ClosedChain:
    """Carry the inertia of rotors over to a chain that was rebuilt from a description.

    Parameters
    ----------
    chain
        Chain as it was.
    rebuilt
        Chain as it was rebuilt.

    Returns
    -------
    ClosedChain
        The rebuilt chain; each joint of the same name and size has its rotor.
    """
    if not np.any(chain.model.armature):
        return rebuilt
    model = rebuilt.model.copy()
    armature = np.array(model.armature)
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if chain.model.existJointName(name):
            before = chain.model.joints[chain.model.getJointId(name)]
            if before.nv == joint.nv:
                own = chain.model.armature[before.idx_v : before.idx_v + before.nv]
                armature[joint.idx_v : joint.idx_v + joint.nv] = own
    model.armature = armature
    return replace(rebuilt, model=model)


def require_no_rotors(chain: ClosedChain, where: str) -> None:
    """Refuse rotors where there is no place for their inertia.

    Parameters
    ----------
    chain
        Closed chain.
    where
        What has no place for it.

    Raises
    ------
    UnsupportedError
        If a joint has a rotor.
    """
    turning = np.flatnonzero(chain.model.armature)
    if turning.size:
        name, amount = chain.tangent_names[turning[0]], chain.model.armature[turning[0]]
        raise UnsupportedError(
            f"{where} has no place for rotors, and joint '{name}' of {chain.name} has one of {amount:g} kg or kg m² "
            "(armature of the model); use a verb that takes the chain, or set the armature to zero"
        )
