"""The ways to tell a mechanism; each is written to a file and read again, so that the reader is part of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link
from tests.retelling.changes import CHANGES, Change, all_at_once, changed
from tests.retelling.telling import ONE, Telling, turn
from tests.rewritten import carry_over, recut


def _save(chain: stp.ClosedChain, folder: Path, format: str = "urdf+", digits: int | None = None) -> Path:
    """Write a chain in a format, its numbers with so many digits."""
    path = folder / (f"{chain.name}.xml" if format == "mjcf" else f"{chain.name}.urdf")
    stp.export(chain, path, format=format)
    if digits is not None:
        number = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
        text = re.sub(
            r'(?<!name)(?<!link)="([^"]*)"',
            lambda m: '="' + number.sub(lambda n: f"{float(n[0]):.{digits}g}", m[1]) + '"',
            path.read_text(encoding="utf-8"),
        )
        path.write_text(text, encoding="utf-8")
    return path


def by_change(
    name: str,
    plain: stp.ClosedChain,
    change: Change,
    folder: Path,
    save: Callable[[stp.ClosedChain, Path], Path] = _save,
    **more: Any,
) -> Telling:
    """Write a changed description, and read it."""
    old = plain.described()
    mechanism, joints = changed(old, change)
    # The order of the file is that of the motors.
    path = save(build_chain(mechanism, platform=plain.platform), folder)
    world = change.links.get(old.root, ONE).inverse()
    return Telling(name, plain, stp.load(path), joints, world, same_gap=not change.swapped, **more)


def _on_a_pedestal(name: str, plain: stp.ClosedChain, folder: Path) -> Telling:
    """Give the tree another root, to which the base is fixed."""
    old, place = plain.described(), turn(-0.3, 0.9, 0.2, shift=(0.1, 0.4, -0.2))
    x, y, z = (place.rotation @ plain.gravity).tolist()
    mechanism = replace(
        old,
        links=(Link("pedestal"), *old.links),
        joints=(Joint("bolts", JointKind.FIXED, "pedestal", old.root, place), *old.joints),
        gravity=(x, y, z),
    )
    path = _save(build_chain(mechanism, motors=plain.motors, platform=plain.platform), folder)
    return Telling(name, plain, stp.load(path), world=place)


def _cut_elsewhere(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    other = recut(plain)
    if other is None:
        return None
    told = stp.load(_save(other, folder))
    # Idle freedoms get the least motion, counted over other joints: a thin rod then spins otherwise.
    tolerance = 1e-6 if stp.mobility(plain).idle else 1e-9
    carry = partial(carry_over, plain, told)
    return Telling(name, plain, told, carry=carry, same_rows=False, tolerance=tolerance)


def _by_balls(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    if all(loop.kind is JointKind.SPHERICAL for loop in plain.loops):
        return None
    return Telling(name, plain, stp.load(_save(stp.build.loops_by_balls(plain), folder)), same_rows=False)


@dataclass(frozen=True)
class _Written:
    """Everything told otherwise, or nothing, in another format or with fewer digits."""

    format: str = "urdf+"
    digits: int | None = None
    changed: bool = True

    def __call__(self, name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
        # MuJoCo has no hinge as a loop: two balls stand for it.
        more: dict[str, Any] = {"same_rows": self.format != "mjcf"}
        if self.digits is not None:
            # A number keeps half a unit of its last digit; elimination multiplies that by condition numbers near 100,
            # and planar loops are moved by as much again until they close.
            more["exact"] = False
            more["tolerance"] = 400 * 0.5 * 10.0 ** (1 - self.digits)
        try:
            return by_change(
                name,
                plain,
                all_at_once(plain) if self.changed else Change(),
                folder,
                partial(_save, format=self.format, digits=self.digits),
                **more,
            )
        except stp.errors.UnsupportedError:
            return None


_OTHERS: dict[str, Callable[[str, stp.ClosedChain, Path], Telling | None]] = {
    "on a pedestal": _on_a_pedestal,
    "cut elsewhere": _cut_elsewhere,
    "hinges as balls": _by_balls,
    "all at once in Drake": _Written("drake"),
    "all at once in Isaac": _Written("isaac"),
    "all at once in Gepetto": _Written("gepetto"),
    "all at once in MJCF": _Written("mjcf"),
    "six digits": _Written(digits=6, changed=False),
    "nine digits": _Written(digits=9, changed=False),
    "all at once with six digits": _Written(digits=6),
    "all at once with nine digits": _Written(digits=9),
}

TELLINGS = (*CHANGES, *_OTHERS)
"""Names of the ways to tell a mechanism."""


def tell(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    """Tell a chain otherwise; None where this way has no words for it."""
    if name in _OTHERS:
        return _OTHERS[name](name, plain, folder)
    change = CHANGES[name](plain)
    if name == "loop frames turned" and not change.loops:
        return None
    return by_change(name, plain, change, folder)
