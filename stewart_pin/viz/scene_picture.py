"""Surfaces of a robot as a shaded Matplotlib picture: for notebooks and machines without a screen."""

from __future__ import annotations

from typing import Any

import numpy as np

from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray
from stewart_pin.viz.figures import new_figure
from stewart_pin.viz.scene import build_scene

_LIGHT = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
_DARKEST = 0.45
_MOST_FACES = 20_000
"""Faces that Matplotlib draws in a second or so."""


def plot_scene(chain: ClosedChain, q: ArrayLike | None = None) -> Any:
    """Draw the surfaces of a robot, shaded.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration, loops closed or open; default: home [m, rad, unit quaternions].

    Returns
    -------
    matplotlib.figure.Figure
        The figure; of meshes with very many faces, every second, third, ... face is drawn.

    Raises
    ------
    MissingExtraError
        If Matplotlib or yourdfpy is not installed.
    FileMissingError
        If a mesh that the URDF names does not exist.
    """
    figure = new_figure(6.4, 6.0)
    triangles, colours = _triangles(build_scene(chain, q))
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: PLC0415 - optional

    axis = figure.add_subplot(projection="3d")
    step = -(-len(triangles) // _MOST_FACES) or 1
    axis.add_collection3d(Poly3DCollection(triangles[::step], facecolors=colours[::step], edgecolors="none"))
    corners = triangles.reshape(-1, 3) if len(triangles) else np.zeros((1, 3))
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = np.maximum(high - low, 0.15 * max(float((high - low).max()), 1e-9))
    for name, middle, size in zip("xyz", (low + high) / 2, extent, strict=True):
        axis.set(
            **{f"{name}lim": (middle - 0.52 * size, middle + 0.52 * size), f"{name}label": f"{name} [m]"}
        )
        axis.locator_params(axis=name, nbins=4)
    axis.set_box_aspect(extent, zoom=0.9)
    axis.tick_params(labelsize=8)
    axis.set_title(chain.name)
    axis.view_init(elev=22, azim=-55)
    return figure


def _triangles(scene: Any) -> tuple[FloatArray, FloatArray]:
    """All faces of a scene in the world (n, 3, 3) [m], and their shaded colours (n, 4)."""
    triangles, colours = [np.zeros((0, 3, 3))], [np.zeros((0, 4))]
    for node in scene.graph.nodes_geometry:
        placement, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not hasattr(mesh, "faces"):
            continue
        corners = mesh.vertices @ placement[:3, :3].T + placement[:3, 3]
        triangles.append(corners[mesh.faces])
        plain = mesh.visual.face_colors if mesh.visual.kind in ("face", "vertex") else None
        shown = np.tile([150, 150, 150, 255], (len(mesh.faces), 1)) if plain is None else np.asarray(plain)
        colours.append(shown / 255.0)
    faces, tints = np.concatenate(triangles), np.concatenate(colours)
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facing = np.abs(normals @ _LIGHT) / np.where(lengths[:, 0] > 0, lengths[:, 0], 1.0)
    tints[:, :3] *= (_DARKEST + (1 - _DARKEST) * facing)[:, None]
    return faces, tints
