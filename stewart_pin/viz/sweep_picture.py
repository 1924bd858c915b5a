"""Results of sweeps: a curve over one parameter, a map over two, with lines where a bound is met."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.studies.answers import Sweep
from stewart_pin.typing import ArrayLike, FloatArray
from stewart_pin.viz.figures import new_figure

_LOGARITHMIC = 30.0
"""Ratio of the largest to the smallest value above which colours are spread evenly over the ratios."""
_COLOURS = ("white", "C1", "C3", "C9")
_NO_ANSWER = "0.8"


def plot_sweep(
    found: Sweep,
    values: str | ArrayLike,
    *,
    at: Mapping[str, Any] | None = None,
    lines: Mapping[str, tuple[str | ArrayLike, float]] | None = None,
    labels: Mapping[str, str] | None = None,
    ax: Any = None,
) -> Any:
    """Draw a result over the one or two parameters of a sweep.

    The first parameter of two runs upwards, the second to the right. Axes are logarithmic where the values along them
    have equal ratios; so are colours where results differ by more than a factor of thirty. Points without an answer
    stay grey. A list of points is drawn as dots.

    Parameters
    ----------
    found
        The sweep.
    values
        Name of a result, of which the largest entry is drawn where it has several, as of all motors; or an array of the
        grid's shape [any unit].
    at
        Values of further parameters, of which the picture is a cut.
    lines
        By its label, a result and the level at which a line is drawn; for a curve only the level counts [any unit].
    labels
        What to write instead of the names of parameters and of the result, such as ``"frequency [Hz]"``.
    ax
        Axes to draw on; a new figure if None.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; a map has a colour bar beside it.

    Raises
    ------
    InputError
        If there is no such result, an array does not fit the grid, or other than one or two parameters are left.
    """
    cut, axes = _cut(found, at or {})
    field = _field(found, values)[cut]
    words = dict(labels or {})
    title = words.get(values, values) if isinstance(values, str) else words.get("", "")
    if ax is None:
        ax = new_figure(7.2, 4.6).subplots()
    names = list(axes)
    if found.paired:
        _dots(ax, axes, field, title)
    elif len(names) == 1:
        _curve(ax, axes[names[0]], field, title, lines or {})
    else:
        fields = {label: (_field(found, of)[cut], level) for label, (of, level) in (lines or {}).items()}
        _map(ax, axes, field, title, fields)
    ax.set_xlabel(words.get(names[-1], names[-1]))
    if len(names) == 2:
        ax.set_ylabel(words.get(names[0], names[0]))
    return ax


def _cut(found: Sweep, at: Mapping[str, Any]) -> tuple[tuple[Any, ...], dict[str, np.ndarray]]:
    """Index of the cut, and the axes that are left."""
    if unknown := [name for name in at if name not in found.axes]:
        raise InputError(f"at names {unknown[0]!r}; the parameters are {', '.join(found.axes)}")
    left = {name: values for name, values in found.axes.items() if name not in at}
    if len(left) not in (1, 2) or (found.paired and at):
        raise InputError(
            f"a picture has one or two parameters, this one {', '.join(left) or 'none'}; choose values of others "
            "by at={name: value}" + (", which a list of points does not allow" if found.paired else "")
        )
    if found.paired:
        return (slice(None),), left
    every = slice(None)
    cut = [_place(name, x, at[name]) if name in at else every for name, x in found.axes.items()]
    return tuple(cut), left


def _place(name: str, values: np.ndarray, value: Any) -> int:
    """Index of a value of a parameter."""
    same = values == value if values.dtype.kind == "U" else np.isclose(values, value, atol=0.0)
    if not np.any(same):
        listed = ", ".join(map(str, values.tolist()[:12]))
        raise InputError(f"at: {name} has no value {value!r}; it has {listed}")
    return int(np.argmax(same))


def _field(found: Sweep, values: str | ArrayLike) -> FloatArray:
    array = found[values] if isinstance(values, str) else np.asarray(values, dtype=float)
    shape = found.shape
    if array.shape[: len(shape)] != shape or (not isinstance(values, str) and array.shape != shape):
        raise InputError(f"values must have the shape {shape} of the grid, got {array.shape}")
    return array.reshape(*shape, -1).max(axis=-1) if array.size else array


def _curve(
    ax: Any, along: np.ndarray, field: FloatArray, title: str, lines: Mapping[str, tuple[Any, float]]
) -> None:
    ax.plot(*_positions(ax, "x", along), field, "o-", markersize=3)
    ax.set_ylabel(title)
    for k, (label, (_, level)) in enumerate(lines.items()):
        ax.axhline(level, color=_COLOURS[1:][k % 3], linewidth=1.0, label=label)
    if lines:
        ax.legend(frameon=False, fontsize=9)


def _dots(ax: Any, axes: Mapping[str, np.ndarray], field: FloatArray, title: str) -> None:
    names = list(axes)
    across = _positions(ax, "x", axes[names[-1]])[0]
    if len(names) == 1:
        ax.plot(across, field, "o", markersize=4)
        ax.set_ylabel(title)
        return
    upwards = _positions(ax, "y", axes[names[0]])[0]
    lost = np.isnan(field)
    ax.plot(across[lost], upwards[lost], "x", color=_NO_ANSWER, zorder=0)
    dots = ax.scatter(across[~lost], upwards[~lost], c=field[~lost], norm=_norm(field), cmap="viridis", s=18)
    ax.figure.colorbar(dots, ax=ax, label=title)


def _map(
    ax: Any,
    axes: Mapping[str, np.ndarray],
    field: FloatArray,
    title: str,
    lines: Mapping[str, tuple[FloatArray, float]],
) -> None:
    upwards, across = axes.values()
    x, y = _positions(ax, "x", across)[0], _positions(ax, "y", upwards)[0]
    ax.set_facecolor(_NO_ANSWER)
    edges = _edges(x, ax.get_xscale() == "log"), _edges(y, ax.get_yscale() == "log")
    picture = ax.pcolormesh(*edges, field, norm=_norm(field), cmap="viridis", rasterized=True)
    ax.figure.colorbar(picture, ax=ax, label=title)
    if np.isnan(field).any():
        from matplotlib.patches import Patch  # noqa: PLC0415 - optional

        ax.legend(handles=[Patch(color=_NO_ANSWER, label="no answer")], loc="upper left", fontsize=8)
    for k, (label, (values, level)) in enumerate(lines.items()):
        finite = values[np.isfinite(values)]
        if min(values.shape) < 2 or not finite.size or not finite.min() < level < finite.max():
            continue  # no line through a single row, nor where the level is not met
        contour = ax.contour(x, y, values, levels=[level], colors=[_COLOURS[k % len(_COLOURS)]])
        for text in ax.clabel(contour, fmt={level: label}, fontsize=9, colors="black", inline=False):
            text.set_bbox({"facecolor": "white", "alpha": 0.8, "pad": 1.0, "linewidth": 0})


def _positions(ax: Any, side: str, values: np.ndarray) -> tuple[FloatArray]:
    """Put values on an axis: words in their order, equal ratios on a logarithmic one."""
    axis = getattr(ax, f"{side}axis")
    if values.dtype.kind == "U":
        places = np.arange(float(values.size))
        axis.set_ticks(places, labels=values.tolist())
        return (places,)
    if _has_equal_ratios(values):
        from matplotlib.ticker import LogLocator, NullFormatter  # noqa: PLC0415 - optional

        getattr(ax, f"set_{side}scale")("log")
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    return (values.astype(float),)


def _has_equal_ratios(values: np.ndarray) -> bool:
    """Whether numbers grow by a factor; of random ones, whether they spread over the decades."""
    sizes = np.sort(values.astype(float))
    if sizes.size < 3 or sizes[0] <= 0 or sizes[-1] < 3 * sizes[0]:
        return False
    steps, ratios = np.diff(sizes), np.diff(np.log(sizes))
    return bool(np.ptp(ratios) / ratios.mean() < np.ptp(steps) / steps.mean())


def _edges(centres: FloatArray, logarithmic: bool) -> FloatArray:
    """Borders of cells halfway between their centres."""
    places = np.log(centres) if logarithmic else centres
    if places.size == 1:
        return np.array([places[0] - 0.5, places[0] + 0.5])
    middle = (places[1:] + places[:-1]) / 2
    edges = np.concatenate([[2 * places[0] - middle[0]], middle, [2 * places[-1] - middle[-1]]])
    return np.exp(edges) if logarithmic else edges


def _norm(field: FloatArray) -> str | None:
    finite = field[np.isfinite(field)]
    return "log" if finite.size and finite.min() > 0 and finite.max() > _LOGARITHMIC * finite.min() else None
