"""Vibrations to look at: mode shapes, and answers to shaking over the frequency."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Integral
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_number
from stewart_pin.errors import ConvergenceError, InputError
from stewart_pin.mechanics.vibration import FrequencyResponse, Vibration
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_configuration
from stewart_pin.typing import ArrayLike, Configuration
from stewart_pin.viz.figures import new_figure
from stewart_pin.viz.scene import draw_chain, frame_chains, link_placements

_ACROSS = 3
"""Panels in a row."""
_NEXT_TO_NOTHING = 1e-4
"""Share of the largest amplitude of its kind below which an answer is not drawn."""
_SMALLEST = 0.1
"""Share of the amplitude down to which a mode is drawn smaller where its loops cannot be closed."""


def plot_mode_shapes(
    chain: ClosedChain,
    q: ArrayLike,
    vibration: Vibration,
    *,
    modes: Sequence[int] | None = None,
    amplitude: float = 0.15,
) -> Any:
    """Draw natural vibrations: the robot at rest in grey, and at one end of its swing.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration about which it swings [m, rad, unit quaternions].
    vibration
        From `natural_frequencies` there.
    modes
        Which, from 0, the slowest; default: the first six [index].
    amplitude
        Largest entry of the motion, in robot sizes or radians [dimensionless].

    Returns
    -------
    matplotlib.figure.Figure
        The figure; loops are closed at the end of the swing, where they can be.

    Raises
    ------
    InputError
        If there is no such mode, the vibration is one of another chain, or the amplitude is no number.
    MissingExtraError
        If Matplotlib is not installed.
    """
    q, count = as_configuration(chain, "q", q), len(vibration.frequency)
    if len(vibration.shape) != chain.nv:
        raise InputError(
            f"vibration is one of another chain: its motions have {len(vibration.shape)} entries, those of "
            f"'{chain.name}' {chain.nv}; pass what natural_frequencies found for this chain, at this q"
        )
    chosen = range(min(count, 6)) if modes is None else modes
    numbers = isinstance(chosen, Iterable) and all(
        isinstance(k, Integral) and not isinstance(k, bool) and 0 <= k < count for k in chosen
    )
    if not numbers or not len(chosen):
        raise InputError(f"modes must name some of the {count} vibrations, from 0, got {modes!r}")
    amplitude = as_number("amplitude", amplitude)
    across = min(_ACROSS, len(chosen))
    down = -(-len(chosen) // across)
    figure = new_figure(3.6 * across, 3.2 * down + 0.4)
    rest = link_placements(chain, q)
    swung = [
        link_placements(chain, _swung(chain, q, amplitude * vibration.shape[:, mode])) for mode in chosen
    ]
    for number, (mode, frames) in enumerate(zip(chosen, swung, strict=True), start=1):
        axis = figure.add_subplot(down, across, number, projection="3d")
        draw_chain(axis, chain, rest, ghost=True)
        draw_chain(axis, chain, frames)
        frame_chains(axis, chain, [rest, *swung], alone=len(chosen) == 1)
        frequency = vibration.frequency[mode]
        axis.set_title(
            f"{frequency:.3g} Hz" if frequency >= 0 else f"grows, {2 * np.pi * -frequency:.3g} 1/s"
        )
    return figure


def _swung(chain: ClosedChain, q: Configuration, motion: np.ndarray) -> Configuration:
    """Displace a configuration and close its loops again, by less where they do not close."""
    share = 1.0
    while share > _SMALLEST:
        try:
            return close_loops(chain, pin.integrate(chain.model, q, share * motion)).q
        except ConvergenceError:
            share /= 2
    return pin.integrate(chain.model, q, share * motion)


def plot_frequency_response(response: FrequencyResponse, *, inputs: Sequence[str] | None = None) -> Any:
    """Draw amplitude and phase over the frequency (Bode).

    Parameters
    ----------
    response
        From `frequency_response`, at two frequencies or more.
    inputs
        Names of the inputs to draw; default: the first six.

    Returns
    -------
    matplotlib.figure.Figure
        A column per input, amplitudes above and phases below, a line per displacement of the platform that answers.

    Raises
    ------
    InputError
        If an input is unknown, or there are too few frequencies.
    MissingExtraError
        If Matplotlib is not installed.
    """
    names = list(response.inputs[:6] if inputs is None else inputs)
    unknown = [name for name in names if name not in response.inputs]
    if unknown or not names:
        raise InputError(f"inputs must be some of {', '.join(response.inputs)}, got {names}")
    some = response.frequency > 0
    if np.count_nonzero(some) < 2:
        raise InputError("a frequency response needs two frequencies above zero to be drawn")
    figure = new_figure(1.2 + 3.0 * len(names), 5.2)
    axes = figure.subplots(2, len(names), sharex=True, squeeze=False)
    rising = np.flatnonzero(some)[np.argsort(response.frequency[some], kind="stable")]
    frequency, gain, phase = response.frequency[rising], response.gain[rising], response.phase[rising]
    for column, name in enumerate(names):
        k = response.inputs.index(name)
        for row, output in enumerate(response.outputs):
            # Lengths and angles have no common size: what is next to nothing beside its own kind is left out.
            kind = slice(0, 3) if row < 3 else slice(3, 6)
            if gain[:, row, k].max() <= _NEXT_TO_NOTHING * max(gain[:, kind].max(), np.finfo(float).tiny):
                continue
            style = {"color": f"C{row}", "linestyle": "-" if row < 3 else "--", "label": output}
            axes[0, column].loglog(frequency, gain[:, row, k], **style)
            axes[1, column].semilogx(frequency, np.degrees(phase[:, row, k]), **style)
        axes[0, column].set_title(f"from {response.source.replace('_', ' ')} {name}", fontsize=9)
        axes[1, column].set_xlabel("frequency [Hz]")
        for axis in axes[:, column]:
            axis.grid(visible=True, which="both", alpha=0.3)
    unit = {"motor_effort": "per N or N m", "motor_position": "per m or rad", "base": "per m or rad"}
    axes[0, 0].set_ylabel(f"amplitude [m or rad {unit[response.source]}]")
    axes[1, 0].set_ylabel("phase [°]")
    found = {
        label: line for axis in axes[0] for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    drawn = [name for name in response.outputs if name in found]
    figure.legend([found[name] for name in drawn], drawn, loc="outside lower center", ncols=6, frameon=False)
    return figure
