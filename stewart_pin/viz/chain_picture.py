"""A chain as it stands: bodies as lines between the points where they are joined."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import JointKind
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain, as_configuration
from stewart_pin.typing import ArrayLike, FloatArray
from stewart_pin.viz.figures import new_figure
from stewart_pin.viz.scene import body_points

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
        (nq,) configuration, loops closed or open; default: home [m, rad, unit quaternions].

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    q = chain.q_home if q is None else as_configuration(chain, "q", q)
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    frames = {link.name: data.oMf[link_frame(chain.model, link.name)] for link in chain.mechanism.links}
    figure = new_figure(6.4, 6.0)
    axis = figure.add_subplot(projection="3d")
    everything = _draw_bodies(axis, chain, frames)
    _draw_joints(axis, chain, frames)
    _draw_loops(axis, chain, frames)
    if chain.platform is not None:
        _draw_platform(axis, chain, frames[chain.platform])
    low, high = everything.min(axis=0), everything.max(axis=0)
    extent = np.maximum(high - low, 0.15 * (high - low).max())
    for name, middle, size in zip("xyz", (low + high) / 2, extent, strict=True):
        axis.set(
            **{f"{name}lim": (middle - 0.55 * size, middle + 0.55 * size), f"{name}label": f"{name} [m]"}
        )
        axis.locator_params(axis=name, nbins=4)
    axis.set_box_aspect(extent, zoom=0.9)
    axis.tick_params(labelsize=8)
    axis.set_title(chain.name)
    _view(axis, extent)
    handles, labels = axis.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=6, frameon=False)
    return figure


def _draw_bodies(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> FloatArray:
    """Draw the outline of every link's points, in the world [m]; return all points."""
    everything = [np.array(frames[chain.platform or chain.mechanism.root].translation)[None]]
    for link, local in body_points(chain).items():
        distinct = local @ frames[link].rotation.T + frames[link].translation
        everything.append(distinct)
        if len(distinct) < 2:
            continue
        label, colour = "body", _BODY
        if link == chain.mechanism.root:
            label, colour = "ground", _GROUND
        elif link == chain.platform:
            label, colour = "platform", _PLATFORM
        outline = _around(distinct)
        axis.plot(*np.vstack([outline, outline[:1]]).T, color=colour, linewidth=2.2, label=label)
    return np.vstack(everything)


def _draw_joints(axis: Any, chain: ClosedChain, frames: dict[str, pin.SE3]) -> None:
    for joint in chain.mechanism.joints:
        if joint.kind in (JointKind.FLOATING, JointKind.FIXED):
            continue
        start = frames[joint.parent].act(joint.placement.translation)
        end = frames[joint.child].translation
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
    for loop in chain.loops:
        ends = np.array(
            [
                frames[loop.link1].act(loop.placement1.translation),
                frames[loop.link2].act(loop.placement2.translation),
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
