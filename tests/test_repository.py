"""The repository as a reader finds it: no machine paths, notebooks with pictures, robots with sources."""

from __future__ import annotations

import ast
import contextlib
import functools
import json
import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted(ROOT.glob("notebooks/*.ipynb"))
ROBOTS = sorted(p for p in ROOT.glob("urdf/*") if p.is_dir())

# Written in pieces, so that this file does not hold what it looks for.
REGISTRIES = [
    ".".join(parts)
    for parts in (
        ("pypi", "org"), ("python" + "hosted", "org"), ("npmjs", "org"), ("npmjs", "com"), ("anaconda", "org"),
        ("crates", "io"), ("debian", "org"), ("ubuntu", "com"), ("golang", "org"),
    )
]  # fmt: skip
MACHINE_PATH = re.compile(r"(?<![\w./])/(?:work|root|tmp|home|Users|farm)/")
BUILT = {"__pycache__", "build", "dist", "output"}
NOTEBOOK_BYTES = 600 * 1024
"""Larger notebooks make every clone slow, since each run changes their pictures."""


@functools.cache
def _texts() -> tuple[tuple[str, str], ...]:
    """Return path and text of the project's own files; hidden folders other than .ci are not its own."""
    found = []
    for folder, below, names in os.walk(ROOT):
        below[:] = [n for n in below if (n[0] != "." or n == ".ci") and n not in BUILT]  # never enter .venv
        for path in (Path(folder, name) for name in names if name != ".git"):
            with contextlib.suppress(UnicodeDecodeError):  # a mesh or a picture
                found.append((path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")))
    return tuple(sorted(found))


def _lines_with(pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{path}:{number}: {line.strip()[:120]}"
        for path, text in _texts()
        if pattern.search(text)
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    ]


def test_no_registry_is_named() -> None:
    assert _lines_with(re.compile("|".join(map(re.escape, REGISTRIES)))) == []


def test_no_path_of_a_machine() -> None:
    assert _lines_with(MACHINE_PATH) == []
    assert MACHINE_PATH.search("see /" + "work/shared")
    assert not MACHINE_PATH.search("https://site/home/index or ./tmp/x")


def test_quick_start_is_two_commands() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(r"^#+ Quick start\n+```\w*\n(.*?)```", readme, re.DOTALL | re.MULTILINE)
    assert block
    compare, test = block[1].splitlines()
    assert compare.startswith("python3 -m venv .venv && ")
    assert compare.endswith(".venv/bin/python -m stewart_pin compare")
    assert test.endswith(".venv/bin/python -m pytest -q -n auto")


def test_readme_examples_run() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    prose = re.split(r"^```python\n(.*?)^```", readme, flags=re.DOTALL | re.MULTILINE)
    assert len(prose) >= 3
    # Prose becomes blank lines, so that an error names the line of the README.
    prose[::2] = ["\n" * (part.count("\n") + 1) for part in prose[::2]]
    exec(compile("".join(prose), "README.md", "exec"), {})  # one session, as a reader would type it


def test_links_lead_somewhere() -> None:
    pages = {path: text for path, text in _texts() if path.endswith(".md")}
    links = [(page, link) for page, text in pages.items() for link in re.findall(r"\]\(([^)#:]+)\)", text)]
    assert len(links) >= 3
    assert [(page, link) for page, link in links if not (ROOT / page).parent.joinpath(link).exists()] == []


def test_versions_agree() -> None:
    version = _project()["version"]
    package = (ROOT / "stewart_pin" / "__init__.py").read_text(encoding="utf-8")
    assert f'__version__ = "{version}"' in package
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert "## Unreleased" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def _project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _advised_extras() -> Iterator[tuple[str | None, str]]:
    """Yield package and extra of each ``MissingExtraError(package, "extra")``; None where code finds the package."""
    for path in ROOT.glob("stewart_pin/**/*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "MissingExtraError":
                package, extra = call.args
                yield getattr(package, "value", None), ast.literal_eval(extra)


def test_a_missing_extra_names_one_that_installs_the_package() -> None:
    extras = _project()["optional-dependencies"]
    advised = set(_advised_extras())
    assert advised
    wrong = [(p, e) for p, e in advised if not any(r.startswith(p or "") for r in extras.get(e, ()))]
    assert wrong == []


def test_every_notebook_is_listed() -> None:
    listings = [ROOT / "README.md", ROOT / "notebooks" / "README.md"]
    listed = "".join(p.read_text(encoding="utf-8") for p in listings if p.exists())
    assert [p.name for p in NOTEBOOKS if p.name not in listed] == []


def notebook_problems(cells: list[dict[str, Any]]) -> list[str]:
    """List what a reader of the stored notebook would miss: a run from top to bottom, pictures, no errors."""
    code = [c for c in cells if c["cell_type"] == "code" and "".join(c["source"]).strip()]
    outputs = [o for c in code for o in c["outputs"]]
    found = []
    if [c["execution_count"] for c in code] != list(range(1, len(code) + 1)):
        found.append("was not run once from top to bottom")
    if not any("image/png" in o.get("data", {}) for o in outputs):
        found.append("shows no picture")
    if any(o["output_type"] == "error" for o in outputs):
        found.append("holds an error")
    if any(o.get("name") == "stderr" for o in outputs):
        found.append("holds a warning")
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.name)
def test_notebook_is_kept_with_its_outputs(path: Path) -> None:
    assert path.stat().st_size <= NOTEBOOK_BYTES
    assert notebook_problems(json.loads(path.read_text(encoding="utf-8"))["cells"]) == []


def test_a_bad_notebook_is_caught() -> None:
    picture = {"output_type": "display_data", "data": {"image/png": ""}}
    error = {"output_type": "error"}
    warning = {"output_type": "stream", "name": "stderr"}

    def cell(count: int | None, *outputs: dict[str, Any]) -> dict[str, Any]:
        return {"cell_type": "code", "source": ["x = 1"], "execution_count": count, "outputs": list(outputs)}

    assert notebook_problems([cell(1, picture), cell(2)]) == []
    assert notebook_problems([cell(2, picture)]) == ["was not run once from top to bottom"]
    assert notebook_problems([cell(None, picture)]) == ["was not run once from top to bottom"]
    assert notebook_problems([cell(1)]) == ["shows no picture"]
    assert notebook_problems([cell(1, picture, error)]) == ["holds an error"]
    assert notebook_problems([cell(1, picture, warning)]) == ["holds a warning"]


@pytest.mark.parametrize("folder", ROBOTS, ids=lambda p: p.name)
def test_robot_folder_is_complete(folder: Path) -> None:
    assert (folder / f"{folder.name}.urdf").is_file()
    source = folder / "SOURCE.md"
    assert source.is_file()
    assert source.read_text(encoding="utf-8").strip()
