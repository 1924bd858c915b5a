"""A chain as it stands: bodies as lines between the points where they are joined."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.building.drawn_shapes import body_points, hinge_reach, off_centre
from stewart_pin.errors import InputError
from stewart_pin.model.description import JointKind
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_configuration
from stewart_pin.typing import ArrayLike, Configuration, FloatArray
from stewart_pin.viz.figures import new_figure

_ACROSS = 4
"""Panels in a row."""
_GROUND, _PLATFORM, _BODY, _MOTOR, _LOOP = "0.45", "C0", "0.2", "C3", "C2"


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
    shown = [_frames(chain, as_configuration(chain, "q", row)) for row in rows]
    across = min(_ACROSS, len(shown))
    down = -(-len(shown) // across)
    figure = new_figure(*((3.2 * across, 3.0 * down + 0.4) if many else (6.4, 6.0)))
    axes = [figure.add_subplot(down, across, k + 1, projection="3d") for k in range(len(shown))]
    for axis, frames in zip(axes, shown, strict=True):
        _draw(axis, chain, frames)
    everything = np.vstack([_points(chain, frames) for frames in shown])
    for number, axis in enumerate(axes, start=1):
        _frame(axis, everything, alone=not many)
        axis.set_title(f"{chain.name} {number}" if many else chain.name)
    handles, labels = axes[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=6, frameon=False)
    return figure


def _frames(chain: ClosedChain, q: Configuration) -> dict[str, pin.SE3]:
    """Where the links of a configuration stand."""
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    return {link.name: data.oMf[link_frame(chain.model, link.name)] for link in chain.mechanism.links}


def _points(chain: ClosedChain, frames: dict[str, pin.SE3]) -> FloatArray:
    """All points that hold bodies, and the origin of the platform, or of the root, in the world [m]."""
    held = [
        local @ frames[link].rotation.T + frames[link].translation
        for link, local in body_points(chain).items()
    ]
    return np.vstack([np.array(frames[chain.platform or chain.mechanism.root].translation)[None], *held])


def _draw(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
    _draw_bodies(axis, chain, frames)
    _draw_joints(axis, chain, frames)
    _draw_loops(axis, chain, frames)
    if chain.platform is not None:
        _draw_platform(axis, chain, frames[chain.platform])


def _frame(axis: Any, everything: FloatArray, *, alone: bool) -> None:
    """Let a panel show all points, whatever it draws itself."""
    low, high = everything.min(axis=0), everything.max(axis=0)
    extent = np.maximum(high - low, 0.15 * (high - low).max())
    for name, middle, size in zip("xyz", (low + high) / 2, extent, strict=True):
        axis.set(
            **{f"{name}lim": (middle - 0.55 * size, middle + 0.55 * size), f"{name}label": f"{name} [m]"}
        )
        axis.locator_params(axis=name, nbins=4)
    axis.set_box_aspect(extent, zoom=0.9 if alone else 0.8)
    axis.tick_params(labelsize=8)
    _view(axis, extent)


def _draw_bodies(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
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
        axis.plot(*np.vstack([outline, outline[:1]]).T, color=colour, linewidth=2.2, label=label)


def _draw_joints(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
    reach = hinge_reach(chain)
    for joint in chain.mechanism.joints:
        if joint.kind in (JointKind.FLOATING, JointKind.FIXED):
            continue
        mark = off_centre(joint, reach)
        start = frames[joint.parent].act(joint.placement.act(mark))
        end = frames[joint.child].act(mark)
        driven = joint.name in chain.motors
        colour, label = (_MOTOR, "motor") if driven else (_BODY, "joint")
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


def _draw_loops(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
    reach = hinge_reach(chain)
    for loop in chain.loops:
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


def _view(axis: Any, extent: FloatArray) -> None:
    """Look at a planar mechanism from the front, at any other from above and aside."""
    flat = int(np.argmin(extent))
    if extent[flat] < 0.2 * extent.max():
        elevation, azimuth = ((0, 0), (0, -90), (90, -90))[flat]
        axis.view_init(elev=elevation, azim=azimuth)
        axis.set(**{f"{'xyz'[flat]}ticks": [], f"{'xyz'[flat]}label": ""})
    else:
        axis.view_init(elev=22, azim=-55)
