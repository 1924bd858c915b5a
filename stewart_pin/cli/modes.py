"""``modes``: every pose in which a platform can be assembled for given leg lengths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pinocchio as pin
import typer
from rich.table import Table

from stewart_pin.analysis.assembly_modes.description import describe_modes
from stewart_pin.analysis.assembly_modes.solver import assembly_modes
from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, parse_numbers, write_json
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.geometry.planar_modes import planar_assembly_modes
from stewart_pin.geometry.rotations import rpy_from_rotation
from stewart_pin.mechanics.closed_forms import admission
from stewart_pin.mechanics.forward_solutions import all_forward_kinematics
from stewart_pin.mechanics.kinematics import motor_positions
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray
from stewart_pin.viz.figures import check_picture_path, save_figure
from stewart_pin.viz.planar import plot_assembly_modes, plot_poses
from stewart_pin.viz.scene import plot_chain

_SAME_POSE = 1e-5
"""Difference of two poses of Newton's, of which double ones are known to 1e-7, that are one."""
_SAME = 1e-9
"""Difference of two strokes that is round-off of their offsets [m]."""


def modes(
    robot: Annotated[str, typer.Argument(help="Robot, bundled or a file.")] = "stewart",
    lengths: Annotated[
        str | None, typer.Option(help="Leg lengths l1,...,l6 (or l1,l2,l3) [m]; default: home.")
    ] = None,
    motors: Annotated[
        str | None, typer.Option(help="Instead of lengths, what the motors of any robot read [m, rad].")
    ] = None,
    planar: Annotated[
        str | None, typer.Option(help="Instead of a robot, a planar 3-RPR: L1,L2,L3,gamma,x1,x2,y2 [m, rad].")
    ] = None,
    starts: Annotated[int, typer.Option(help="Random starts where no closed form stands for a robot.")] = 200,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=check_picture_path, help="Picture of all poses side by side.")
    ] = None,
) -> None:
    """Find every pose in which a platform can be assembled for given motor positions; of six legs with proof."""
    if lengths is not None and motors is not None:
        raise InputError("--lengths and --motors say the same thing; give one of them")
    if planar is not None:
        if lengths is None:
            raise InputError("--planar needs --lengths l1,l2,l3")
        sides = parse_numbers("--planar", planar, 7)
        platform, legs = PlanarRPR.from_sides(*sides), parse_numbers("--lengths", lengths, 3)
        figures, picture = _planar({"planar": list(sides)}, platform, legs)
    else:
        figures, picture = _of_a_chain(load(robot), lengths, motors, starts)
    if plot is not None and figures["modes"]:
        save_figure(picture(), plot)
        console.print(f"poses drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def _of_a_chain(
    chain: ClosedChain, lengths: str | None, motors: str | None, starts: int
) -> tuple[dict[str, Any], Any]:
    """By the closed form that stands for a chain, else by search."""
    chain.require_motors()
    chain.platform_link  # noqa: B018 - raises
    read = motor_positions(chain, chain.q_home)
    if motors is not None:
        read = np.array(parse_numbers("--motors", motors, chain.nu))
    planar, spatial = admission(chain, "planar_lengths"), admission(chain, "leg_lengths")
    # What misses a closed form by printed digits alone is taken up from its poses.
    if spatial.geometry is None and not planar.admitted:
        if lengths is not None:
            raise InputError(
                f"'{chain.name}' has no legs that --lengths could mean ({spatial.reason}); give --motors, in the order "
                f"{', '.join(chain.motors)}"
            )
        return _searched(chain, read, starts)
    sign, offset = chain.leg_readings
    legs = offset + sign * read
    if lengths is not None:
        legs = np.array(parse_numbers("--lengths", lengths, chain.nu))
    if isinstance(planar.geometry, PlanarRPR):
        return _planar({"robot": chain.name}, planar.geometry, tuple(legs.tolist()))
    return _spatial(chain, legs)


def _searched(chain: ClosedChain, read: FloatArray, starts: int) -> tuple[dict[str, Any], Any]:
    """Search from random starts; one row per pose, of which legs may stand in several ways."""
    found = all_forward_kinematics(chain, read, starts=starts, limits=False)
    ways: list[list[int]] = []
    for k, pose in enumerate(found.poses):
        same = (way for way in ways if _apart(chain, found.poses[way[0]], pose) < _SAME_POSE)
        way = next(same, None)
        if way is None:
            ways.append([k])
        else:
            way.append(k)
    rows = []
    for way in ways:
        # Of the configurations of a pose one that may be taken, if there is any.
        exceeded = {k: [str(excess) for excess in chain.judge.positions(found.closures[k].q)] for k in way}
        best = min(way, key=lambda k: len(exceeded[k]))
        rows.append(
            {
                "position": found.poses[best].translation.tolist(),
                "roll_pitch_yaw": rpy_from_rotation(found.poses[best].rotation).tolist(),
                "configuration": found.closures[best].q.tolist(),
                "configurations": len(way),
                "found": sum(found.hits[k] for k in way),
                "exceeded": exceeded[best],
            }
        )
    table = Table(title=f"{chain.name}: {len(rows)} poses found")
    for heading in ("", "x y z [m]", "roll pitch yaw [deg]", "configurations", "found by", "limits"):
        table.add_column(heading, justify="right")
    for number, row in enumerate(rows, start=1):
        place = " ".join(f"{x + 0.0:.4f}" for x in np.round(row["position"], 4))
        turned = " ".join(f"{x + 0.0:.2f}" for x in np.round(np.rad2deg(row["roll_pitch_yaw"]), 2))
        limits = "; ".join(row["exceeded"]) or "held"
        share = f"{row['found']} of {found.starts}"
        table.add_row(str(number), place, turned, str(row["configurations"]), share, limits)
    table.caption = (
        "No closed form stands for this robot: found from random starts, without proof. One more start finds another "
        f"configuration with probability {found.missed_share:.2g}, as far as the starts tell."
    )
    console.print(table)
    figures = {
        "robot": chain.name, "motors": read.tolist(), "kind": "searched", "starts": found.starts,
        "missed_share": found.missed_share, "complete": found.complete, "modes": rows,
    }  # fmt: skip
    return figures, lambda: plot_chain(chain, [row["configuration"] for row in rows])


def _apart(chain: ClosedChain, one: pin.SE3, other: pin.SE3) -> float:
    """Largest difference of two poses, lengths in robot sizes."""
    shift = np.abs(one.translation - other.translation).max() / chain.length_scale
    return float(max(shift, np.abs(one.rotation - other.rotation).max()))


def _spatial(chain: ClosedChain, legs: FloatArray) -> tuple[dict[str, Any], Any]:
    hexapod = Hexapod.from_chain(chain)
    sign, offset = chain.leg_readings
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
