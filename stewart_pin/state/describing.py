"""What a chain is, in words that fit a screen."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from stewart_pin.errors import StewartPinError
from stewart_pin.model.description import Mechanism, physics_coordinates
from stewart_pin.model.joint_physics import with_physics_of

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain

_WIDTH = 110
_LINES = 12
"""Lines that one part may take; the rest is counted."""


def describe(chain: ClosedChain) -> str:
    """Tell parts, freedoms, motors with units and limits, and which entry of q is which joint.

    Parameters
    ----------
    chain
        Mechanism.

    Returns
    -------
    str
        Some lines.
    """
    ties = _count(len(chain.loops), "loop") + (
        f", {_count(len(chain.couplings), 'coupling')}" if chain.couplings else ""
    )
    links = _count(len(chain.mechanism.links), "link")
    platform = f"platform {chain.platform!r}" if chain.platform is not None else "no platform named"
    lines = [f"{chain.name}: {links}, {ties}, {platform}", _freedoms(chain), *_motors(chain)]
    return "\n".join([*lines, *_physics(chain), *_entries(chain)])


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _freedoms(chain: ClosedChain) -> str:
    sizes = f"nq {chain.nq}, nv {chain.nv}, nc {chain.nc}"
    try:
        count = chain.generic.count
    except StewartPinError as error:
        return f"freedoms: not counted ({str(error).splitlines()[0]}); {sizes}"
    some = chain.platform is not None and count.platform < count.dof
    moved = f", {count.platform} of which move the platform" if some else ""
    return f"freedoms: {count.dof}{moved}; {sizes}"


def _motors(chain: ClosedChain) -> list[str]:
    if not chain.motors:
        return ["motors: none named"]
    limits = chain.limits
    told: dict[tuple[str, str], list[str]] = {}
    for name, row in zip(chain.motors, chain.motor_index, strict=True):
        words = ", ".join(limits.words(int(row))) or "no limit stated"
        told.setdefault((limits.unit("position", int(row)), words), []).append(name)
    lines = [f"motors ({unit}): {', '.join(names)}: {words}" for (unit, words), names in told.items()]
    return _short([w for line in lines for w in textwrap.wrap(line, _WIDTH, subsequent_indent="    ")])


def _physics(chain: ClosedChain) -> list[str]:
    lines = [
        f"by themselves: {each}" for each in physics_lines(with_physics_of(chain.model, chain.mechanism))
    ]
    return _short([w for line in lines for w in textwrap.wrap(line, _WIDTH, subsequent_indent="    ")])


def physics_lines(mechanism: Mechanism) -> list[str]:
    """Tell what joints do by themselves, those that are alike together.

    Parameters
    ----------
    mechanism
        Description.

    Returns
    -------
    list of str
        Joints and their rotors, damping, friction and springs.
    """
    told: dict[str, list[str]] = {}
    for joint in mechanism.joints:
        if joint.physics:
            told.setdefault(str(joint.physics), []).append(joint.name)
    for loop in mechanism.loops:
        words = physics_coordinates(loop.kind)
        for word, own in zip(words, loop.physics, strict=False):
            if own:
                told.setdefault(str(own), []).append(loop.name if len(words) == 1 else f"{loop.name} {word}")
    return [f"{', '.join(names)}: {own}" for own, names in told.items()]


def _entries(chain: ClosedChain) -> list[str]:
    names = []
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        first, last = joint.idx_q, joint.idx_q + joint.nq - 1
        names.append(f"{first} {name}" if first == last else f"{first}-{last} {name}")
    text = "q: " + ", ".join(n.replace(" ", "\N{NO-BREAK SPACE}") for n in names)
    lines = textwrap.wrap(text, _WIDTH, subsequent_indent="   ", break_on_hyphens=False)
    return _short([line.replace("\N{NO-BREAK SPACE}", " ") for line in lines])


def _short(lines: list[str]) -> list[str]:
    if len(lines) <= _LINES:
        return lines
    return [*lines[: _LINES - 1], f"    ... {len(lines) - _LINES + 1} more lines"]
