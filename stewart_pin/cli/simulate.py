"""``simulate``: let a robot move, freely or under a controller that shakes it, and account for its energy.

``shake``: an earthquake on a shake table: what it asks of the motors, how much fits, what the table then does. What
both need stands first.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import (
    WRENCH_HELP,
    console,
    parse_numbers,
    parse_wrenches,
    progress_bar,
    write_json,
)
from stewart_pin.errors import InputError
from stewart_pin.mechanics.kinematics import platform_motion, platform_pose
from stewart_pin.motion.control import (
    ComputedTorque,
    Feedforward,
    GravityCompensation,
    LegPID,
    Reference,
    SampledController,
)
from stewart_pin.motion.earthquakes import (
    Accelerogram,
    correct_baseline,
    earthquake_motion,
    read_at2,
    read_columns,
    synthetic_accelerogram,
)
from stewart_pin.motion.shake_table import FitReport, fit_to_limits
from stewart_pin.motion.simulation.record import Simulation
from stewart_pin.motion.simulation.simulate import Method
from stewart_pin.motion.simulation.simulate import simulate as run_simulation
from stewart_pin.motion.trajectories import PlatformSamples, sample_times, sinusoidal_motion
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.viz.figures import check_picture_path, new_figure, save_figure

# ----------------------------------------------------------------------------------------------------
# What ``simulate`` and ``shake`` share: controllers by name, tracking errors, the picture
# ----------------------------------------------------------------------------------------------------

CONTROLLERS = ("none", "gravity", "leg_pid", "point_mass", "full_feedforward", "computed_torque")


def controller_by_name(chain: ClosedChain, name: str, reference: Reference, rate: float) -> Any:
    """Build a controller that acts at a rate.

    Parameters
    ----------
    chain
        Closed chain.
    name
        One of `CONTROLLERS`.
    reference
        Motion of the platform.
    rate
        Instants per second [1/s].

    Returns
    -------
    SampledController or None
        None for ``"none"``.

    Raises
    ------
    InputError
        If there is no such controller.
    """
    match name:
        case "none":
            return None
        case "gravity":
            inner = GravityCompensation(chain)
        case "leg_pid":
            inner = LegPID(chain, reference, feedforward=GravityCompensation(chain))
        case "point_mass" | "full_feedforward":
            model = "full" if name == "full_feedforward" else name
            inner = LegPID(chain, reference, feedforward=Feedforward(chain, reference, model))
        case "computed_torque":
            inner = ComputedTorque(chain, reference)
        case _:
            raise InputError(f"--controller must be one of {', '.join(CONTROLLERS)}, got {name!r}")
    return SampledController(chain, inner, rate=rate)


def start_of(chain: ClosedChain, reference: Reference) -> State:
    """Put the chain on the start of a motion.

    Parameters
    ----------
    chain
        Closed chain.
    reference
        Motion of the platform.

    Returns
    -------
    State
        Configuration, velocity and acceleration at time 0.
    """
    want = reference(np.zeros(1))
    return platform_motion(chain, want.pose(0), want.twist[0], want.acceleration[0])


def tracking_errors(run: Simulation, want: PlatformSamples) -> dict[str, float]:
    """Measure how far the platform was from its command.

    Parameters
    ----------
    run
        What it did.
    want
        What it should have done, at the same instants.

    Returns
    -------
    dict
        RMS over time of the errors' norms [m, m/s, m/s²].
    """
    assert run.platform is not None  # the command was one for a platform
    parts = {
        "position": run.platform.position - want.position,
        "velocity": run.platform.twist[:, :3] - want.twist[:, :3],
        "acceleration": run.platform.acceleration[:, :3] - want.acceleration[:, :3],
    }
    return {f"rms_{name}_error": float(np.sqrt(np.mean((x**2).sum(axis=1)))) for name, x in parts.items()}


def plot_tracking(run: Simulation, want: PlatformSamples | None) -> Any:
    """Draw displacement, velocity and acceleration of the platform, and the motor efforts.

    Parameters
    ----------
    run
        What the platform did.
    want
        What it should have done, or None.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    figure = new_figure(9.0, 8.0)
    axes = figure.subplots(4, 1, sharex=True)
    assert run.platform is not None
    did = (
        1e3 * (run.platform.position - run.platform.position[0]),
        run.platform.twist,
        run.platform.acceleration,
    )
    should = None
    if want is not None:
        should = (1e3 * (want.position - run.platform.position[0]), want.twist, want.acceleration)
    labels = ("displacement [mm]", "velocity [m/s]", "acceleration [m/s²]")
    for row, (axis, label) in enumerate(zip(axes, labels, strict=False)):
        for k, name in enumerate("xyz"):
            axis.plot(run.time, did[row][:, k], color=f"C{k}", linewidth=1.0, label=name)
            if should is not None:
                axis.plot(run.time, should[row][:, k], color="k", linewidth=0.7, linestyle=":")
        axis.set_ylabel(label)
    axes[0].legend(ncols=3, frameon=False, loc="upper right")
    axes[0].set_title(
        "platform: simulated (colours)" + (" and commanded (dotted)" if should else ""), fontsize=10
    )
    axes[3].plot(run.time, run.tau_motor, linewidth=0.8)
    axes[3].set_ylabel("motor efforts [N or N m]")
    axes[3].set_xlabel("time [s]")
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure


