"""The page WORDS.md: words that the readers know; ``python -m tests.model.words_page`` writes it from their tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from stewart_pin.model.formats.dialect import dialects, grammar
from stewart_pin.model.formats.dialects import gepetto
from stewart_pin.model.formats.mjcf import compiling, reading
from stewart_pin.model.formats.sdf import elements
from stewart_pin.model.formats.sdf.words import WORDS
from stewart_pin.model.formats.urdf_elements import CORE
from stewart_pin.model.formats.usd import joints as usd_joints
from stewart_pin.model.formats.usd import physics as usd_physics
from stewart_pin.model.formats.usd import stage
from stewart_pin.model.formats.words import Words

PAGE = Path(__file__).parent.parent.parent / "WORDS.md"
_HEAD = """# Words of the formats

Written by `python -m tests.model.words_page` from the tables of the readers. What stands under "read" changes the
robot or ends in an error; what is noted stands in `chain.report`. Everywhere a tag that could close a loop or couple
joints, and is not understood, is refused. MJCF is compiled by MuJoCo, and OpenUSD by its own library: what they do not
know is refused there, or is no part of a mechanism.
"""


def page() -> str:
    """Write the page."""
    parts = [_HEAD, _elements("URDF and SRDF", {key: grammar()[key] for key in CORE})]
    parts += [_elements(dialect.title, dialect.words) for dialect in dialects() if dialect.words]
    parts += [_yaml(), _elements("SDFormat", WORDS)]
    parts.append(
        _table("not read, anywhere", "why", {f"<{tag}>": why for tag, why in elements._HARMLESS.items()})
    )
    parts += [_mjcf(), _usd()]
    return "\n".join(parts)


def _yaml() -> str:
    loops = {written: str(kind) for written, kind in gepetto._TYPES.items()}
    keys = f"Keys that are read: {_listed(gepetto._KEYS)}; any other is refused.\n"
    joints = f"\n`joint_type` may be {_listed(('SPHERICAL', 'FIXED', *gepetto._UJOINTS))}.\n"
    return f"## {gepetto.DIALECT.title}\n\n{keys}\n{_table('type', 'loop', loops)}{joints}"


def _mjcf() -> str:
    own = {
        f"<text name={compiling.PLATFORM!r}>": "names the platform",
        f"<text name={compiling.HOME!r} data={compiling.ASSEMBLED!r}>": "home stays where the keyframe has it",
        f"<numeric name='{compiling.SPEED}joint'>": "speed limits of a joint",
        f"<numeric name='{compiling.SPRING}joint'>": "of its spring, what MuJoCo lacks: rest, force, stiffness",
    }
    used, unused = _listed(reading._USED), _listed(compiling._UNUSED)
    flexible = _listed(f"<{tag}>" for tag in compiling._DEFORMABLE)
    return (
        f"## MJCF\n\nOf MuJoCo's compiled model the mechanism is made of {used}. Left out before: {unused}. "
        f"Refused, as no rigid bodies: {flexible}; a `<flexcomp>` that hangs on no link is left out.\n\n"
        f"{_table('words of our own in <custom>', 'meaning', own)}"
    )


def _usd() -> str:
    types = {schema: str(kind) for schema, kind in usd_joints._TYPED.items()}
    free = {
        f"PhysicsJoint that leaves {', '.join(axes)}": str(kind) for kind, axes in stage.FREE_DOFS.items()
    }
    own = {name: what for name, (_, what) in stage._FITTING.items()}
    engines = [*(word for words in usd_physics._WORDS.values() for word in words), *usd_physics.SPRINGS]
    return (
        f"## OpenUSD\n\n{_table('joint', 'read as', types | free)}\nRefused, as what they tie is "
        f"not read: schemas with {_listed(usd_joints._UNREAD)} in their names.\n\n"
        f"What joints do by themselves, in words of engines: {_listed(engines)}; noted: "
        f"{_listed((*usd_physics._UNREAD, usd_physics._AXES + '...'))}.\n\n"
        f"{_table('checked attribute, words of our own', 'holds', own)}"
    )


def _table(left: str, right: str, rows: Mapping[str, str]) -> str:
    return f"| {left} | {right} |\n|---|---|\n" + "".join(
        f"| `{key}` | {value} |\n" for key, value in rows.items()
    )


def _elements(title: str, words: Mapping[str, Words]) -> str:
    rows = [
        f"| `{key}` | {_listed([*own.attributes, *(f'<{tag}>' for tag in own.tags), *(['text'] if own.text else [])])} "
        f"| {_noted(own.noted)} | {own.strange} |\n"
        for key, own in words.items()
    ]
    head = "| element | read | known, not read | all else |\n|---|---|---|---|\n"
    return f"## {_code(title)}\n\n{head}{''.join(rows)}"


def _code(title: str) -> str:
    return " ".join(f"`{word}`" if "<" in word else word for word in title.split(" "))


def _listed(words: Iterable[str]) -> str:
    shown = (word.replace(f"{{{elements.OWN}}}", f"{elements.OWN_PREFIX}:") for word in words)
    return ", ".join(f"`{word}`" for word in shown) or "nothing"


def _noted(noted: Mapping[str, str]) -> str:
    named = {word if word.startswith("@") else f"<{word}>": why for word, why in noted.items()}
    return "; ".join(f"`{word}`{f': {why}' if why else ''}" for word, why in named.items())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
