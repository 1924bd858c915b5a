"""What ``simulate`` and ``shake`` share: controllers by name, tracking errors, the picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.mechanics.kinematics import platform_motion
from stewart_pin.motion.control import (
    ComputedTorque,
    Feedforward,
    GravityCompensation,
    LegPID,
    Reference,
    SampledController,
)
from stewart_pin.motion.simulation.record import Simulation
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.viz.figures import new_figure

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
