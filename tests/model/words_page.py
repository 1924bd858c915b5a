"""The page WORDS.md: words that the readers know; ``python -m tests.model.words_page`` writes it from their tables."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from stewart_pin.model.formats.dialect import dialects, grammar
from stewart_pin.model.formats.sdf import elements, joints, models
from stewart_pin.model.formats.urdf_elements import CORE
from stewart_pin.model.formats.words import Words

PAGE = Path(__file__).parent.parent.parent / "WORDS.md"
_HEAD = """# Words of the formats

Written by `python -m tests.model.words_page` from the tables of the readers. What stands under "read" changes the
robot or ends in an error; what is noted stands in `chain.report`. Everywhere a tag that could close a loop or couple
joints, and is not understood, is refused. MJCF is compiled by MuJoCo, which refuses words that it does not know.
"""


def page() -> str:
    """Write the page."""
    parts = [_HEAD, _urdf("URDF and SRDF", {key: grammar()[key] for key in CORE})]
    parts += [_urdf(dialect.title, dialect.words) for dialect in dialects() if dialect.words]
    parts.append("## SDFormat\n\n| element | read |\n|---|---|\n")
    rows = {"world": models._IN_WORLD, "model": models._IN_MODEL, "joint": joints.IN_JOINT}
    parts[-1] += "".join(
        f"| `{tag}` | {_listed(f'<{each}>' for each in sorted(known))} |\n" for tag, known in rows.items()
    )
    parts[-1] += "\n| not read, anywhere | why |\n|---|---|\n"
    parts[-1] += "".join(f"| `<{tag}>` | {why} |\n" for tag, why in elements._HARMLESS.items())
    return "\n".join(parts)


def _urdf(title: str, words: Mapping[str, Words]) -> str:
    rows = [
        f"| `{key}` | {_listed([*own.attributes, *(f'<{tag}>' for tag in own.tags), *(['text'] if own.text else [])])} "
        f"| {_noted(own.noted)} | {own.strange} |\n"
        for key, own in words.items()
    ]
    head = "| element | read | known, not read | all else |\n|---|---|---|---|\n"
    return f"## {_code(title)}\n\n{head}{''.join(rows)}"


def _code(title: str) -> str:
    return " ".join(f"`{word}`" if "<" in word else word for word in title.split(" "))


def _listed(words: Collection[str]) -> str:
    return ", ".join(f"`{word}`" for word in words) or "nothing"


def _noted(noted: Mapping[str, str]) -> str:
    named = {word if word.startswith("@") else f"<{word}>": why for word, why in noted.items()}
    return "; ".join(f"`{word}`{f': {why}' if why else ''}" for word, why in named.items())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
