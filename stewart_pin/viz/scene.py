"""A chain as it stands: its bodies as lines between the points where they are joined, or with their surfaces."""

from __future__ import annotations

import copy
import io
import logging
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.building.drawn_shapes import body_points, hinge_reach, off_centre
from stewart_pin.errors import FileFormatError, FileMissingError, InputError, MissingExtraError
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.xml import read_xml
from stewart_pin.model.shapes import DRAWN
from stewart_pin.model.tree import link_frame
from stewart_pin.state.cable_paths import cable_paths
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_configuration
from stewart_pin.typing import ArrayLike, Configuration, FloatArray
from stewart_pin.viz.figures import new_figure

_ACROSS = 4
"""Panels in a row."""
_GROUND, _PLATFORM, _BODY, _MOTOR, _LOOP, _GHOST = "0.45", "C0", "0.2", "C3", "C2", "0.6"


def plot_chain(chain: ClosedChain, q: ArrayLike | None = None) -> Any:
    """Draw the bodies of any chain, its joints, and where its loops are closed.

    A body is the outline of the points where joints and loops hold it, or a line where there are two; a prismatic
    joint is a line from its parent to its child. Loops that are open show as two marks joined by a dotted line.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration, loops closed or open; or (n, nq), each in a panel of its own, all from the same side and to
        the same scale; default: home [m, rad, unit quaternions].

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        If there is no configuration to draw.
    """
    many = q is not None and np.ndim(q) == 2
    rows = np.asarray(q) if many else [chain.q_home if q is None else q]
    if len(rows) == 0:
        raise InputError("q holds no configuration, there is nothing to draw")
    shown = [link_placements(chain, as_configuration(chain, "q", row)) for row in rows]
    across = min(_ACROSS, len(shown))
    down = -(-len(shown) // across)
    figure = new_figure(*((3.2 * across, 3.0 * down + 0.4) if many else (6.4, 6.0)))
    axes = [figure.add_subplot(down, across, k + 1, projection="3d") for k in range(len(shown))]
    for axis, frames in zip(axes, shown, strict=True):
        draw_chain(axis, chain, frames)
    for number, axis in enumerate(axes, start=1):
        frame_chains(axis, chain, shown, alone=not many)
        axis.set_title(f"{chain.name} {number}" if many else chain.name)
    handles, labels = axes[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=6, frameon=False)
    return figure


def _points(chain: ClosedChain, frames: dict[str, pin.SE3]) -> FloatArray:
    """All points that hold bodies, and the origin of the platform, or of the root, in the world [m]."""
    held = [
        local @ frames[link].rotation.T + frames[link].translation
        for link, local in body_points(chain).items()
    ]
    return np.vstack([np.array(frames[chain.platform or chain.mechanism.root].translation)[None], *held])


def draw_chain(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3], *, ghost: bool = False) -> None:
    """Draw bodies, joints and loops into axes.

    Parameters
    ----------
    axis
        Three-dimensional axes.
    chain
        Closed chain.
    frames
        Placements of its links, from `link_placements`.
    ghost
        Whether in pale lines, and bodies alone.
    """
    _draw_bodies(axis, chain, frames, ghost=ghost)
    if ghost:
        return
    _draw_joints(axis, chain, frames)
    _draw_loops(axis, chain, frames)
    if chain.platform is not None:
        _draw_platform(axis, chain, frames[chain.platform])


def frame_chains(axis: Any, chain: ClosedChain, shown: list[dict[str, pin.SE3]], *, alone: bool) -> None:
    """Let axes show a chain wherever it stands in any of them, all to one scale and from one side.

    Parameters
    ----------
    axis
        Three-dimensional axes.
    chain
        Closed chain.
    shown
        Placements of its links, of every drawing.
    alone
        Whether there is one drawing only.
    """
    everything = np.stack([_points(chain, frames) for frames in shown])
    low, high = everything.min(axis=(0, 1)), everything.max(axis=(0, 1))
    extent = np.maximum(high - low, 0.15 * (high - low).max())
    for name, middle, size in zip("xyz", (low + high) / 2, extent, strict=True):
        axis.set(
            **{f"{name}lim": (middle - 0.55 * size, middle + 0.55 * size), f"{name}label": f"{name} [m]"}
        )
        axis.locator_params(axis=name, nbins=4)
    axis.set_box_aspect(extent, zoom=0.9 if alone else 0.8)
    axis.tick_params(labelsize=8)
    _view(axis, extent, np.ptp(everything, axis=0).max(axis=0))


