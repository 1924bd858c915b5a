"""What all commands share: the console, the progress line, the JSON file, ranges of values, the pose asked for."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from stewart_pin.errors import InputError
from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation
from stewart_pin.mechanics.kinematics import inverse_kinematics
from stewart_pin.state.chain import ClosedChain

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


# ----------------------------------------------------------------------------------------------------
# Values of a parameter, as they are written on the command line
# ----------------------------------------------------------------------------------------------------

_MOST = 1_000_000


WRENCH_HELP = (
    "LINK:fx,fy,fz,mx,my,mz from outside, at the link's origin, world axes [N, N m]; may be repeated."
)
"""What ``--wrench`` says of itself."""


def parse_wrenches(texts: Sequence[str] | None) -> dict[str, tuple[float, ...]] | None:
    """Read what ``--wrench`` gives.

    Parameters
    ----------
    texts
        ``LINK:fx,fy,fz,mx,my,mz`` each.

    Returns
    -------
    dict or None
        [force; moment] on each link [N, N m].

    Raises
    ------
    InputError
        If a text is none, or a link is named twice.
    """
    found: dict[str, tuple[float, ...]] = {}
    for text in texts or ():
        link, _, numbers = text.rpartition(":")
        if not link or numbers.count(",") != 5:
            raise InputError(f"--wrench must be LINK:fx,fy,fz,mx,my,mz, got {text!r}")
        if link in found:
            raise InputError(f"--wrench names {link!r} twice; give the sum of what acts on a link")
        found[link] = parse_numbers("--wrench", numbers, 6)
    return found or None


def parse_range(option: str, text: str, *, linear: bool) -> np.ndarray:
    """Read ``LOW:HIGH:COUNT``, or numbers separated by commas.

    Parameters
    ----------
    option
        Name of the option, for the message.
    text
        What the user wrote.
    linear
        Whether a range has equal steps; otherwise equal ratios.

    Returns
    -------
    numpy.ndarray
        (n,) values [any unit].

    Raises
    ------
    InputError
        If it is neither, or a range of equal ratios does not stay above zero.
    """
    try:
        if ":" not in text:
            values = np.array([float(word) for word in text.split(",")])
        else:
            low, high, count = text.split(":")
            ends, steps = (float(low), float(high)), int(count)
            if not 1 <= steps <= _MOST:
                raise InputError(f"{option}: a range has 1 to {_MOST} values, got {steps}")
            if not linear and min(ends) <= 0:
                raise InputError(
                    f"{option}: equal ratios need values above zero, got {text!r}; or add --linear"
                )
            values = (np.linspace if linear else np.geomspace)(*ends, steps)
    except InputError:
        raise
    except ValueError:
        raise InputError(
            f"{option} must be LOW:HIGH:COUNT or numbers separated by commas, got {text!r}"
        ) from None
    if not np.isfinite(values).all():
        raise InputError(f"{option} must be finite, got {text!r}")
    return values


# ----------------------------------------------------------------------------------------------------
# The pose that a command is asked for, and the same in words
# ----------------------------------------------------------------------------------------------------


def configuration_of(chain: ClosedChain, pose: str | None, limits: bool) -> np.ndarray:
    """Find the configuration of a pose.

    Parameters
    ----------
    chain
        Closed chain.
    pose
        ``x,y,z,roll,pitch,yaw``, or None for home.
    limits
        Whether joint limits must hold.

    Returns
    -------
    numpy.ndarray
        (nq,) configuration [m, rad, unit quaternions].

    Raises
    ------
    InputError
        If the text holds no six numbers.
    """
    if pose is None:
        return chain.q_home
    x, y, z, roll, pitch, yaw = parse_numbers("--pose", pose, 6)
    target = pin.SE3(rotation_from_rpy(roll, pitch, yaw), np.array([x, y, z]))
    return inverse_kinematics(chain, target, limits=limits).q


def describe_pose(pose: pin.SE3) -> dict[str, float]:
    """Write a pose as six numbers.

    Parameters
    ----------
    pose
        Platform frame in the world.

    Returns
    -------
    dict
        x, y, z [m], roll, pitch, yaw [rad].
    """
    values = [*pose.translation, *rpy_from_rotation(pose.rotation)]
    return {k: float(v) for k, v in zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True)}
