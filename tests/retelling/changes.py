"""What a description may tell otherwise: frames of links moved, joints reversed, zeros shifted, another order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from tests.retelling.telling import ONE, Told, turn
from tests.rewritten import told_otherwise


@dataclass(frozen=True, eq=False)
class Change:
    """What is told otherwise of a description.

    Attributes
    ----------
    links
        Told frame of a link in the plain one. The axis of the joint above has to keep its line.
    joints
        Signs and zeros of joints; those of many freedoms may turn their frame (`before`).
    loops
        Told frames 1 and 2 of a loop in the plain ones.
    mirrored
        Whether links, joints and loops stand in the file the other way round.
    swapped
        Whether loops go from link 2 to link 1.
    """

    links: Mapping[str, pin.SE3] = field(default_factory=dict)
    joints: Mapping[str, Told] = field(default_factory=dict)
    loops: Mapping[str, tuple[pin.SE3, pin.SE3]] = field(default_factory=dict)
    mirrored: bool = False
    swapped: bool = False


def changed(old: Mechanism, change: Change) -> tuple[Mechanism, dict[str, Told]]:
    """Tell a description otherwise, and say how its joints tell their values."""
    frame = lambda link: change.links.get(link, ONE)  # noqa: E731 - a look-up
    told = {}

    def joint(j: Joint) -> Joint:
        how, above, own = change.joints.get(j.name, Told()), frame(j.parent).inverse(), frame(j.child)
        if not j.has_axis:
            told[j.name] = how = replace(how, after=own)
            # A fixed joint has no value: its placement carries both ends.
            end = own if j.kind is JointKind.FIXED else how.before
            return replace(j, placement=above * j.placement * end)
        told[j.name] = how
        # With the told value x = sign q + zero: plain motion(q) = motion along the told axis(x) after one of -zero.
        turning = j.kind is JointKind.REVOLUTE
        back = -how.sign * how.zero * j.axis
        start = turn(*back) if turning else turn(0, 0, 0, shift=tuple(back))
        ends = sorted(how.sign * x + how.zero for x in (j.lower, j.upper))
        return replace(
            j,
            placement=above * j.placement * start * own,
            axis=own.rotation.T @ (how.sign * j.axis),
            lower=ends[0],
            upper=ends[1],
            effort=_reversed_span(j.effort) if how.sign < 0 else j.effort,
            physics=told_otherwise(j.physics, how.sign, how.zero),
        )

    def link(part: Link) -> Link:
        body = part.inertia
        return part if body is None else replace(part, inertia=body.se3ActionInverse(frame(part.name)))

    def loop(p: Loop) -> Loop:
        one, two = change.loops.get(p.name, (ONE, ONE))
        moved = replace(
            p,
            placement1=frame(p.link1).inverse() * p.placement1 * one,
            placement2=frame(p.link2).inverse() * p.placement2 * two,
            axis=one.rotation.T @ p.axis,
            axis2=two.rotation.T @ p.axis2,
        )
        if p.kind is JointKind.REVOLUTE and p.physics:
            # R becomes one⁻¹ R two, all about the axis.
            zero = float(p.axis @ (pin.log3(two.rotation) - pin.log3(one.rotation)))
            moved = replace(moved, physics=(told_otherwise(p.physics[0], zero=zero),))
        if p.cable.reel is not None:
            # way + ratio q = length, and q = sign (x - zero).
            how = change.joints.get(p.cable.reel, Told())
            ratio = how.sign * p.cable.ratio
            cable = replace(p.cable, ratio=ratio)
            moved = replace(moved, length=p.length + ratio * how.zero, cable=cable)
        # A pulley stands at one end.
        return _swapped(moved) if change.swapped and not p.cable.radius else moved

    links, joints, loops = map(link, old.links), map(joint, old.joints), map(loop, old.loops)
    step = -1 if change.mirrored else 1
    gravity = None if old.gravity is None else frame(old.root).rotation.T @ np.array(old.gravity)
    new = replace(
        old,
        links=tuple(links)[::step],
        joints=tuple(joints)[::step],
        loops=tuple(loops)[::step],
        gravity=None if gravity is None else (float(gravity[0]), float(gravity[1]), float(gravity[2])),
    )
    home = {name: told[name].value(np.atleast_1d(value)) for name, value in old.home.items()}
    return replace(new, home=home), told


def _reversed_span(bound: float | tuple[float, float]) -> float | tuple[float, float]:
    return (-bound[1], -bound[0]) if isinstance(bound, tuple) else bound


def _swapped(loop: Loop) -> Loop:
    axis, axis2 = (loop.axis2, loop.axis) if loop.kind is JointKind.UNIVERSAL else (loop.axis, loop.axis2)
    # R becomes its inverse: angles and lengths change their sign, and those of a universal joint their places.
    physics = tuple(told_otherwise(own, -1.0) for own in loop.physics)
    return replace(
        loop,
        physics=physics[::-1] if loop.kind is JointKind.UNIVERSAL else physics,
        link1=loop.link2,
        link2=loop.link1,
        placement1=loop.placement2,
        placement2=loop.placement1,
        axis=axis,
        axis2=axis2,
    )


def _axes(chain: stp.ClosedChain) -> list[Joint]:
    return [joint for joint in chain.mechanism.joints if joint.has_axis]


def _reversed(chain: stp.ClosedChain, each: int = 1) -> Change:
    return Change(joints={joint.name: Told(sign=-1.0) for joint in _axes(chain)[::each]})


def _shifted(chain: stp.ClosedChain) -> Change:
    size = {JointKind.REVOLUTE: 0.3, JointKind.PRISMATIC: 0.2 * chain.length_scale}
    return Change(
        joints={j.name: Told(zero=size[j.kind] * (1 + 0.1 * k)) for k, j in enumerate(_axes(chain))}
    )


def _turned(chain: stp.ClosedChain) -> Change:
    """Turn every link but the platform, and those fixed to something: how much depends on the joint above."""
    links, joints = {}, {}
    for k, j in enumerate(chain.mechanism.joints):
        shift = (0.07 + 0.01 * k) * chain.length_scale
        match j.kind:
            case JointKind.REVOLUTE:
                move = turn(*((0.5 + 0.2 * k) * j.axis), shift=tuple(shift * j.axis))
            case JointKind.PRISMATIC:
                move = turn(0.4, -0.3 - 0.1 * k, 0.6, shift=(shift, -shift, 0.5 * shift))
            case JointKind.SPHERICAL:
                move = turn(0.4, -0.3 - 0.1 * k, 0.6)
                joints[j.name] = Told(before=turn(-0.2, 0.3, 0.5))
            case JointKind.FLOATING:
                move = turn(0.4, -0.3, 0.6, shift=(shift, 0, -shift))
                joints[j.name] = Told(before=turn(-0.2, 0.3, 0.5, shift=(0, shift, shift)))
            case _:
                move = turn(0.2, 0.1, -0.3, shift=(shift, 0, 0))
        links[j.child] = ONE if j.child == chain.platform else move
    return Change(links=links, joints=joints)


def _turned_loops(chain: stp.ClosedChain) -> Change:
    loops = {}
    for k, p in enumerate(chain.loops):
        angles = (0.4 + 0.1 * k, -0.7)
        if p.kind is JointKind.SPHERICAL:
            loops[p.name] = (turn(0.3, angles[0], -0.2), turn(angles[1], 0.1, 0.5))
        elif p.kind is JointKind.REVOLUTE:
            loops[p.name] = (turn(*(angles[0] * p.axis)), turn(*(angles[1] * p.axis)))
    return Change(loops=loops)


def _moved(chain: stp.ClosedChain) -> Change:
    L = chain.length_scale
    return Change(links={chain.mechanism.root: turn(0.7, -0.4, 1.1, shift=(0.8 * L, -0.5 * L, 0.3 * L))})


def all_at_once(chain: stp.ClosedChain) -> Change:
    signs, zeros, turned = _reversed(chain, 2).joints, _shifted(chain).joints, _turned(chain)
    joints = {name: replace(told, sign=signs.get(name, Told()).sign) for name, told in zeros.items()}
    return Change(
        links={**turned.links, **_moved(chain).links},
        joints={**turned.joints, **joints},
        loops=_turned_loops(chain).loops,
        mirrored=True,
        swapped=True,
    )


CHANGES: dict[str, Callable[[stp.ClosedChain], Change]] = {
    "every axis reversed": _reversed,
    "every second axis reversed": lambda chain: _reversed(chain, 2),
    "zeros shifted": _shifted,
    "frames turned": _turned,
    "loop frames turned": _turned_loops,
    "legs in another order": lambda chain: Change(mirrored=True),
    "loops from the other side": lambda chain: Change(swapped=True),
    "base moved and turned": _moved,
    "all at once": all_at_once,
}
