"""``shake``: an earthquake on a shake table: what it asks of the motors, how much fits, what the table then does."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import console, progress_bar, write_json
from stewart_pin.cli.simulate import (
    CONTROLLERS,
    controller_by_name,
    plot_tracking,
    start_of,
    summarise_run,
    tracking_errors,
)
from stewart_pin.errors import InputError
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.motion.accelerograms import Accelerogram, correct_baseline, read_at2, read_columns
from stewart_pin.motion.earthquakes import earthquake_motion, synthetic_accelerogram
from stewart_pin.motion.shake_table import FitReport, fit_to_limits
from stewart_pin.motion.simulation.simulate import simulate
from stewart_pin.motion.trajectories import sample_times
from stewart_pin.viz.figures import check_picture_path, save_figure


def shake(
    robot: Annotated[str, typer.Argument(help="Bundled robot or file.")] = "stewart",
    record: Annotated[Path | None, typer.Option(help="PEER AT2 file, or columns of time and m/s².")] = None,
    seed: Annotated[int, typer.Option(help="Of the synthetic earthquake, without a record.")] = 0,
    axis: Annotated[str, typer.Option(help="World axis x, y or z.")] = "x",
    scale: Annotated[float, typer.Option(help="Factor asked for.")] = 1.0,
    margin: Annotated[float, typer.Option(help="Part of every limit to keep free.")] = 0.1,
    duration: Annotated[float | None, typer.Option(help="Simulated time [s]; default: the record.")] = None,
    controller: Annotated[str, typer.Option(help=f"One of {', '.join(CONTROLLERS)}.")] = "computed_torque",
    dt: Annotated[float, typer.Option(help="Step, and period of the controller [s].")] = 2e-3,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=check_picture_path, help="Picture of the motion.")
    ] = None,
) -> None:
    """Fit an earthquake to the robot's limits, and shake it; controller none: only fit."""
    if controller not in CONTROLLERS:
        raise InputError(f"--controller must be one of {', '.join(CONTROLLERS)}, got {controller!r}")
    chain = load(robot)
    ground = _read(record) if record is not None else synthetic_accelerogram(seed=seed)
    home = platform_pose(chain, chain.q_home)
    times = sample_times(ground.dt * ground.acceleration.size, 1 / ground.dt)
    quake = partial(earthquake_motion, home=home, records={axis: ground})
    fit = fit_to_limits(chain, lambda factor: quake(times, scale=scale * factor), margin=margin)
    figures = _summarise(ground, axis, scale, fit) | {"robot": chain.name, "controller": controller}
    _print(figures)
    if controller != "none":
        reference = partial(quake, scale=scale * fit.scale)
        state = start_of(chain, reference)
        control = controller_by_name(chain, controller, reference, 1 / dt if dt > 0 else 1.0)
        length = times[-1] if duration is None else duration
        length = dt * max(1, round(length / dt)) if dt > 0 else length
        with progress_bar() as report:
            run = simulate(chain, state.q, state.v, control, duration=length, dt=dt, progress=report)
        want = reference(run.time)
        figures |= {"simulation": summarise_run(run) | tracking_errors(run, want)}
        for name, value in tracking_errors(run, want).items():
            console.print(f"{name.replace('_', ' ')}: {value:.3g}", highlight=False)
        if not run.success:
            console.print(f"the run ended early: {run.reason}", highlight=False, soft_wrap=True)
        if plot is not None:
            save_figure(plot_tracking(run, want), plot)
            console.print(f"motion drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def _read(path: Path) -> Accelerogram:
    return correct_baseline(read_at2(path) if path.suffix.lower() == ".at2" else read_columns(path))


def _summarise(ground: Accelerogram, axis: str, scale: float, fit: FitReport) -> dict[str, Any]:
    return {
        "record": ground.name,
        "axis": axis,
        "peak_acceleration": float(np.abs(ground.acceleration).max()) * scale,
        "scale_asked": scale,
        "scale_fitted": scale * fit.scale,
        "margin": fit.margin,
        "binding": None if fit.binding is None else asdict(fit.binding),
        "at_full_scale": [asdict(binding) for binding in fit.unscaled],
        "looked_at": {kind: list(names) for kind, names in fit.looked_at.items()},
    }


def _print(figures: dict[str, Any]) -> None:
    table = Table(title=f"{figures['robot']}: {figures['record']} along {figures['axis']}")
    for heading in ("limit", "joint", "at [s]", "asked for", "allowed", "use"):
        table.add_column(heading, justify="left" if heading in ("limit", "joint") else "right")
    for limit in figures["at_full_scale"]:
        numbers = (
            f"{limit['time']:.3f}",
            f"{limit['value']:.4g}",
            f"{limit['allowed']:.4g}",
            f"{limit['use']:.3f}",
        )
        table.add_row(limit["limit"], limit["motor"], *numbers)
    binding = figures["binding"]
    nearest = "" if binding is None else f"; nearest limit then: {binding['limit']} of {binding['motor']}"
    table.caption = (
        f"at scale {figures['scale_asked']:g}; all limits hold, with a margin of {figures['margin']:g}, at scale "
        f"{figures['scale_fitted']:.4g}{nearest}; looked at: "
        + ", ".join(f"{kind} of {len(names)}" for kind, names in figures["looked_at"].items())
        + " joints"
    )
    console.print(table)
