"""Shapes of MuJoCo's compiled model: what its viewer shows, and what would touch other bodies.

A ``<geom>`` of the groups 0 to 2 is seen; one that may touch others, or of group 3, is a collision shape; many are
both. Meshes are not opened: their files are named as the MJCF does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from stewart_pin.model.description import Note
from stewart_pin.model.formats.mjcf.asides import GeomSource
from stewart_pin.model.formats.mjcf.compiling import import_mujoco
from stewart_pin.model.formats.mjcf.names import given_names
from stewart_pin.model.formats.mjcf.placements import placement_of
from stewart_pin.model.shapes import Material, Shape, ShapeKind

_COLLISIONS = 3
"""First group that MuJoCo's viewer does not show, and that of collision shapes."""


@dataclass(frozen=True, eq=False)
class BodyShapes:
    """Shapes by body.

    Attributes
    ----------
    visuals, collisions
        Shapes of every body, by MuJoCo's number.
    notes
        What was left out.
    """

    visuals: Mapping[int, tuple[Shape, ...]]
    collisions: Mapping[int, tuple[Shape, ...]]
    notes: tuple[Note, ...]


def read_shapes(model: Any, sources: Mapping[int, GeomSource]) -> BodyShapes:
    """Read all geoms.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    sources
        What the compiled model does not tell of its geoms.

    Returns
    -------
    BodyShapes
        Shapes by body.
    """
    visuals: dict[int, tuple[Shape, ...]] = {}
    collisions: dict[int, tuple[Shape, ...]] = {}
    notes: list[Note] = []
    for k, name in enumerate(given_names(model, "geom", model.ngeom)):
        body, group = int(model.geom_bodyid[k]), int(model.geom_group[k])
        shape = _shape(model, k, name, sources[k])
        if isinstance(shape, str):
            notes.append(Note(f"geom '{name or k + 1}'", shape))
            continue
        seen = group < _COLLISIONS
        touches = bool(model.geom_contype[k] or model.geom_conaffinity[k]) or group == _COLLISIONS
        if seen:
            visuals[body] = (*visuals.get(body, ()), shape)
        if touches:
            collisions[body] = (*collisions.get(body, ()), shape)
        if not (seen or touches):
            notes.append(Note(f"geom '{name or k + 1}'", f"of group {group}: neither seen nor touched"))
    return BodyShapes(visuals, collisions, tuple(notes))


def _shape(model: Any, k: int, name: str, source: GeomSource) -> Shape | str:
    """Read one geom; a text says why it is left out."""
    placement = placement_of(model.geom_pos[k], model.geom_quat[k])
    material = Material(source.material, source.rgba, source.texture, source.folder)
    types = import_mujoco().mjtGeom
    if source.left_out:
        return source.left_out
    if source.mesh:
        return Shape(ShapeKind.MESH, source.scale, placement, name, source.mesh, source.folder, material)
    a, b, c = (float(size) for size in model.geom_size[k])
    made = {
        types.mjGEOM_BOX: (ShapeKind.BOX, (2 * a, 2 * b, 2 * c)),
        types.mjGEOM_CYLINDER: (ShapeKind.CYLINDER, (a, 2 * b)),
        types.mjGEOM_CAPSULE: (ShapeKind.CAPSULE, (a, 2 * b)),
        types.mjGEOM_SPHERE: (ShapeKind.SPHERE, (a,)),
        types.mjGEOM_ELLIPSOID: (ShapeKind.ELLIPSOID, (a, b, c)),
    }.get(types(int(model.geom_type[k])))
    if made is None:
        return f"a {types(int(model.geom_type[k])).name.removeprefix('mjGEOM_').lower()} is no shape of ours: left out"
    if not np.isfinite(made[1]).all():
        return "its size is not finite: left out"
    return Shape(made[0], made[1], placement, name, material=material)
