"""``compare``: the main job. Motor forces of a shaking platform by every method, in one table and one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, parse_numbers, progress_bar, write_json
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.motion.trajectories import sample_times, sinusoidal_motion
from stewart_pin.studies.comparison import Comparison, compare_methods
from stewart_pin.viz.figures import check_picture_path, plot_comparison, save_figure


def compare(
    robot: Annotated[str, typer.Option(help="Bundled robot or file.")] = "stewart",
    amplitude: Annotated[str, typer.Option(help="Along x,y,z [m]; one number for all.")] = "0.02",
    frequencies: Annotated[str, typer.Option(help="Along x,y,z [Hz]; one number for all.")] = "1,3,4.5",
    duration: Annotated[float, typer.Option(help="Length of the motion [s].")] = 2.0,
    rate: Annotated[float, typer.Option(help="States per second.")] = 500.0,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path, typer.Option(callback=check_picture_path, help="Picture of the force curves.")
    ] = Path("output/compare.png"),
) -> None:
    """Compare the motor forces of a shaking platform by every method."""
    chain = load(robot)
    samples = sinusoidal_motion(
        sample_times(duration, rate),
        home=platform_pose(chain, chain.q_home),
        amplitude=parse_numbers("--amplitude", amplitude, 3),
        frequency=parse_numbers("--frequencies", frequencies, 3),
    )
    with progress_bar() as report:
        comparison = compare_methods(chain, samples, progress=report)
    figures = summarise(comparison)
    figures["motion"] = {
        "amplitude": amplitude, "frequencies": frequencies, "duration": duration, "rate": rate, "states": len(samples),
    }  # fmt: skip
    _print(figures)
    save_figure(plot_comparison(comparison), plot)
    console.print(f"force curves drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def summarise(comparison: Comparison) -> dict[str, Any]:
    """Condense a comparison to the figures that are printed.

    Parameters
    ----------
    comparison
        What `compare_methods` returned.

    Returns
    -------
    dict
        JSON-ready: per motor RMS and peak force, RMS of every contribution, agreement between the methods.
    """
    force = comparison.reference
    shares = {name: _rms(values) for name, values in comparison.contributions.items()}
    return {
        "robot": comparison.robot,
        "legs": [
            {
                "motor": motor,
                "rms": float(_rms(force)[k]),
                "peak": float(np.abs(force[:, k]).max()),
                "rms_contributions": {name: float(values[k]) for name, values in shares.items()},
            }
            for k, motor in enumerate(comparison.motors)
        ],
        "methods": list(comparison.forces),
        "methods_simplified": list(comparison.simplified),
        **comparison.agreement,
        "rms_total": float(np.sqrt(np.mean(force**2))),
        "rms_contributions_total": {
            name: float(np.sqrt(np.mean(values**2))) for name, values in comparison.contributions.items()
        },
        "notes": list(comparison.notes),
    }


def _rms(forces: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(forces**2, axis=0))


def _print(figures: dict[str, Any]) -> None:
    parts = list(figures["rms_contributions_total"])
    table = Table(
        title=f"{figures['robot']}: motor forces, and what each part of the inertia adds to them [N]"
    )
    table.add_column("\nmotor")
    for heading in ("\nRMS", "\npeak", *(f"RMS of\n{part}" for part in parts)):
        table.add_column(heading, justify="right")
    for leg in figures["legs"]:
        row = (leg["rms"], leg["peak"], *(leg["rms_contributions"][part] for part in parts))
        table.add_row(leg["motor"], *(f"{value:.2f}" for value in row))
    table.add_section()
    row = (figures["rms_contributions_total"][part] for part in parts)
    peak = max(leg["peak"] for leg in figures["legs"])
    table.add_row("all", f"{figures['rms_total']:.2f}", f"{peak:.2f}", *(f"{value:.2f}" for value in row))
    table.caption = "\n".join(
        (
            "The parts add up at every instant; their RMS do not.",
            "Largest relative difference between the methods, with the robot's masses:",
            f"{figures['agreement']:.1e} ({', '.join(figures['methods'])});",
            "with massless legs and a point platform:",
            f"{figures['agreement_simplified']:.1e} ({', '.join(figures['methods_simplified'])}).",
        )
    )
    console.print(table)
    for note in figures["notes"]:
        console.print(f"note: {note}", highlight=False, soft_wrap=True)