# ----------------------------------------------------------------------------------------------------


def simulate(
    robot: Annotated[str, typer.Argument(help="Bundled robot or file.")] = "stewart",
    controller: Annotated[str, typer.Option(help=f"One of {', '.join(CONTROLLERS)}.")] = "computed_torque",
    amplitude: Annotated[str, typer.Option(help="Of the shaking along x,y,z [m].")] = "0.02",
    frequencies: Annotated[str, typer.Option(help="Along x,y,z [Hz].")] = "1,3,4.5",
    duration: Annotated[float, typer.Option(help="Length of the run [s].")] = 1.0,
    dt: Annotated[float, typer.Option(help="Step, and period of the controller [s].")] = 1e-3,
    method: Annotated[str, typer.Option(help="'fixed' or a method of SciPy's.")] = "fixed",
    wrench: Annotated[list[str] | None, typer.Option(help=WRENCH_HELP)] = None,
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
            chain,
            q,
            v,
            control,
            duration=duration,
            dt=dt,
            method=cast(Method, method),
            wrenches=parse_wrenches(wrench),
            progress=report,
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
    return {
        "success": run.success,
        "reason": run.reason,
        "time": float(run.time[-1]),
        "largest_gap": run.largest_gap,
        "energy_change": float(run.energy[-1] - run.energy[0]),
        "work_of_motors": float(run.supplied[-1]),
        "heat": float(run.dissipated[-1]),
        "energy_unaccounted": float(np.abs(run.audit.unexplained).max()),
        "peak_effort": float(np.abs(run.tau_motor).max(initial=0.0)),
        "events": [str(event) for event in run.events],
    }


# ----------------------------------------------------------------------------------------------------
# ``shake``
# ----------------------------------------------------------------------------------------------------


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
    wrench: Annotated[list[str] | None, typer.Option(help=WRENCH_HELP)] = None,
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
    wrenches = parse_wrenches(wrench)
    fit = fit_to_limits(
        chain, lambda factor: quake(times, scale=scale * factor), margin=margin, wrenches=wrenches
    )
    figures = _summarise_shake(ground, axis, scale, fit) | {"robot": chain.name, "controller": controller}
    _print_shake(figures)
    if controller != "none":
        reference = partial(quake, scale=scale * fit.scale)
        state = start_of(chain, reference)
        control = controller_by_name(chain, controller, reference, 1 / dt if dt > 0 else 1.0)
        length = times[-1] if duration is None else duration
        length = dt * max(1, round(length / dt)) if dt > 0 else length
        with progress_bar() as report:
            run = run_simulation(
                chain,
                state.q,
                state.v,
                control,
                duration=length,
                dt=dt,
                wrenches=wrenches,
                progress=report,
            )
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


def _summarise_shake(ground: Accelerogram, axis: str, scale: float, fit: FitReport) -> dict[str, Any]:
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


def _print_shake(figures: dict[str, Any]) -> None:
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