def _draw_bodies(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3], *, ghost: bool) -> None:
    """Draw the outline of every link's points."""
    for link, local in body_points(chain).items():
        distinct = local @ frames[link].rotation.T + frames[link].translation
        if len(distinct) < 2:
            continue
        label, colour = "body", _BODY
        if link == chain.mechanism.root:
            label, colour = "ground", _GROUND
        elif link == chain.platform:
            label, colour = "platform", _PLATFORM
        outline = _around(distinct)
        if ghost:
            axis.plot(*np.vstack([outline, outline[:1]]).T, color=_GHOST, linewidth=1.2)
        else:
            axis.plot(*np.vstack([outline, outline[:1]]).T, color=colour, linewidth=2.2, label=label)


def _draw_joints(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
    reach, reels = hinge_reach(chain), chain.mechanism.reels
    for joint in chain.mechanism.joints:
        if joint.kind in (JointKind.FLOATING, JointKind.FIXED):
            continue
        mark = off_centre(joint, reach)
        start = frames[joint.parent].act(joint.placement.act(mark))
        end = frames[joint.child].act(mark)
        driven = joint.name in chain.motors
        colour, label = (_MOTOR, "motor") if driven else (_BODY, "joint")
        if joint.name in reels:
            end = start
        axis.plot(*np.array([start, end]).T, color=colour, linewidth=3.0)
        # A sliding motor is its line, a turning one its mark.
        where = (np.asarray(start) + end) / 2 if joint.kind is JointKind.PRISMATIC else end
        axis.plot(
            *where[:, None],
            "o",
            color=colour,
            markersize=7 if driven else 4,
            label=label,
            markerfacecolor="w",
        )


_ARC = 12
"""Pieces in which a cable is drawn around its pulley."""


def cable_lines(chain: ClosedChain, frames: dict[str, pin.SE3]) -> dict[str, FloatArray]:
    """Lay rods and cables from their first frames, over their pulleys, to their second ones.

    Parameters
    ----------
    chain
        Closed chain.
    frames
        Placements of its links, from `link_placements`.

    Returns
    -------
    dict
        ``{loop: (k, 3) points in the world}`` of loops that are distances or cables [m].
    """
    lines: dict[str, FloatArray] = {}
    for loop in chain.loops:
        if loop.kind not in (JointKind.DISTANCE, JointKind.CABLE):
            continue
        one, two = frames[loop.link1] * loop.placement1, frames[loop.link2] * loop.placement2
        points = np.array([one.translation, two.translation])
        radius = loop.cable.radius
        if radius:
            axis = one.rotation @ loop.axis
            path = cable_paths((points[1] - points[0])[None], axis[None], np.array([radius]))
            radial = path.radial[0]
            leaves = np.arctan2(path.outward[0] @ axis, path.outward[0] @ radial)
            leaves -= 2 * np.pi * (leaves > np.pi)
            angles = np.linspace(np.pi, leaves, _ARC)[:, None]
            arc = points[0] + radius * (radial + np.cos(angles) * radial + np.sin(angles) * axis)
            points = np.vstack([arc, points[1]])
        lines[loop.name] = points
    return lines


def _draw_loops(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
    reach, lines = hinge_reach(chain), cable_lines(chain, frames)
    for loop in chain.loops:
        if loop.name in lines:
            label = "cable" if loop.kind is JointKind.CABLE else "rod"
            axis.plot(*lines[loop.name].T, color=_LOOP, linewidth=1.4, label=label)
            continue
        mark = off_centre(loop, reach)
        ends = np.array(
            [
                frames[loop.link1].act(loop.placement1.act(mark)),
                frames[loop.link2].act(loop.placement2.act(mark)),
            ]
        )
        axis.plot(*ends.T, "D:", color=_LOOP, markersize=4, linewidth=1.2, label="loop")


def _draw_platform(axis: Any, chain: ClosedChain, pose: pin.SE3) -> None:
    """Mark the platform frame: x red, y green, z blue."""
    for direction, colour in zip(pose.rotation.T, ("r", "g", "b"), strict=True):
        end = pose.translation + 0.2 * chain.length_scale * direction
        axis.plot(*np.array([pose.translation, end]).T, color=colour, linewidth=1.2)


def _around(points: FloatArray) -> FloatArray:
    """Order points around their middle, as seen across the plane that fits them best."""
    out = points - points.mean(axis=0)
    first, second, _ = np.linalg.svd(out)[2]
    return points[np.argsort(np.arctan2(out @ second, out @ first))]


def _view(axis: Any, extent: FloatArray, moved: FloatArray) -> None:
    """Look at a planar mechanism that moves in its plane from the front, at any other from above and aside."""
    flat = int(np.argmin(extent))
    if extent[flat] < 0.2 * extent.max() and moved[flat] <= 0.2 * moved.max():
        elevation, azimuth = ((0, 0), (0, -90), (90, -90))[flat]
        axis.view_init(elev=elevation, azim=azimuth)
        axis.set(**{f"{'xyz'[flat]}ticks": [], f"{'xyz'[flat]}label": ""})
    else:
        axis.view_init(elev=22, azim=-55)


# ----------------------------------------------------------------------------------------------------
# Surfaces: the visuals of its URDF, and simple shapes where there are none
#
# yourdfpy reads shapes, meshes and colours. It would place the links by its own kinematics, which knows neither loops
# nor ball joints; here it gets the links alone, each on the world, and the chain places them. Without a screen
# Matplotlib draws them.
# ----------------------------------------------------------------------------------------------------

_WORLD = "scene_world"
"""Name of the scene's root: no link of a robot is called so."""
_THIN = 0.02
"""Thickness of the simple shapes, in robot sizes."""
_GROUND_FACE, _PLATFORM_FACE, _BODY_FACE, _DRIVEN_FACE, _CABLE_FACE = (
    (110, 110, 110, 255),
    (31, 119, 180, 255),
    (70, 70, 70, 255),
    (214, 39, 40, 255),
    (40, 40, 40, 255),
)


def build_scene(chain: ClosedChain, q: ArrayLike | None = None) -> Any:
    """Place the surfaces of a robot.

    Links take the ``<visual>`` elements of the URDF that the chain was read from. A link without any becomes a rod, a
    plate or a ball through the points where joints and loops hold it.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration, loops closed or open; default: home [m, rad, unit quaternions].

    Returns
    -------
    trimesh.Scene
        One graph node per link, of its name, and pieces of rods and cables, lengths in metres;
        ``scene.export("robot.glb")`` writes it for any viewer, ``scene.show()`` opens one.

    Raises
    ------
    MissingExtraError
        If yourdfpy (with trimesh) is not installed.
    FileMissingError
        If a mesh that the URDF names does not exist.
    FileFormatError
        If a visual cannot be read.
    """
    try:
        import trimesh  # noqa: PLC0415 - optional and slow
        import yourdfpy  # noqa: F401, PLC0415 - optional and slow
    except ImportError:
        raise MissingExtraError("yourdfpy", "scene") from None
    q = chain.q_home if q is None else as_configuration(chain, "q", q)
    scene, dressed = _visuals(chain.mechanism.source)
    if scene is None:
        scene = trimesh.Scene(base_frame=_WORLD)
    points = body_points(chain)
    for link, placement in link_placements(chain, q).items():
        scene.graph.update(frame_to=link, frame_from=_WORLD, matrix=placement.homogeneous)
        if link not in dressed:
            shapes = [*_body_shapes(chain, link, points[link]), *_joint_shapes(chain, q, link)]
            for k, shape in enumerate(shapes):
                name = f"{link} shape {k + 1}"
                scene.add_geometry(shape, node_name=name, geom_name=name, parent_node_name=link)
    for loop, line in cable_lines(chain, link_placements(chain, q)).items():
        for k, piece in enumerate(pairwise(line), start=1):
            shape: Any = trimesh.creation.cylinder(radius=mark_size(chain) / 5, segment=np.array(piece))
            shape.visual.face_colors = _CABLE_FACE
            name = f"{loop} piece {k}"
            scene.add_geometry(shape, node_name=name, geom_name=name, parent_node_name=_WORLD)
    return scene


def link_surfaces(chain: ClosedChain) -> dict[str, list[Any]]:
    """Collect the surfaces of every link, which move with it: visuals of the file, or simple shapes.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    dict
        ``{link: list of trimesh.Trimesh}`` in the link frame [m]; without marks of joints.

    Raises
    ------
    MissingExtraError
        If yourdfpy (with trimesh) is not installed.
    FileMissingError, FileFormatError
        As `build_scene`.
    """
    try:
        import trimesh  # noqa: F401, PLC0415 - optional and slow
    except ImportError:
        raise MissingExtraError("yourdfpy", "scene") from None
    scene, dressed = _visuals(chain.mechanism.source)
    points = body_points(chain)
    found: dict[str, list[Any]] = {}
    for link in (link.name for link in chain.mechanism.links):
        found[link] = [] if link in dressed else _body_shapes(chain, link, points[link])
    if scene is None:
        return found
    for node in scene.graph.nodes_geometry:
        placement, name = scene.graph[node]
        mesh = scene.geometry[name].copy()
        mesh.apply_transform(placement)
        # Links stand at the world there; the one that carries a visual is on the way from the world to it.
        way = scene.graph.transforms.shortest_path(_WORLD, node)
        found[next(step for step in way if step in dressed)].append(mesh)
    return found


def link_placements(chain: ClosedChain, q: Configuration) -> dict[str, pin.SE3]:
    """Place the links of a configuration.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration, loops closed or open [m, rad, unit quaternions].

    Returns
    -------
    dict
        ``{link: placement in the world}``.
    """
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    return {link.name: data.oMf[link_frame(chain.model, link.name)] for link in chain.mechanism.links}


def _visuals(source: str) -> tuple[Any, set[str]]:
    """Load the visuals of a URDF: a scene with every link at the world, and the links that have any."""
    path = Path(source)
    if not source or not path.is_file() or path.suffix.lower() not in (".urdf", ".xml"):
        return None, set()
    root = read_xml(path)
    links = [
        link
        for link in root.findall("link")
        if link.get("name") and any(map(_is_own, link.findall("visual")))
    ]
    if root.tag != "robot" or not links:
        return None, set()
    import yourdfpy  # noqa: PLC0415 - optional and slow

    star = etree.Element("robot", name="visuals")
    star.extend(copy.deepcopy(material) for material in root.findall("material"))
    etree.SubElement(star, "link", name=_WORLD)
    for link in links:
        name = str(link.get("name"))
        bare = etree.SubElement(star, "link", name=name)
        bare.extend(copy.deepcopy(visual) for visual in link.findall("visual"))
        joint = etree.SubElement(star, "joint", name=f"{name} on the world", type="fixed")
        etree.SubElement(joint, "parent", link=_WORLD)
        etree.SubElement(joint, "child", link=name)
    find = yourdfpy.urdf.filename_handler_magic

    def existing(fname: str) -> str:
        found = find(fname, dir=str(path.parent))
        if not Path(found).is_file():
            raise FileMissingError(
                f"the mesh '{fname}' of a <visual> is missing beside the URDF; put it there, or remove the <visual>",
                path=str(path),
                culprit=fname,
            )
        return found

    for mesh in star.iter("mesh"):
        existing(mesh.get("filename") or "")
    # It warns of what it does not find; that has been asked already, and the rest is an error below.
    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    try:
        urdf = yourdfpy.URDF.load(io.BytesIO(etree.tostring(star)), filename_handler=existing)
    except FileMissingError:
        raise
    except Exception as error:  # its parser and trimesh's loaders raise whatever they meet
        raise FileFormatError(
            f"a <visual> cannot be read: {error}", path=str(path), culprit="<visual>"
        ) from error
    return urdf.scene, {str(link.get("name")) for link in links}


def _is_own(visual: etree._Element) -> bool:
    """Tell the visuals of the user from those that `export` drew."""
    return not (visual.get("name") or "").startswith(DRAWN)


def _body_shapes(chain: ClosedChain, link: str, points: FloatArray) -> list[Any]:
    """Shapes through a link's points, in the link frame: a plate through many, a rod between two."""
    import trimesh  # noqa: PLC0415 - optional and slow

    thick = mark_size(chain)
    colour = (
        _GROUND_FACE
        if link == chain.mechanism.root
        else _PLATFORM_FACE
        if link == chain.platform
        else _BODY_FACE
    )
    shapes: list[Any] = []
    if len(points) == 2:
        shapes.append(trimesh.creation.cylinder(radius=thick / 2, segment=points))
    elif len(points) > 2:
        shapes.append(_plate(points, thick))
    elif len(points) == 1 and chain.mechanism.link(link).inertia is not None:
        shapes.append(_rod_to_centre(chain, link, points[0], thick))
    for shape in shapes:
        shape.visual.face_colors = colour
    return shapes


def mark_size(chain: ClosedChain) -> float:
    """Tell how thick simple shapes are.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    float
        Thickness [m].
    """
    return _THIN * chain.length_scale


def _joint_shapes(chain: ClosedChain, q: Configuration, link: str) -> list[Any]:
    """Make a ball where a motor turns a link, a thin rod back along a slide; red where a motor drives it."""
    import trimesh  # noqa: PLC0415 - optional and slow

    joint = next((joint for joint in chain.mechanism.joints if joint.child == link), None)
    if joint is None or not joint.has_axis or joint.name in chain.mechanism.reels:
        return []
    thick = mark_size(chain)
    driven = joint.name in chain.motors
    shape: Any
    if joint.kind is JointKind.REVOLUTE:
        if not driven:
            return []
        shape = trimesh.creation.icosphere(radius=thick, subdivisions=2)
    else:
        travel = q[chain.model.joints[chain.model.getJointId(joint.name)].idx_q]
        if abs(travel) < thick / 10:
            return []
        shape = trimesh.creation.cylinder(radius=thick / 5, segment=[-travel * joint.axis, np.zeros(3)])
    shape.visual.face_colors = _DRIVEN_FACE if driven else _BODY_FACE
    return [shape]


def _plate(points: FloatArray, thick: float) -> Any:
    """Convex hull of balls about the points: a plate where they lie in a plane."""
    import trimesh  # noqa: PLC0415 - optional and slow

    ball = trimesh.creation.icosphere(radius=thick / 2, subdivisions=1).vertices
    return trimesh.convex.convex_hull((points[:, None, :] + ball[None]).reshape(-1, 3))


def _rod_to_centre(chain: ClosedChain, link: str, point: FloatArray, thick: float) -> Any:
    """Rod from a lonely point through the centre of mass, as far again beyond it."""
    import trimesh  # noqa: PLC0415 - optional and slow

    inertia = chain.mechanism.link(link).inertia
    end = point if inertia is None else 2 * np.array(inertia.lever) - point
    if np.linalg.norm(end - point) < thick / 10:
        ball = trimesh.creation.icosphere(radius=thick, subdivisions=2)
        ball.apply_translation(point)
        return ball
    return trimesh.creation.cylinder(radius=thick / 2, segment=[point, end])


# ----------------------------------------------------------------------------------------------------
# Surfaces of a robot as a shaded Matplotlib picture: for notebooks and machines without a screen
# ----------------------------------------------------------------------------------------------------

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
