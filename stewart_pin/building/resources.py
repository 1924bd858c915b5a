"""Bundled robots: one folder each, in the repository and in the wheel."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from stewart_pin.errors import FileMissingError, InputError

_LONGEST_NAME = 200
"""Characters of a name that a message repeats."""
_PACKAGE = Path(__file__).resolve().parent.parent


@cache
def urdf_root() -> Path:
    """Find the folder of the bundled robots.

    Returns
    -------
    pathlib.Path
        ``stewart_pin/urdf`` of an installed wheel, or ``urdf`` of the repository.

    Raises
    ------
    FileMissingError
        If neither exists: the installation is broken.
    """
    for root in (_PACKAGE / "urdf", _PACKAGE.parent / "urdf"):
        if root.is_dir():
            return root
    raise FileMissingError(
        "the folder of the bundled robots is missing; reinstall stewart_pin", path=str(_PACKAGE)
    )


def robots() -> tuple[str, ...]:
    """List the bundled robots.

    Returns
    -------
    tuple of str
        Names that `load` accepts.
    """
    return tuple(
        sorted(folder.name for folder in urdf_root().iterdir() if (folder / f"{folder.name}.urdf").is_file())
    )


def find_robot(name_or_path: str | Path) -> Path:
    """Find the file of a robot.

    Parameters
    ----------
    name_or_path
        Name of a bundled robot, or path of a file.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If it is neither text nor a path.
    FileMissingError
        If there is neither a bundled robot nor a file of that name.
    """
    if not isinstance(name_or_path, str | Path):
        raise InputError(
            f"name_or_path must be a robot's name or a file's path, got {type(name_or_path).__name__}"
        )
    if name_or_path in robots():
        return urdf_root() / name_or_path / f"{name_or_path}.urdf"
    path = Path(name_or_path)
    try:
        found, is_folder = path.is_file(), path.is_dir()
    except OSError:  # a name longer than the file system allows, such as the text of a file
        found = is_folder = False
    if found:
        return path
    shown = str(name_or_path)
    raise FileMissingError(
        "this is a folder; pass the file inside"
        if is_folder
        else f"no such file, and no bundled robot of that name; the bundled robots are: {', '.join(robots())}",
        path=shown if len(shown) <= _LONGEST_NAME else shown[:_LONGEST_NAME] + "...",
        culprit=shown,
    )
