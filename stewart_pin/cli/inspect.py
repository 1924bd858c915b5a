"""``inspect``: what a file holds, what was kept, changed and ignored, and how the mechanism can move."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, write_json
from stewart_pin.mechanics.mobility import mobility


def inspect(
    file: Annotated[str, typer.Argument(help="Bundled robot or file.")],
    loops: Annotated[Path | None, typer.Option(help="File beside a URDF that declares its loops.")] = None,
    motors: Annotated[
        str | None, typer.Option(help="Names of the motor joints, separated by commas.")
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
    table.add_row("motors", ", ".join(chain.motors))
    table.add_row("platform", chain.platform)
    table.add_row(
        "loops", "\n".join(f"{x.name}: {x.kind}, {x.link1} to {x.link2}" for x in chain.loops) or "none"
    )
    table.add_row("degrees of freedom", str(report.dof))
    table.add_row("idle freedoms", "\n".join(report.idle) or "none")
    table.add_row("redundant loop rows", ", ".join(report.redundant) or "none")
    table.add_row("motors sufficient", "yes" if report.motors_sufficient else f"no, {report.lost} left over")
    table.add_row("file", str(chain.report))
    console.print(table)
    notes = [asdict(note) for note in chain.mechanism.notes]
    write_json(json, {"robot": chain.name, **sizes, "mobility": asdict(report), "notes": notes})
