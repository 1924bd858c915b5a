"""Velocity and force polytopes as solids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.mechanics.capability.polytope import Polytope, inscribed_ball
from stewart_pin.viz.figures import new_figure


def plot_polytopes(polytopes: Sequence[Polytope], *, titles: Sequence[str] = (), ball: bool = True) -> Any:
    """Draw three-dimensional polytopes side by side, their faces coloured by the joint that limits.

    Parameters
    ----------
    polytopes
        With three coordinates each; see `polytope_section` and `polytope_projection`.
    titles
        One for each, or none.
    ball
        Whether the largest ball about rest and the worst direction are drawn, where zero lies inside. The axes have
        their own scales, so the ball may look like an ellipsoid.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        If a polytope has not three coordinates, or the number of titles does not fit.
    """
    for polytope in polytopes:
        if len(polytope.names) != 3:
            raise InputError(
                f"a polytope to be drawn must have 3 coordinates, got {len(polytope.names)}; "
                "use polytope_section or polytope_projection"
            )
    if not polytopes:
        raise InputError("polytopes must hold at least one polytope")
    if titles and len(titles) != len(polytopes):
        raise InputError(f"titles must be {len(polytopes)} strings, got {len(titles)}")
    figure = new_figure(4.8 * len(polytopes), 4.9)
    axes = figure.subplots(1, len(polytopes), subplot_kw={"projection": "3d"}, squeeze=False)[0]
    joints: dict[str, str] = {}
    for k, (axis, polytope) in enumerate(zip(axes, polytopes, strict=True)):
        _draw(axis, polytope, joints, ball=ball)
        if titles:
            axis.set_title(titles[k], fontsize=10)
    _legend(figure, joints)
    return figure


def _draw(axis: Any, polytope: Polytope, joints: dict[str, str], *, ball: bool) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: PLC0415 - optional; new_figure has checked

    size = np.abs(polytope.vertices * polytope.scale).max()
    for normal, offset, limit in zip(polytope.normals, polytope.offsets, polytope.limits, strict=True):
        corners = polytope.vertices[np.abs(polytope.vertices @ normal - offset) < 1e-7 * size]
        if len(corners) < 3:
            continue
        joint = limit.split(" at ")[0] or "several motors"
        colour = joints.setdefault(joint, f"C{len(joints)}")
        face = Poly3DCollection([_around(corners, normal)], facecolor=colour, edgecolor="0.25", linewidth=0.7)
        face.set_alpha(0.35)
        axis.add_collection3d(face)
    largest = inscribed_ball(polytope)
    if ball and largest.radius > 0:
        u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi, 17))
        unit = np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
        points = largest.radius * unit / polytope.scale[:, None, None]
        axis.plot_surface(*points, color="0.2", alpha=0.35, linewidth=0)
        axis.plot(*np.array([np.zeros(3), largest.direction]).T, color="k", linewidth=2)
    axis.scatter(0, 0, 0, color="k", s=8)
    low, high = polytope.vertices.min(axis=0), polytope.vertices.max(axis=0)
    margin = 0.02 * np.maximum(high - low, 0.05 * (high - low).max())
    labels = [f"{name} [{unit}]" for name, unit in zip(polytope.names, polytope.units, strict=True)]
    for name, start, end, label in zip("xyz", low - margin, high + margin, labels, strict=True):
        axis.set(**{f"{name}lim": (start, end), f"{name}label": label})
        axis.locator_params(axis=name, nbins=5)
    # Sets ten times longer than wide are usual: true proportions would hide them, so the axes differ in scale.
    extent = (high - low) * polytope.scale
    axis.set_box_aspect(np.clip(extent / extent.max(), 0.6, 1.0), zoom=0.85)
    axis.tick_params(labelsize=8)
    axis.view_init(elev=22, azim=-55)


def _around(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Put the corners of a face in order around its middle."""
    out = corners - corners.mean(axis=0)
    across = np.cross(normal, out[0])
    angle = np.arctan2(
        out @ across / np.linalg.norm(across), out @ np.cross(across, normal) / np.linalg.norm(across)
    )
    return corners[np.argsort(angle)]


def _legend(figure: Any, joints: dict[str, str]) -> None:
    from matplotlib.patches import Patch  # noqa: PLC0415 - optional; new_figure has checked

    handles = [Patch(color=colour, alpha=0.5, label=joint) for joint, colour in sorted(joints.items())]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=max(1, min(8, len(handles))), frameon=False
    )
