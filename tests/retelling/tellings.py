"""The ways to tell a mechanism; each is written to a file and read again, so that the reader is part of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link
from tests.retelling.changes import CHANGES, Change, all_at_once, changed
from tests.retelling.telling import ONE, Telling, turn
from tests.rewritten import carry_over, recut


def _rounded(x: float, digits: int, rng: np.random.Generator | None) -> str:
    """Print a number with so many digits, rounded to the nearest; up or down as it happens."""
    if rng is None or x == 0.0:
        return f"{x:.{digits}g}"
    unit = 10.0 ** (np.floor(np.log10(abs(x))) + 1 - digits)
    kept = round(x / unit)
    if abs(x / unit - kept) > 1e-6:  # else printed as it is
        kept = int(np.floor(x / unit)) + int(rng.integers(2))
    return f"{kept * unit:.{digits}g}"


def _save(
    chain: stp.ClosedChain,
    folder: Path,
    format: str = "urdf+",
    digits: int | None = None,
    rng: np.random.Generator | None = None,
) -> Path:
    """Write a chain in a format, its numbers with so many digits."""
    path = folder / (f"{chain.name}.xml" if format == "mjcf" else f"{chain.name}.urdf")
    # Drawn shapes are no part of what is told, and their digits would be rounded with the others.
    stp.export(chain, path, format=format, simple_shapes=False)
    if digits is not None:
        number = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
        text = re.sub(
            r'(?<!name)(?<!link)="([^"]*)"',
            lambda m: '="' + number.sub(lambda n: _rounded(float(n[0]), digits, rng), m[1]) + '"',
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
    carry = partial(carry_over, plain, told)
    return Telling(name, plain, told, carry=carry, same_rows=False)


def _by_balls(name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
    if all(loop.kind is JointKind.SPHERICAL for loop in plain.loops):
        return None
    try:
        balls = stp.build.loops_by_balls(plain)
    except stp.errors.UnsupportedError:
        return None  # hinges do something by themselves
    return Telling(name, plain, stp.load(_save(balls, folder)), same_rows=False)


_OTHERWISE = 3
"""Times that numbers are printed with the last digit up or down as it happens, to see what digits do to answers."""


@dataclass(frozen=True)
class _Written:
    """Everything told otherwise, or nothing, in another format or with fewer digits."""

    format: str = "urdf+"
    digits: int | None = None
    changed: bool = True

    def __call__(self, name: str, plain: stp.ClosedChain, folder: Path) -> Telling | None:
        # MuJoCo has no hinge as a loop: two balls stand for it.
        more: dict[str, Any] = {"same_rows": self.format != "mjcf"}
        change = all_at_once(plain) if self.changed else Change()
        written = lambda rng: by_change(  # noqa: E731 - a file
            name,
            plain,
            change,
            folder,
            partial(_save, format=self.format, digits=self.digits, rng=rng),
            **more,
        )
        if self.digits is not None:
            # A length that many numbers make up, in units of its last digit.
            more |= {"exact": False, "tolerance": 10 * 10.0 ** (1 - self.digits)}
            more["printed_otherwise"] = tuple(written(np.random.default_rng(k)) for k in range(_OTHERWISE))
        try:
            return written(None)
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
