"""Motor forces of a shaking platform.

``compare``: the main job. By every method, in one table and one picture. ``sweep``: what shaking at every amplitude and
frequency asks of the motors.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from stewart_pin.building.loading import load
from stewart_pin.cli.output import (
    WRENCH_HELP,
    console,
    parse_numbers,
    parse_range,
    parse_wrenches,
    progress_bar,
    write_json,
)
from stewart_pin.errors import InputError
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.model.description import JointKind
from stewart_pin.motion.trajectories import PlatformSamples, sample_times, sinusoidal_motion
from stewart_pin.state.chain import ClosedChain
from stewart_pin.studies.answers import Sweep
from stewart_pin.studies.comparison import Comparison, compare_methods
from stewart_pin.studies.demand_sweep import sweep_demand
from stewart_pin.viz.figures import check_picture_path, plot_comparison, save_figure
from stewart_pin.viz.sweep_picture import plot_sweep


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
    figures = summarise_comparison(comparison)
    figures["motion"] = {
        "amplitude": amplitude, "frequencies": frequencies, "duration": duration, "rate": rate, "states": len(samples),
    }  # fmt: skip
    _print_comparison(figures)
    save_figure(plot_comparison(comparison), plot)
    console.print(f"force curves drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def summarise_comparison(comparison: Comparison) -> dict[str, Any]:
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


def _print_comparison(figures: dict[str, Any]) -> None:
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


# ----------------------------------------------------------------------------------------------------
# ``sweep``
# ----------------------------------------------------------------------------------------------------

_SHOWN = {
    "peak_effort": "effort",
    "rms_effort": "RMS effort",
    "travel": "travel",
    "peak_rate": "rate",
    "peak_power": "power",
    "mean_power": "mean power",
}
_MOST_WORKERS = 1024


def sweep(
    robot: Annotated[str, typer.Argument(help="Bundled robot or file.")] = "stewart",
    amplitude: Annotated[
        str | None,
        typer.Option(
            help="LOW:HIGH:COUNT in equal ratios, or numbers [m]; default: 0.1 to 10 % of the robot's size."
        ),
    ] = None,
    frequency: Annotated[
        str, typer.Option(help="LOW:HIGH:COUNT in equal ratios, or numbers [Hz].")
    ] = "0.5:10:20",
    axis: Annotated[str, typer.Option(help="World axis x, y or z.")] = "x",
    instants: Annotated[int, typer.Option(help="Instants of a period.")] = 100,
    linear: Annotated[bool, typer.Option(help="Equal steps instead of equal ratios.")] = False,
    kernels: Annotated[
        bool | None, typer.Option(help="Compiled kernels; default: where there are enough states.")
    ] = None,
    wrench: Annotated[list[str] | None, typer.Option(help=WRENCH_HELP)] = None,
    workers: Annotated[int, typer.Option(help="Processes that share the work.")] = 1,
    journal: Annotated[
        Path | None, typer.Option(help="Keep what is done in this file; if it exists, go on from there.")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="Write all figures to this file.")] = None,
    plot: Annotated[Path | None, typer.Option(callback=check_picture_path, help="Map of one figure.")] = None,
    show: Annotated[str, typer.Option(help=f"Figure on the map: {', '.join(_SHOWN)}.")] = "peak_effort",
) -> None:
    """Map what shaking a platform at every amplitude and frequency asks of the motors."""
    if axis not in ("x", "y", "z"):
        raise InputError(f"--axis must be x, y or z, got {axis!r}")
    if show not in _SHOWN:
        raise InputError(f"--show must be one of {', '.join(_SHOWN)}, got {show!r}")
    if not 4 <= instants <= 1_000_000:
        raise InputError(f"--instants must be 4 to 1 000 000, got {instants}")
    chain = load(robot)
    size = chain.length_scale
    axes = {
        "amplitude": parse_range(
            "--amplitude", amplitude or f"{0.001 * size!r}:{0.1 * size!r}:20", linear=linear
        ),
        "frequency": parse_range("--frequency", frequency, linear=linear),
    }
    if (axes["frequency"] <= 0).any():
        raise InputError(f"--frequency must be above zero, got {axes['frequency'].min():g}")
    motion = partial(_shaken, axis=axis, instants=instants)
    with _told_how_to_go_on(journal), _workers(workers) as executor, progress_bar() as report:
        found = sweep_demand(
            chain,
            motion,
            axes,
            kernels=kernels,
            limits=True,
            wrenches=parse_wrenches(wrench),
            executor=executor,
            journal=journal,
            progress=report,
        )
    figures = {"robot": chain.name, "axis": axis, "instants": instants, **summarise_sweep(chain, found)}
    _print_sweep(chain, found, figures)
    if plot is not None:
        units = _units(chain)
        words = {"amplitude": f"amplitude along {axis} [m]", "frequency": "frequency [Hz]"}
        words |= {name: f"largest {label} of a motor [{units[name]}]" for name, label in _SHOWN.items()}
        ax = plot_sweep(found, show, labels=words)
        ax.set_title(f"{chain.name}: shaking along {axis}")
        save_figure(ax.figure, plot)
        console.print(f"map drawn in {plot}", highlight=False, soft_wrap=True)
    write_json(json, figures)


def _shaken(
    chain: ClosedChain, amplitude: float, frequency: float, *, axis: str, instants: int
) -> PlatformSamples:
    along = np.array([name == axis for name in "xyz"], dtype=float)
    return sinusoidal_motion(
        np.arange(instants) / (instants * frequency),
        home=platform_pose(chain, chain.q_home),
        amplitude=amplitude * along,
        frequency=frequency * along,
    )


@contextmanager
def _told_how_to_go_on(journal: Path | None) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        if journal is not None:
            console.print(
                f"what was done is kept in {journal}; the same command goes on from there", soft_wrap=True
            )
        raise


@contextmanager
def _workers(count: int) -> Iterator[Executor | None]:
    if not 1 <= count <= _MOST_WORKERS:
        raise InputError(f"--workers must be 1 to {_MOST_WORKERS}, got {count}")
    if count == 1:
        yield None
        return
    # A fork would copy the thread that draws the progress bar. An interrupt is this process's affair.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, context, signal.signal, (signal.SIGINT, signal.SIG_IGN)) as pool:
        yield pool


def summarise_sweep(chain: ClosedChain, found: Sweep) -> dict[str, Any]:
    """Condense a sweep to JSON-ready figures.

    Parameters
    ----------
    chain
        The robot.
    found
        Sweep of its demands.

    Returns
    -------
    dict
        Axes, motors, all results (None where there is none), points within the limits of the file, failures.
    """
    return {
        "axes": {name: values.tolist() for name, values in found.axes.items()},
        "motors": list(chain.motors),
        "results": {
            name: _with_none(values.tolist())
            for name, values in found.results.items()
            if name != "within_limits"
        },
        "within_limits": int(np.nansum(found["within_limits"])) if found.results else 0,
        "points": int(np.prod(found.shape)),
        "failures": [
            {**failed.point, "error": failed.error, "message": failed.message} for failed in found.failures
        ],
    }


def _with_none(values: Any) -> Any:
    """Write nan as None, for JSON has none."""
    if isinstance(values, list):
        return [_with_none(value) for value in values]
    return None if np.isnan(values) else values


def _units(chain: ClosedChain) -> dict[str, str]:
    sliding = {chain.mechanism.joint(name).kind is JointKind.PRISMATIC for name in chain.motors}

    def unit(of_slides: str, of_hinges: str) -> str:
        return " or ".join(
            u for u, is_slide in ((of_slides, True), (of_hinges, False)) if is_slide in sliding
        )

    effort, length = unit("N", "N m"), unit("m", "rad")
    units = {"peak_effort": effort, "rms_effort": effort, "travel": length, "peak_rate": unit("m/s", "rad/s")}
    return units | {"peak_power": "W", "mean_power": "W"}


def _print_sweep(chain: ClosedChain, found: Sweep, figures: dict[str, Any]) -> None:
    if not found.results and found.failures:
        found["peak_effort"]  # raises with the reason of the first point
    shape = " × ".join(map(str, found.shape))
    table = Table(
        title=f"{escape(chain.name)}: {shape} sinusoids along {figures['axis']}, worst motor of each"
    )
    for heading in ("figure", "least", "greatest", "by motor", "at [m]", "at [Hz]"):
        table.add_column(escape(heading), justify="left" if heading in ("figure", "by motor") else "right")
    units = _units(chain)
    for name, label in _SHOWN.items():
        values = found[name]
        worst = values.max(axis=-1)
        *index, motor = np.unravel_index(int(np.nanargmax(values)), values.shape)
        place = [f"{axis[i]:.4g}" for axis, i in zip(found.axes.values(), index, strict=True)]
        least, greatest = f"{np.nanmin(worst):.4g}", f"{np.nanmax(worst):.4g}"
        row = f"{label} [{units[name]}]", least, greatest, chain.motors[motor], *place
        table.add_row(*map(escape, row))
    table.caption = (
        f"{figures['within_limits']} of {figures['points']} points are within the limits of the file, passive joints "
        "included."
    )
    console.print(table)
    if found.failures:
        first = found.failures[0]
        console.print(
            f"{len(found.failures)} points have no answer; the first, amplitude {first.point['amplitude']:.4g} m at "
            f"{first.point['frequency']:.4g} Hz: {first.message}",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
