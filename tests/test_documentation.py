"""The pages of the documentation: every listing runs, what it prints is what stands there, every name has its place."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import re
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from tests.public_names import public

DOCS = Path(__file__).parent.parent / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.DOTALL | re.MULTILINE)
PAGES = [path for path in sorted(DOCS.glob("*.md")) if BLOCK.search(path.read_text(encoding="utf-8"))]


def runs(path: Path) -> Iterator[tuple[str, str]]:
    """Run the listings of a page in one session; yield what the page shows, and what was printed."""
    text, session = path.read_text(encoding="utf-8"), {}
    for block in BLOCK.finditer(text):
        lines = "\n" * text[: block.start(1)].count("\n")  # an error names the line of the page
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(lines + block[1], str(path), "exec"), session)
        yield block[2] or "", printed.getvalue()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_listings_print_what_the_page_shows(path: Path) -> None:
    try:
        for shown, printed in runs(path):
            assert printed == shown
    finally:
        plt.close("all")


def test_the_reference_has_every_public_name_once() -> None:
    pytest.importorskip("matplotlib")
    spec = importlib.util.spec_from_file_location("documentation_conf", DOCS / "conf.py")
    assert spec and spec.loader
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    text = "\n".join(conf.reference_pages().values())
    named = re.findall(r"^\.\. auto\w+:: stewart_pin\.(\S+)$", text, re.MULTILINE)
    assert sorted(named) == sorted(public())
