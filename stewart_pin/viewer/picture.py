"""A robot in a page: its links, slides and motors, moved and coloured as it moves."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import JointKind, Link
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray
from stewart_pin.viewer.readings import Readings
from stewart_pin.viz.scene import cable_lines, link_placements, link_surfaces, mark_size

Colouring = Literal["force", "stroke left", "none"]

_PLAIN, _PULL, _PUSH = np.array([150, 150, 150]), np.array([33, 102, 172]), np.array([214, 39, 40])
_GOOD, _BAD = np.array([44, 140, 60]), np.array([214, 39, 40])
_CABLE_WIDTH = 2.5
"""Width of rods and cables [pixels]."""
_NEAR_LIMIT = 0.15
"""Share of a stroke below which a motor begins to turn red."""


class Picture:
    """A chain in the scene of a server.

    Parameters
    ----------
    server
        viser server, or one of its clients.
    chain
        Closed chain.
    root
        Name under which all its nodes stand.
    """

    def __init__(self, server: Any, chain: ClosedChain, root: str = "/robot") -> None:
        self.chain, self._server = chain, server
        self._data = pin.Data(chain.model)
        self._root = server.scene.add_frame(root, show_axes=False)
        self._links, self._slides, self._turns = {}, {}, {}
        # Names of nodes are paths: a link called "a/b" would move with one called "a".
        nodes = {link.name: f"{root}/link {k}" for k, link in enumerate(chain.mechanism.links)}
        for link, surfaces in link_surfaces(chain).items():
            self._links[link] = server.scene.add_frame(nodes[link], show_axes=False)
            for k, surface in enumerate(surfaces):
                server.scene.add_mesh_trimesh(f"{nodes[link]}/surface {k}", surface)
        thick = mark_size(chain)
        reels = {loop.cable.reel: loop.name for loop in chain.loops if loop.cable.reel is not None}
        self._cables = {}
        frames = link_placements(chain, chain.q_home)
        for k, (loop, line) in enumerate(cable_lines(chain, frames).items()):
            self._cables[loop] = server.scene.add_line_segments(
                f"{root}/cable {k}",
                points=_pieces(line),
                colors=tuple(_PLAIN),
                thickness=_CABLE_WIDTH,
                thickness_units="screen",
            )
        self._winches = {name: self._cables[loop] for name, loop in reels.items()}
        for joint in chain.mechanism.joints:
            if joint.name in reels:
                continue
            driven, node = joint.name in chain.motors, f"{nodes[joint.child]}/joint"
            if joint.kind is JointKind.PRISMATIC:
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), joint.axis)
                rod = server.scene.add_cylinder(
                    node,
                    radius=thick * (0.55 if driven else 0.2),
                    height=1.0,
                    color=tuple(_PLAIN),
                    wxyz=_wxyz(turn),
                )
                self._slides[joint.name] = rod, chain.model.joints[chain.model.getJointId(joint.name)].idx_q
            elif driven:
                self._turns[joint.name] = server.scene.add_icosphere(
                    node, radius=thick, color=tuple(_PLAIN), subdivisions=2
                )
        self._axes = {joint.name: np.array(joint.axis) for joint in chain.mechanism.joints if joint.has_axis}
        if chain.platform is not None:
            reach = 0.2 * chain.length_scale
            self._frame = server.scene.add_frame(
                f"{root}/platform frame", axes_length=reach, axes_radius=reach / 40
            )

    def _bodies(self) -> tuple[Link, ...]:
        """Links to be placed for cables; none where there are none."""
        return self.chain.mechanism.links if self._cables else ()

    def remove(self) -> None:
        """Take it out of the scene."""
        self._root.remove()

    def show(self, state: State, readings: Readings, colouring: Colouring) -> None:
        """Move and colour it.

        Parameters
        ----------
        state
            Where it stands.
        readings
            What is shown of the state.
        colouring
            What the motors' colours tell.
        """
        pin.framesForwardKinematics(self.chain.model, self._data, state.q)
        for link, handle in self._links.items():
            _place(handle, self._data.oMf[link_frame(self.chain.model, link)])
        placed = {
            link.name: self._data.oMf[link_frame(self.chain.model, link.name)] for link in self._bodies()
        }
        for loop, line in cable_lines(self.chain, placed).items():
            self._cables[loop].points = _pieces(line)
        if readings.pose is not None:
            _place(self._frame, readings.pose)
        for name, (rod, at) in self._slides.items():
            travel = float(state.q[at])
            rod.height = max(abs(travel), 1e-6)
            rod.position = -travel / 2 * self._axes[name]
        colours = motor_colours(readings, colouring)
        for k, name in enumerate(self.chain.motors):
            colour = tuple(int(x) for x in colours[k])
            handle = self._slides[name][0] if name in self._slides else self._turns.get(name)
            if handle is not None:
                handle.color = colour
            elif name in self._winches:
                handle = self._winches[name]
                handle.colors = np.broadcast_to(np.array(colour, dtype=np.uint8), handle.points.shape)


def motor_colours(readings: Readings, colouring: Colouring) -> FloatArray:
    """Choose the colours of motors.

    Parameters
    ----------
    readings
        Of a state.
    colouring
        ``"force"``: red pushes, blue pulls, full at the effort limit, or at the largest effort where there is none;
        ``"stroke left"``: green, red at a limit; ``"none"``.

    Returns
    -------
    numpy.ndarray
        (nu, 3) red, green and blue, 0 to 255 [dimensionless].
    """
    plain = np.tile(_PLAIN, (len(readings.motors), 1)).astype(float)
    if colouring == "none" or not readings.motors:
        return plain
    if colouring == "stroke left":
        left = np.array([motor.stroke_left for motor in readings.motors])
        share = np.clip(left / _NEAR_LIMIT, 0.0, 1.0)[:, None]
        return np.where(np.isnan(share), plain, _BAD + share * (_GOOD - _BAD))
    efforts = np.array([motor.effort for motor in readings.motors])
    shares = np.array([motor.effort_share for motor in readings.motors])
    if np.isnan(shares).any() or np.abs(shares).max() < 0.2:
        # Small beside the limits, or without one: beside each other.
        largest = np.abs(efforts).max()
        shares = efforts / largest if largest > 0 else np.zeros_like(efforts)
    strength = np.clip(np.abs(shares), 0.0, 1.0)[:, None]
    full = np.where(shares[:, None] >= 0, _PUSH, _PULL)
    return np.where(np.isnan(strength), plain, _PLAIN + strength * (full - _PLAIN))


def _pieces(line: FloatArray) -> FloatArray:
    """(k - 1, 2, 3) pieces between (k, 3) points [m]."""
    return np.stack([line[:-1], line[1:]], axis=1)


def _place(handle: Any, placement: pin.SE3) -> None:
    handle.position = np.array(placement.translation)
    handle.wxyz = _wxyz(pin.Quaternion(placement.rotation))


def _wxyz(turn: pin.Quaternion) -> FloatArray:
    return np.array([turn.w, turn.x, turn.y, turn.z])
