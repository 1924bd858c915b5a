"""``inspect``: what a file holds, what was kept, changed and ignored, and how the mechanism can move."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, write_json
from stewart_pin.mechanics.mobility import Mobility, mobility
from stewart_pin.model.roles import motor_candidates, platform_candidates

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
) -> None:
    """Show sizes, loops, motors and mobility of a robot, and what was made of its file."""
    named = None if motors is None else [name.strip() for name in motors.split(",")]
    chain = load(file, loops=loops, motors=named, platform=platform)
    report = mobility(chain)
    sizes = {"nq": chain.nq, "nv": chain.nv, "nu": chain.nu, "nc": chain.nc}
    table = Table(title=chain.name, show_header=False)
    table.add_row("sizes", ", ".join(f"{name} {value}" for name, value in sizes.items()))
    table.add_row("links", ", ".join(link.name for link in chain.mechanism.links))
    table.add_row("joints", ", ".join(f"{joint.name}: {joint.kind}" for joint in chain.mechanism.joints))
    drives, links = motor_candidates(chain.mechanism), platform_candidates(chain.mechanism)
    table.add_row("motors", ", ".join(chain.motors) or f"none; candidates, best guess first: {_few(drives)}")
    table.add_row("platform", chain.platform or f"none; candidates, best guess first: {_few(links)}")
    table.add_row(
        "loops", "\n".join(f"{x.name}: {x.kind}, {x.link1} to {x.link2}" for x in chain.loops) or "none"
    )
    couplings = [f"{x.name}: {x.joint1} follows {x.joint2 or 'none'}" for x in chain.couplings]
    table.add_row("couplings", "\n".join(couplings) or "none")
    table.add_row("limits", str(chain.limits))
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
        listed = "; ".join(", ".join(names) for names in sets[:_SHOWN])
        table.add_row(
            "could be left out", listed + (f"; and {len(sets) - _SHOWN} more" if len(sets) > _SHOWN else "")
        )
    table.add_row("file", str(chain.report))
    console.print(table)
    notes = [asdict(note) for note in chain.mechanism.notes]
    roles = {
        "motors": chain.motors,
        "platform": chain.platform,
        "motor_candidates": drives,
        "platform_candidates": links,
    }
    write_json(json, {"robot": chain.name, **sizes, **roles, "mobility": asdict(report), "notes": notes})


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
