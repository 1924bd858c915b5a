"""``simulate``: let a robot move, freely or under a controller that shakes it, and account for its energy."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, parse_numbers, progress_bar, write_json
from stewart_pin.cli.simulated import (
    CONTROLLERS,
    controller_by_name,
    plot_tracking,
    start_of,
    tracking_errors,
)
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.motion.simulation.record import Simulation
from stewart_pin.motion.simulation.simulate import Method
from stewart_pin.motion.simulation.simulate import simulate as run_simulation
from stewart_pin.motion.trajectories import sinusoidal_motion
from stewart_pin.viz.figures import check_picture_path, save_figure


def simulate(
    robot: Annotated[str, typer.Argument(help="Bundled robot or file.")] = "stewart",
    controller: Annotated[str, typer.Option(help=f"One of {', '.join(CONTROLLERS)}.")] = "computed_torque",
    amplitude: Annotated[str, typer.Option(help="Of the shaking along x,y,z [m].")] = "0.02",
    frequencies: Annotated[str, typer.Option(help="Along x,y,z [Hz].")] = "1,3,4.5",
    duration: Annotated[float, typer.Option(help="Length of the run [s].")] = 1.0,
    dt: Annotated[float, typer.Option(help="Step, and period of the controller [s].")] = 1e-3,
    method: Annotated[str, typer.Option(help="'fixed' or a method of SciPy's.")] = "fixed",
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=check_picture_path, help="Picture of the motion.")
    ] = None,
) -> None:
    """Simulate a robot without drift, at rest at home or shaken by a controller."""
    chain = load(robot)
    reference = partial(
        sinusoidal_motion,
        home=platform_pose(chain, chain.q_home),
        amplitude=parse_numbers("--amplitude", amplitude, 3),
        frequency=parse_numbers("--frequencies", frequencies, 3),
    )
    control = controller_by_name(chain, controller, reference, 1 / dt if dt > 0 else 1.0)
    follows = controller not in ("none", "gravity")
    q, v = chain.q_home, np.zeros(chain.nv)
    if follows:
        state = start_of(chain, reference)
        q, v = state.q, state.v
    with progress_bar() as report:
        run = run_simulation(
            chain, q, v, control, duration=duration, dt=dt, method=cast(Method, method), progress=report
        )
    figures = summarise_run(run) | {"robot": chain.name, "controller": controller, "dt": dt, "method": method}
    want = reference(run.time) if follows else None
    if want is not None:
        figures |= tracking_errors(run, want)
    table = Table(title=f"{chain.name}: {controller}, {run.time[-1]:g} s", show_header=False)
    for name, value in figures.items():
        if name != "events":
            table.add_row(name.replace("_", " "), f"{value:.4g}" if isinstance(value, float) else str(value))
    console.print(table)
    for event in run.events[:10]:
        console.print(f"event: {event}", highlight=False, soft_wrap=True)
    if plot is not None:
        save_figure(plot_tracking(run, want), plot)
        console.print(f"motion drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def summarise_run(run: Simulation) -> dict[str, Any]:
    """Condense a run to the figures that are printed.

    Parameters
    ----------
    run
        What was simulated.

    Returns
    -------
    dict
        JSON-ready: how it ended, gap [m], energy account [J], peak effort [N or N m], events.
    """
    account = run.energy + run.dissipated - run.supplied
    return {
        "success": run.success,
        "reason": run.reason,
        "time": float(run.time[-1]),
        "largest_gap": run.largest_gap,
        "energy_change": float(run.energy[-1] - run.energy[0]),
        "work_of_motors": float(run.supplied[-1]),
        "energy_unaccounted": float(np.abs(account - account[0]).max()),
        "peak_effort": float(np.abs(run.tau_motor).max(initial=0.0)),
        "events": [str(event) for event in run.events],
    }
