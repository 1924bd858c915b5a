"""``singularity``: how near a pose is to each kind of singularity, and what the platform then does."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import configuration_of, console, describe_pose, write_json
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.mechanics.singularity import MEANING, Screw, Singularity, classify_singularity
from stewart_pin.state.freedom import TWIST_AXES, TwistAxis


def singularity(
    robot: Annotated[str, typer.Argument(help="Bundled robot or file.")],
    pose: Annotated[
        str | None, typer.Option(help="Platform x,y,z,roll,pitch,yaw [m, rad]; default: home.")
    ] = None,
    axes: Annotated[
        str, typer.Option(help="Components of the twist that count, as vx,vy for the tip of a five-bar.")
    ] = ",".join(TWIST_AXES),
    length: Annotated[
        float | None,
        typer.Option(help="Length that velocities are divided by [m]; default: the robot's size."),
    ] = None,
    limits: Annotated[bool, typer.Option(help="Whether joints must stay in their ranges.")] = True,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
) -> None:
    """Show of which kind of singularity a pose is, or how near it is to each."""
    chain = load(robot)
    q = configuration_of(chain, pose, limits)
    found = classify_singularity(chain, q, axes=cast(Sequence[TwistAxis], axes.split(",")), length=length)
    at = describe_pose(platform_pose(chain, q))
    figures = {"robot": chain.name, "pose": at, **summarise(found)}
    table = Table(
        title=f"{chain.name} at {', '.join(f'{k} {round(v, 9) + 0.0:.6g}' for k, v in at.items())} [m, rad]"
    )
    for heading in ("kind", "measure", "condition"):
        table.add_column(heading, justify="left" if heading == "kind" else "right")
    for kind, words in MEANING.items():
        if isfinite(found.measures[kind]):
            table.add_row(words, f"{found.measures[kind]:.4g}", f"{found.conditions[kind]:.4g}")
    table.caption = "Measures: singular values, lengths in robot sizes; 0 at the singularity."
    console.print(table)
    for line in (str(found), *(f"{name.replace('_', ' ')}: {text}" for name, text in _screws(found).items())):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    write_json(json, figures)


def summarise(found: Singularity) -> dict[str, Any]:
    """Condense a classification to JSON-ready figures.

    Parameters
    ----------
    found
        Classification.

    Returns
    -------
    dict
        Kinds, measures, conditions, screws; infinite numbers are None, for JSON has none.
    """

    def number(value: float) -> float | None:
        return float(value) if isfinite(value) else None

    return {
        "kinds": [str(kind) for kind in found.kinds],
        "zlatanov": list(found.zlatanov),
        "axes": list(found.generic.axes),
        "freedoms": found.count.dof,
        "usual_freedoms": found.generic.dof,
        "measures": {str(kind): number(value) for kind, value in found.measures.items()},
        "conditions": {str(kind): number(value) for kind, value in found.conditions.items()},
        "condition_number": number(found.condition_number),
        "length": found.length,
        **{name: screw.values.tolist() for name, screw in _named(found).items()},
    }


def _named(found: Singularity) -> dict[str, Screw]:
    return {
        name: getattr(found, name) for name in ("worst_twist", "worst_wrench", "lost_twist", "carried_wrench")
    }


def _screws(found: Singularity) -> dict[str, str]:
    return {name: str(screw) for name, screw in _named(found).items()}
