"""``inspect``: what a file holds, what was kept, changed and ignored, and how the mechanism can move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from stewart_pin.building.loading import find_robot, load, open_chain
from stewart_pin.cli.output import console, write_json
from stewart_pin.errors import MechanismError
from stewart_pin.mechanics.mobility import Mobility, mobility
from stewart_pin.model.description import JointKind, Mechanism, Report, unknown_kind
from stewart_pin.model.formats.reading import read_mechanism
from stewart_pin.model.loop_rows import closure_rows
from stewart_pin.model.roles import motor_candidates, platform_candidates
from stewart_pin.state.describing import physics_lines
from stewart_pin.viz.figures import check_picture_path, save_figure
from stewart_pin.viz.scene import plot_chain

_FREEDOMS = {
    JointKind.FIXED: 0,
    JointKind.REVOLUTE: 1,
    JointKind.PRISMATIC: 1,
    JointKind.SPHERICAL: 3,
    JointKind.FLOATING: 6,
}
"""Of a joint of the tree."""
_SHOWN = 12
"""Most sets of spare motors in the table; the file has all that were found."""


def inspect(
    file: Annotated[str, typer.Argument(help="Bundled robot or file.")],
    loops: Annotated[Path | None, typer.Option(help="File beside a URDF that declares its loops.")] = None,
    motors: Annotated[
        str | None, typer.Option(help="Motor joints, separated by commas; default: those of the file.")
    ] = None,
    platform: Annotated[str | None, typer.Option(help="Name of the platform link.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=check_picture_path, help="Picture of the robot as it stands.")
    ] = None,
) -> None:
    """Show sizes, loops, motors and mobility of a robot, and what was made of its file, even if it cannot be used."""
    named = None if motors is None else [name.strip() for name in motors.split(",")]
    try:
        chain = load(file, loops=loops, motors=named, platform=platform)
    except MechanismError:
        _show_what_is_there(read_mechanism(find_robot(file), loops=loops), json, plot)
        raise
    report = mobility(chain)
    sizes = {"nq": chain.nq, "nv": chain.nv, "nu": chain.nu, "nc": chain.nc}
    table = Table(title=chain.name, show_header=False)
    table.add_row("sizes", ", ".join(f"{name} {value}" for name, value in sizes.items()))
    _add_parts(table, chain.mechanism, {})
    _add_roles(table, chain.mechanism, chain.motors, chain.platform)
    table.add_row("limits", str(chain.limits))
    _add_mobility(table, report)
    table.add_row("file", str(chain.report))
    console.print(table)
    if plot is not None:
        save_figure(plot_chain(chain), plot)
        console.print(f"robot drawn in {plot}", highlight=False, soft_wrap=True)
    roles = {"motors": chain.motors, "platform": chain.platform, **_candidates(chain.mechanism)}
    own = {"by_themselves": physics_lines(chain.mechanism)}
    figures = {"robot": chain.name, **sizes, **roles, **own, "mobility": asdict(report)}
    write_json(json, figures | {"notes": [asdict(note) for note in chain.mechanism.notes]})


def freedoms(mechanism: Mechanism) -> int:
    """Count the freedoms of the joints of a tree.

    Parameters
    ----------
    mechanism
        What was read of a file.

    Returns
    -------
    int
        Their number, whatever loops take of them.

    Raises
    ------
    UnsupportedError
        If a joint is of another kind.
    """
    for joint in mechanism.joints:
        if joint.kind not in _FREEDOMS:
            raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the count of freedoms")
    return sum(_FREEDOMS[joint.kind] for joint in mechanism.joints)


def _show_what_is_there(mechanism: Mechanism, json: Path | None, plot: Path | None) -> None:
    """Show what was read of a file that makes no chain; the error follows."""
    rows = {loop.name: len(closure_rows(loop)) for loop in mechanism.loops}
    free = freedoms(mechanism)
    count = free - sum(rows.values()) - len(mechanism.couplings)
    motors = tuple(joint.name for joint in mechanism.joints if joint.independent)
    table = Table(title=f"{mechanism.name}: cannot be used as it is", show_header=False)
    _add_parts(table, mechanism, rows)
    table.add_row("freedoms by count", f"{count}: {free} of joints less rows; planar loops repeat some")
    _add_roles(table, mechanism, motors, mechanism.platform)
    table.add_row("file", str(Report(mechanism.notes)))
    console.print(table)
    if plot is not None:
        _draw_as_told(mechanism, plot)
    figures = {
        "robot": mechanism.name,
        "links": [link.name for link in mechanism.links],
        "joints": {joint.name: str(joint.kind) for joint in mechanism.joints},
        "loops": rows,
        "freedoms_by_count": count,
        **_candidates(mechanism),
        "by_themselves": physics_lines(mechanism),
        "notes": [asdict(note) for note in mechanism.notes],
    }
    write_json(json, figures)


def _draw_as_told(mechanism: Mechanism, plot: Path) -> None:
    """Draw a mechanism with all joints at zero, its loops perhaps open."""
    try:
        picture = plot_chain(open_chain(mechanism))
    except MechanismError:  # the error that follows says why nothing stands where
        console.print("no picture: it is no tree with loops", highlight=False)
    else:
        save_figure(picture, plot)
        console.print(f"robot drawn with all joints at zero in {plot}", highlight=False, soft_wrap=True)


def _candidates(mechanism: Mechanism) -> dict[str, tuple[str, ...]]:
    return {
        "motor_candidates": motor_candidates(mechanism),
        "platform_candidates": platform_candidates(mechanism),
    }


def _add_parts(table: Table, mechanism: Mechanism, rows: Mapping[str, int]) -> None:
    """Add links, joints, loops, with the number of their rows where it is given, and couplings."""
    table.add_row("links", ", ".join(link.name for link in mechanism.links))
    table.add_row("joints", ", ".join(f"{joint.name}: {joint.kind}" for joint in mechanism.joints))
    counted = {name: f", {number} rows" for name, number in rows.items()}
    told = [f"{x.name}: {x.kind}, {x.link1} to {x.link2}{counted.get(x.name, '')}" for x in mechanism.loops]
    table.add_row("loops", "\n".join(told) or "none")
    couplings = [
        f"{x.name}: {x.joint1} follows {', '.join(x.joints[1:]) or 'none'}" for x in mechanism.couplings
    ]
    table.add_row("couplings", "\n".join(couplings) or "none")
    if own := physics_lines(mechanism):
        table.add_row("by themselves", "\n".join(own))


def _add_roles(table: Table, mechanism: Mechanism, motors: Sequence[str], platform: str | None) -> None:
    """Add motors and platform, or who may be."""
    drives, links = motor_candidates(mechanism), platform_candidates(mechanism)
    table.add_row("motors", ", ".join(motors) or f"none; candidates, best guess first: {_few(drives)}")
    table.add_row("platform", platform or f"none; candidates, best guess first: {_few(links)}")


def _add_mobility(table: Table, report: Mobility) -> None:
    """Add freedoms, and what motors hold of them."""
    table.add_row("degrees of freedom", f"{report.dof}, {_seen(report)}")
    table.add_row("home singular", _home(report))
    table.add_row("idle freedoms", "\n".join(report.idle) or "none")
    table.add_row("redundant loop rows", ", ".join(report.redundant) or "none")
    table.add_row("motors sufficient", _verdict(report))
    if not report.motors_sufficient:
        table.add_row("joints left free", ", ".join(report.free_joints))
        table.add_row("motors that would do", ", ".join(report.suggestion) or "none of one freedom")
    if report.surplus_motors:
        sets = report.spare_motors
        more = f"; and {len(sets) - _SHOWN} more" if len(sets) > _SHOWN else ""
        table.add_row("could be left out", "; ".join(", ".join(names) for names in sets[:_SHOWN]) + more)


def _few(names: tuple[str, ...]) -> str:
    return ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "") or "none"


def _seen(report: Mobility) -> str:
    """Say at how many configurations the freedoms were counted, and where they differ."""
    count = len(report.dof_samples)
    if {*report.dof_samples, report.dof_home} == {report.dof}:
        return f"at home and at {count} random configurations near it"
    return (
        f"of {count} random configurations near home ({', '.join(map(str, report.dof_samples))}); at home "
        f"{report.dof_home}"
    )


def _home(report: Mobility) -> str:
    return "yes: it moves, or is held, otherwise than nearby" if report.home_singular else "no"


def _verdict(report: Mobility) -> str:
    if report.motors_sufficient:
        spare = f", {report.surplus_motors} to spare" if report.surplus_motors else ""
        return f"yes{spare}"
    return f"no, {report.verdict}: {report.lost} freedom(s) left over"
