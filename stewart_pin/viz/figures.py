"""Matplotlib, when it is installed, drawing to files without a display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stewart_pin.errors import MissingExtraError


def new_figure(width: float, height: float) -> Any:
    """Create an empty figure that belongs to no window.

    Parameters
    ----------
    width, height
        Size [inch].

    Returns
    -------
    matplotlib.figure.Figure
        Figure with constrained layout.

    Raises
    ------
    MissingExtraError
        If Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("matplotlib", "plot") from None
    return Figure(figsize=(width, height), layout="constrained")


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure as PNG.

    Parameters
    ----------
    figure
        What to write.
    path
        File to create or overwrite; missing folders are made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
