"""Matplotlib, when it is installed, drawing to files without a display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stewart_pin.errors import InputError, MissingExtraError


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


def check_picture_path(path: Path | None) -> Path | None:
    """Refuse a picture that could not be written, before anything is computed for it.

    Parameters
    ----------
    path
        File to create, or None for no picture.

    Returns
    -------
    pathlib.Path or None
        The same.

    Raises
    ------
    InputError
        If the suffix is of no known format, or the path is a folder.
    MissingExtraError
        If Matplotlib is not installed.
    """
    if path is None:
        return None
    try:
        from matplotlib.backend_bases import FigureCanvasBase  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("matplotlib", "plot") from None
    known = FigureCanvasBase.get_supported_filetypes()
    if path.suffix and path.suffix[1:].lower() not in known:
        raise InputError(
            f"--plot {path}: pictures end in .{', .'.join(sorted(known))}; choose another suffix"
        )
    if path.is_dir():
        raise InputError(f"--plot {path}: is a folder; name a file in it")
    return path


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
