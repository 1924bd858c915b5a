"""What joints carry, handed on to another chain: limits, and what they do by themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import inf, isnan
from typing import Any

import numpy as np
import pinocchio as pin

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
    physics_coordinates,
)
from stewart_pin.model.joint_physics import (
    NO_PHYSICS,
    JointPhysics,
    read_fields,
    uneven_joint,
    with_physics_of,
    write_fields,
)
from stewart_pin.model.tree import KINDS, set_limits
from stewart_pin.model.validation import validate
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain
from stewart_pin.tolerances import HOME_IN_FILE
from stewart_pin.typing import FloatArray


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
# What joints do by themselves: rotors, damping, dry friction, springs
# ----------------------------------------------------------------------------------------------------

_FIELDS = tuple(field.name for field in fields(JointPhysics))


def with_joint_physics(
    chain: ClosedChain, physics: Mapping[str, JointPhysics | Mapping[str, Any] | None]
) -> ClosedChain:
    """Give joints rotors, damping, dry friction and springs: motors, passive joints, and joints that close loops.

    Parameters
    ----------
    chain
        Closed chain.
    physics
        ``{joint: {quantity: value}}``; what is not named stays, and None takes all away. A joint that closes a loop and
        has several coordinates names one: ``"joint angle 1"``. The quantities are ``"armature"``, inertia of the rotor
        times the square of the gear ratio [kg or kg m²]; ``"damping"`` [N s/m or N m s/rad]; ``"friction"``, dry
        friction [N or N m]; ``"stiffness"`` of a spring, a number or its coefficients by powers of the displacement,
        the linear one first [N/m or N m/rad, and so on]; ``"rest"``, where the spring is at rest [m or rad]; and
        ``"force"``, a constant effort along the joint's coordinate, as of a gas spring or of a preload [N or N m]. A
        ball has damping and a spring of its whole angle; a joint that closes a loop has no armature.

    Returns
    -------
    ClosedChain
        Same links, joints, loops, motors, platform and home. Armature, damping and friction stand in the fields of
        Pinocchio's model, and count as they stand there.

    Raises
    ------
    InputError
        If a name or a quantity is unknown, or a value is no number; names those that there are.
    MechanismError
        If a value makes no sense, or a joint has no place for it.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> sprung = stp.with_joint_physics(chain, {"leg1": {"stiffness": 1e4, "rest": 0.8, "damping": 20}})
    >>> bare, other = (stp.inverse_dynamics(each, chain.q_home, *np.zeros((2, 24))) for each in (chain, sprung))
    >>> pushed = 1e4 * (0.8 - stp.motor_positions(chain, chain.q_home)[0])
    >>> bool(abs(bare.tau_motor[0] - other.tau_motor[0] - pushed) < 1e-9)
    True
    """
    as_chain(chain)
    if not isinstance(physics, Mapping):
        raise InputError(f"physics must be a mapping of joints, got {type(physics).__name__}")
    mechanism = with_physics_of(chain.model, chain.mechanism)
    for name, own in physics.items():
        if own is not None and not isinstance(own, Mapping | JointPhysics):
            raise InputError(f"physics[{name!r}] must be a mapping of quantities, got {own!r}")
        mechanism = _with_physics(mechanism, name, own)
    validate(mechanism)
    model = chain.model.copy()
    write_fields(model, _fields_with(chain.model, mechanism, physics))
    changed = replace(chain, mechanism=mechanism, model=model)
    # Ranks and freedoms know nothing of forces.
    if "generic" in vars(chain):
        vars(changed)["generic"] = chain.generic
    return changed


def _fields_with(
    model: pin.Model, mechanism: Mechanism, physics: Mapping[str, JointPhysics | Mapping[str, Any] | None]
) -> dict[str, FloatArray]:
    """Fields of the model, as they stand but for what is set: entries of one joint may differ there."""
    values = read_fields(model)
    for joint in mechanism.joints:
        if joint.name in physics and model.existJointName(joint.name):
            own, entry = physics[joint.name], model.joints[model.getJointId(joint.name)]
            for field, entries in values.items():
                if not isinstance(own, Mapping) or field in own:
                    entries[entry.idx_v : entry.idx_v + entry.nv] = getattr(joint.physics, field)
    return values


def without_joint_physics(chain: ClosedChain) -> ClosedChain:
    """Take away all that joints do by themselves.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    ClosedChain
        With joints that only guide.
    """
    names = [joint.name for joint in chain.mechanism.joints if joint.kind is not JointKind.FIXED]
    names += [each for loop in chain.mechanism.loops for each in _coordinate_names(loop)]
    return with_joint_physics(chain, dict.fromkeys(names))


def without_dry_friction(chain: ClosedChain) -> ClosedChain:
    """Take dry friction away, which has no slope at rest.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    ClosedChain
        The chain itself where none of its joints has any.
    """
    fields_, mechanism = read_fields(chain.model), chain.mechanism
    rubs = fields_["friction"].any() or any(own.friction for loop in mechanism.loops for own in loop.physics)
    if not rubs:
        return chain
    model = chain.model.copy()
    write_fields(model, fields_ | {"friction": np.zeros(chain.nv)})
    loops = tuple(
        replace(loop, physics=tuple(replace(own, friction=0.0) for own in loop.physics))
        for loop in mechanism.loops
    )
    changed = replace(chain, mechanism=replace(mechanism, loops=loops), model=model)
    vars(changed)["generic"] = chain.generic
    return changed


def _with_physics(mechanism: Mechanism, name: str, own: JointPhysics | Mapping[str, Any] | None) -> Mechanism:
    """Change what one joint does by itself along one coordinate."""
    for joint in mechanism.joints:
        if joint.name == name and joint.kind is not JointKind.FIXED:
            return _with_joint(mechanism, replace(joint, physics=_physics(name, joint.physics, own)))
    for loop in mechanism.loops:
        words = physics_coordinates(loop.kind)
        names = _coordinate_names(loop)
        if name in names:
            parts = list(loop.physics) or [NO_PHYSICS] * len(words)
            parts[names.index(name)] = _physics(name, parts[names.index(name)], own)
            changed = replace(loop, physics=tuple(parts) if any(parts) else ())
            return replace(
                mechanism, loops=tuple(changed if each is loop else each for each in mechanism.loops)
            )
    taken = [joint.name for joint in mechanism.joints if joint.kind is not JointKind.FIXED]
    taken += [each for loop in mechanism.loops for each in _coordinate_names(loop)]
    raise InputError(
        f"physics names {name!r}, which is no joint that moves; those that do: {', '.join(taken)}"
    )


def _coordinate_names(loop: Loop) -> list[str]:
    words = physics_coordinates(loop.kind)
    return [loop.name] if len(words) == 1 else [f"{loop.name} {word}" for word in words]


def _physics(name: str, old: JointPhysics, own: JointPhysics | Mapping[str, Any] | None) -> JointPhysics:
    if own is None or isinstance(own, JointPhysics):
        return own or NO_PHYSICS
    values: dict[str, Any] = {}
    for field, value in own.items():
        owner = f"physics[{name!r}][{field!r}]"
        if field not in _FIELDS:
            raise InputError(f"{owner}: the quantities are {', '.join(_FIELDS)}")
        try:
            if isinstance(value, str | bool):
                raise TypeError
            if field == "stiffness":
                values[field] = tuple(float(each) for each in np.atleast_1d(value))
            else:
                values[field] = float(value)
        except (TypeError, ValueError):
            raise InputError(f"{owner} must be a number, got {value!r}") from None
    return replace(old, **values)


def with_physics_fields_of(chain: ClosedChain, rebuilt: ClosedChain) -> ClosedChain:
    """Carry armature, damping and friction over to a chain that was rebuilt from a description.

    They live in Pinocchio's model, where they may have been set by hand, entry by entry.

    Parameters
    ----------
    chain
        Chain as it was.
    rebuilt
        Chain as it was rebuilt.

    Returns
    -------
    ClosedChain
        The rebuilt chain; each joint of the same name and size has what it had.
    """
    given, values = read_fields(chain.model), read_fields(rebuilt.model)
    for name, joint in zip(rebuilt.model.names[1:], rebuilt.model.joints[1:], strict=True):
        if chain.model.existJointName(name):
            before = chain.model.joints[chain.model.getJointId(name)]
            if before.nv == joint.nv:
                for field, own in given.items():
                    values[field][joint.idx_v : joint.idx_v + joint.nv] = own[
                        before.idx_v : before.idx_v + before.nv
                    ]
    if all(np.array_equal(own, read_fields(rebuilt.model)[field]) for field, own in values.items()):
        return rebuilt
    model = rebuilt.model.copy()
    write_fields(model, values)
    return replace(rebuilt, model=model)


def require_no_physics(chain: ClosedChain, where: str) -> None:
    """Refuse rotors, damping, friction and springs where there is no place for them.

    Parameters
    ----------
    chain
        Closed chain.
    where
        What has no place for them.

    Raises
    ------
    UnsupportedError
        If a joint has any.
    """
    mechanism = with_physics_of(chain.model, chain.mechanism)
    found = [(joint.name, joint.physics) for joint in mechanism.joints if joint.physics]
    found += [(loop.name, own) for loop in mechanism.loops for own in loop.physics if own]
    if (uneven := uneven_joint(chain.model)) is not None:
        found.append((uneven[0], f"{uneven[1]} that differs between its axes"))  # type: ignore[arg-type]
    if found:
        raise UnsupportedError(
            f"{where} has no place for what joints do by themselves, and joint '{found[0][0]}' of {chain.name} has "
            f"{found[0][1]}; use a verb that takes the chain, or take it away by with_joint_physics"
        )


def require_describable(chain: ClosedChain) -> None:
    """Refuse a model whose joints do what no description can say.

    Parameters
    ----------
    chain
        Closed chain.

    Raises
    ------
    UnsupportedError
        If armature, damping or friction of one joint differs between its axes.
    """
    if (uneven := uneven_joint(chain.model)) is not None:
        raise UnsupportedError(
            f"joint '{uneven[0]}' of {chain.name} has {uneven[1]} that differs between its axes (in the fields of "
            "chain.model), which no file can say; make it one number for all"
        )
