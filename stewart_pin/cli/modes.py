"""``modes``: every pose in which a platform can be assembled for given leg lengths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from stewart_pin.analysis.assembly_modes.description import describe_modes
from stewart_pin.analysis.assembly_modes.solver import assembly_modes
from stewart_pin.building.legs import planar_rpr
from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, parse_numbers, write_json
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.geometry.planar_modes import planar_assembly_modes
from stewart_pin.geometry.rotations import rpy_from_rotation
from stewart_pin.mechanics.kinematics import motor_positions
from stewart_pin.state.chain import ClosedChain
from stewart_pin.viz.figures import check_picture_path, save_figure
from stewart_pin.viz.planar import plot_assembly_modes, plot_poses

_SAME = 1e-9
"""Difference of two strokes that is round-off of their offsets [m]."""


def modes(
    robot: Annotated[str, typer.Argument(help="Six-legged or planar robot, bundled or a file.")] = "stewart",
    lengths: Annotated[
        str | None, typer.Option(help="Leg lengths l1,...,l6 (or l1,l2,l3) [m]; default: home.")
    ] = None,
    planar: Annotated[
        str | None, typer.Option(help="Instead of a robot, a planar 3-RPR: L1,L2,L3,gamma,x1,x2,y2 [m, rad].")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=check_picture_path, help="Picture of all poses side by side.")
    ] = None,
) -> None:
    """Find every pose in which a platform can be assembled for given leg lengths."""
    if planar is not None:
        if lengths is None:
            raise InputError("--planar needs --lengths l1,l2,l3")
        sides = parse_numbers("--planar", planar, 7)
        platform, legs = PlanarRPR.from_sides(*sides), parse_numbers("--lengths", lengths, 3)
        figures, picture = _planar({"planar": list(sides)}, platform, legs)
    elif (chain := load(robot)).nu == 3:
        platform, (sign, offset) = planar_rpr(chain), chain.leg_readings
        home = (offset + sign * motor_positions(chain, chain.q_home)).tolist()
        legs = tuple(home) if lengths is None else parse_numbers("--lengths", lengths, 3)
        figures, picture = _planar({"robot": chain.name}, platform, legs)
    else:
        figures, picture = _spatial(chain, lengths)
    if plot is not None and figures["modes"]:
        save_figure(picture(), plot)
        console.print(f"poses drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def _spatial(chain: ClosedChain, lengths: str | None) -> tuple[dict[str, Any], Any]:
    hexapod = Hexapod.from_chain(chain)
    sign, offset = chain.leg_readings
    home = offset + sign * motor_positions(chain, chain.q_home)
    legs = home if lengths is None else np.array(parse_numbers("--lengths", lengths, 6))
    found = assembly_modes(chain, sign * (legs - offset))
    facts = describe_modes(hexapod, found, stroke=_stroke(chain))
    rows = [
        {
            "position": found.position[k].tolist(),
            "roll_pitch_yaw": rpy_from_rotation(found.rotation[k]).tolist(),
            "residual": float(found.residual[k]),
            "certified": bool(found.certified[k]),
            "side": int(facts.side[k]),
            "condition": float(facts.condition[k]),
            "clearance": float(facts.clearance[k]),
            "in_stroke": bool(facts.in_stroke[k]),
        }
        for k in range(len(found))
    ]
    figures = {
        "robot": chain.name, "lengths": legs.tolist(), "kind": found.kind, "n_complex": found.n_complex,
        "expected": found.expected, "complete": bool(found.complete), "modes": rows,
    }  # fmt: skip
    table = Table(title=f"{chain.name}: {len(found)} assembly modes")
    headings = (
        "",
        "x y z [m]",
        "roll pitch yaw [deg]",
        "det J",
        "cond.",
        "legs apart [m]",
        "in stroke",
        "proven",
    )
    for heading in headings:
        table.add_column(heading, justify="right")
    for number, row in enumerate(rows, start=1):
        table.add_row(
            str(number),
            " ".join(f"{x:.4f}" for x in row["position"]),
            " ".join(f"{x:.2f}" for x in np.rad2deg(row["roll_pitch_yaw"])),
            {1: "+", -1: "-", 0: "0"}[row["side"]],
            f"{row['condition']:.3g}",
            f"{row['clearance']:.4f}",
            "yes" if row["in_stroke"] else "no",
            "yes" if row["certified"] else "no",
        )
    table.caption = (
        f"{found.n_complex} complex solutions of {found.expected}; {found.kind}; "
        + ("all of them" if found.complete else "poses may be missing")
        + ".\nModes of different sign of det J are separated by a singularity."
    )
    console.print(table)
    return figures, lambda: plot_assembly_modes(hexapod, found)


def _stroke(chain: ClosedChain) -> tuple[float, float] | None:
    """Least and greatest leg length that the motors share, or None where they differ or have none."""
    sign, offset = chain.leg_readings
    ends = offset + sign * chain.limits.bounds("position", chain.motor_index).T
    low, high = ends.min(axis=0), ends.max(axis=0)
    if not np.isfinite(ends).all() or np.ptp(low) > _SAME or np.ptp(high) > _SAME:
        return None
    return float(low[0]), float(high[0])


def _planar(
    subject: dict[str, Any], platform: PlanarRPR, legs: tuple[float, ...]
) -> tuple[dict[str, Any], Any]:
    found = planar_assembly_modes(platform, legs)
    rows = [
        {
            "position": found.position[k].tolist(),
            "angle": float(found.angle[k]),
            "residual": float(found.residual[k]),
            "multiplicity": int(found.multiplicity[k]),
        }
        for k in range(len(found))
    ]
    table = Table(title=f"planar 3-RPR: {len(found)} assembly modes")
    for heading in ("", "x y [m]", "angle [rad]", "residual [m]", "multiplicity"):
        table.add_column(heading, justify="right")
    for number, row in enumerate(rows, start=1):
        place = " ".join(f"{x:.6f}" for x in row["position"])
        angle, residual = f"{row['angle']:.12f}", f"{row['residual']:.1e}"
        table.add_row(str(number), place, angle, residual, str(row["multiplicity"]))
    table.caption = f"{found.kind}{': ' + found.motion if found.motion else ''}"
    console.print(table)
    figures = subject | {"lengths": list(legs), "kind": found.kind, "modes": rows}
    return figures, lambda: plot_poses(platform, legs)
