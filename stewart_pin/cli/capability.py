"""What a robot can do at a pose.

``capability``: how fast it can move and how much it can carry, and which joint ends it. ``singularity``: how near the
pose is to each kind of singularity, and what the platform then does.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import configuration_of, console, describe_pose, write_json
from stewart_pin.errors import InputError
from stewart_pin.mechanics.capability.limits import velocity_polytope, wrench_polytope
from stewart_pin.mechanics.capability.polytope import (
    Polytope,
    inscribed_ball,
    polytope_limit,
    polytope_reach,
    polytope_section,
    polytope_support,
)
from stewart_pin.mechanics.kinematics import motor_positions, platform_pose
from stewart_pin.mechanics.singularity import MEANING, Screw, Singularity, classify_singularity
from stewart_pin.model.tree import LimitKind
from stewart_pin.state.freedom import TWIST_AXES, TwistAxis
from stewart_pin.viz.capability_pictures import plot_polytopes
from stewart_pin.viz.figures import check_picture_path, save_figure


def capability(
    robot: Annotated[str, typer.Argument(help="Bundled robot or file.")],
    pose: Annotated[
        str | None, typer.Option(help="Platform x,y,z,roll,pitch,yaw [m, rad]; default: home.")
    ] = None,
    rate_limit: Annotated[
        float | None, typer.Option(help="Largest motor rate [m/s or rad/s]; default: the file's.")
    ] = None,
    effort_limit: Annotated[
        float | None, typer.Option(help="Largest motor effort [N or N m]; default: the file's.")
    ] = None,
    limits: Annotated[bool, typer.Option(help="Whether joints must stay in their ranges.")] = True,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=check_picture_path, help="Picture of the two sets.")
    ] = None,
) -> None:
    """Show greatest velocities and wrenches of the platform at a pose."""
    chain = load(robot)
    asked: tuple[tuple[LimitKind, str, float | None], ...] = (
        ("velocity", "--rate-limit", rate_limit),
        ("effort", "--effort-limit", effort_limit),
    )
    for kind, option, given in asked:
        bounds = chain.limits.bounds(kind, chain.motor_index)
        endless = [
            motor for motor, ends in zip(chain.motors, bounds, strict=True) if not np.isfinite(ends).all()
        ]
        if given is None and endless:
            raise InputError(f"motor '{endless[0]}' of '{chain.name}' states no {kind} limit; give {option}")
    q = configuration_of(chain, pose, limits)
    velocity = velocity_polytope(chain, q, rate_limit=rate_limit, limits=limits)
    free = wrench_polytope(chain, q, effort_limit=effort_limit)
    loaded = wrench_polytope(chain, q, effort_limit=effort_limit, gravity=True)
    figures = {
        "robot": chain.name,
        "pose": describe_pose(platform_pose(chain, q)),
        "motor_positions": dict(zip(chain.motors, motor_positions(chain, q).tolist(), strict=True)),
        "length": velocity.length,
        "velocity": summarise_polytope(velocity),
        "wrench": summarise_polytope(free),
        "wrench_beyond_weight": summarise_polytope(loaded),
    }
    _print(figures)
    if plot is not None:
        if len(velocity.names) < 3:
            raise InputError(
                f"--plot needs a platform with three freedoms, this one has {len(velocity.names)}"
            )
        first = tuple(range(3))
        shown = [polytope_section(velocity, first), polytope_section(free, first)]
        titles = [f"{what}, other components zero" for what in ("velocities", "wrenches")]
        save_figure(plot_polytopes(shown, titles=titles), plot)
        console.print(f"sets drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def summarise_polytope(polytope: Polytope) -> dict[str, Any]:
    """Condense a polytope to the figures that are printed.

    Parameters
    ----------
    polytope
        Velocities or wrenches.

    Returns
    -------
    dict
        JSON-ready: per coordinate the least and greatest value with all others zero and with all others free, and the
        limits met; for the first three also without the rest (velocity without turning); the largest ball about rest.
    """
    ball = inscribed_ball(polytope)
    holds = ball.radius >= 0.0
    d = len(polytope.names)
    section = polytope_section(polytope) if d > 3 and holds else None
    rows: list[dict[str, Any]] = []
    for k, (name, unit) in enumerate(zip(polytope.names, polytope.units, strict=True)):
        row: dict[str, Any] = {"coordinate": name, "unit": unit}
        axis = np.eye(d)[k]
        row["free"] = [-polytope_support(polytope, -axis), polytope_support(polytope, axis)]
        if section is not None and k < 3:
            row["others_of_its_kind_free"] = [
                -polytope_support(section, -axis[:3]), polytope_support(section, axis[:3]),
            ]  # fmt: skip
        if holds:
            row["alone"] = [-polytope_reach(polytope, -axis), polytope_reach(polytope, axis)]
            row["limits"] = [polytope_limit(polytope, -axis), polytope_limit(polytope, axis)]
        rows.append(row)
    return {
        "coordinates": rows,
        "corners": len(polytope.vertices),
        "faces": len(polytope.offsets),
        "ball": {"radius": ball.radius, "worst_direction": ball.direction.tolist(), "limit": ball.limit},
    }


def _print(figures: dict[str, Any]) -> None:
    pose = ", ".join(f"{name} {round(value, 9) + 0.0:.6g}" for name, value in figures["pose"].items())
    table = Table(title=f"{figures['robot']} at {pose} [m, rad]")
    table.add_column("\ngreatest")
    for heading in ("all others\nzero", "no turning,\nno moment", "all others\nfree"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("first at\nits limit")
    for kind in ("velocity", "wrench", "wrench_beyond_weight"):
        table.add_section()
        table.add_row(f"[bold]{kind.split('_', 1)[-1].replace('_', ' ')}[/bold]")
        for row in figures[kind]["coordinates"]:
            joints = dict.fromkeys(x.split(" at ")[0] or "several" for x in row.get("limits", ()))
            ranges = (_range(row.get(key)) for key in ("alone", "others_of_its_kind_free", "free"))
            table.add_row(escape(f"{row['coordinate']} [{row['unit']}]"), *ranges, ", ".join(joints))
        ball = figures[kind]["ball"]
        if ball["radius"] >= 0:
            radius = f"{ball['radius']:.5g} {'m/s' if kind == 'velocity' else 'N'}"
            table.add_row("every way", radius, "", "", ball["limit"].split(" at ")[0])
    size = f"{figures['length']:.4g} m"
    table.caption = f"Every way: angular velocities times {size}, moments divided by {size}."
    if figures["wrench_beyond_weight"]["ball"]["radius"] < 0:
        table.caption += "\nThe motors cannot hold the robot's own weight here."
    console.print(table)


def _range(ends: list[float] | None) -> str:
    if ends is None:
        return ""
    low, high = ends
    if abs(low + high) <= 1e-6 * (high - low):
        return f"± {high:.5g}"
    return f"{low + 0.0:.5g} … {high:.5g}"


# ----------------------------------------------------------------------------------------------------
# ``singularity``
# ----------------------------------------------------------------------------------------------------


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
    figures = {"robot": chain.name, "pose": at, **summarise_singularity(found)}
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


def summarise_singularity(found: Singularity) -> dict[str, Any]:
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
