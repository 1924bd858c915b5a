"""What all commands share: the console, the progress line, the JSON file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from stewart_pin.errors import InputError

console = Console()


@contextmanager
def progress_bar() -> Iterator[Any]:
    """Show one bar per stage while work goes on.

    Yields
    ------
    callable
        ``report(stage, done, total)``.
    """
    columns = (TextColumn("{task.description:<28}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeElapsedColumn(), console=console) as bars:
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done)

        yield report


def write_json(path: Path | None, figures: Mapping[str, Any]) -> None:
    """Write figures, if a file was asked for.

    Parameters
    ----------
    path
        File to create or overwrite, or None.
    figures
        JSON-ready values.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"--json {path}: cannot be written ({error.strerror}); choose another file"
        ) from None
    console.print(f"figures written to {path}", highlight=False, soft_wrap=True)


def parse_numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """Read comma-separated numbers; one number stands for all.

    Parameters
    ----------
    option
        Name of the option, for the message.
    text
        What the user wrote.
    count
        How many are needed.

    Returns
    -------
    tuple of float
        The numbers.

    Raises
    ------
    InputError
        If they are not numbers, or not one or `count` of them.
    """
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        raise InputError(f"{option} must be numbers separated by commas, got {text!r}") from None
    if len(values) == 1:
        return values * count
    if len(values) != count:
        raise InputError(f"{option} must be one number or {count} separated by commas, got {text!r}")
    return values
