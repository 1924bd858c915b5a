"""Which bodies a chain connects by which joints at home, seen from the world; its loops closed by balls; its parts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_positive
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Loop, Note
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain
from stewart_pin.typing import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Edge:
    """A joint or loop between two links, as it stands at home.

    Attributes
    ----------
    name
        Name of the joint or loop.
    kind
        Its kind.
    links
        Names of the two links.
    point
        (3,) origin of its frame, in the world [m].
    axis
        (3,) unit vector of its axis, in the world frame, where its kind has one.
    """

    name: str
    kind: JointKind
    links: tuple[str, str]
    point: FloatArray
    axis: FloatArray


class BodyGraph:
    """Bodies and the joints and loops between them, without what hangs on one joint only.

    Links that fixed joints hold together are one body, called by one of its links.

    Parameters
    ----------
    chain
        Closed chain, its home closed.
    """

    def __init__(self, chain: ClosedChain) -> None:
        data = pin.Data(chain.model)
        pin.framesForwardKinematics(chain.model, data, chain.q_home)
        links = [link.name for link in chain.mechanism.links]
        self.frames = {link: data.oMf[link_frame(chain.model, link)] for link in links}
        self.body = {link: link for link in links}
        edges = [self._edge(part, part.parent, part.child, part.placement) for part in chain.mechanism.joints]
        edges += [self._edge(part, part.link1, part.link2, part.placement1) for part in chain.loops]
        for edge in edges:
            if edge.kind is JointKind.FIXED:
                one, other = (self.body[link] for link in edge.links)
                self.body = {link: one if body == other else body for link, body in self.body.items()}
        # A floating joint holds nothing together.
        self.edges = [edge for edge in edges if edge.kind not in (JointKind.FIXED, JointKind.FLOATING)]
        self.ground, self.platform = self.body[chain.mechanism.root], self.body[chain.platform_link]
        self._drop_dead_ends()
        self._join_balls()

    def edge(self, name: str) -> Edge | None:
        """Find a joint or loop.

        Parameters
        ----------
        name
            Its name.

        Returns
        -------
        Edge or None
            The joint or loop, unless it leads nowhere.
        """
        return next((edge for edge in self.edges if edge.name == name), None)

    def onward(self, body: str, behind: Edge) -> list[Edge]:
        """List the ways that lead on from a body.

        Parameters
        ----------
        body
            Name of the body.
        behind
            Where one came from.

        Returns
        -------
        list of Edge
            All other joints and loops of the body.
        """
        return [
            edge
            for edge in self.edges
            if edge is not behind and body in {self.body[link] for link in edge.links}
        ]

    def across(self, edge: Edge, body: str) -> str:
        """Name the body at the other end.

        Parameters
        ----------
        edge
            Joint or loop.
        body
            Body at one end.

        Returns
        -------
        str
            The other body.
        """
        one, other = (self.body[link] for link in edge.links)
        return other if one == body else one

    def _drop_dead_ends(self) -> None:
        """Forget bodies that hang on one joint, such as counterweights."""
        while True:
            ends = [self.body[link] for edge in self.edges for link in edge.links]
            loose = {body for body in ends if ends.count(body) == 1} - {self.ground, self.platform}
            if not loose:
                return
            self.edges = [edge for edge in self.edges if not loose & {self.body[link] for link in edge.links}]

    def _join_balls(self) -> None:
        """Count two balls between the same two bodies as what they are: a hinge about the line through both."""
        pairs: dict[frozenset[str], list[Edge]] = {}
        for edge in self.edges:
            if edge.kind is JointKind.SPHERICAL:
                pairs.setdefault(frozenset(self.body[link] for link in edge.links), []).append(edge)
        for one, *others in pairs.values():
            if len(others) == 1 and (size := np.linalg.norm(others[0].point - one.point)) > 0:
                hinge = replace(one, kind=JointKind.REVOLUTE, axis=(others[0].point - one.point) / size)
                kept = [edge for edge in self.edges if edge is not others[0]]
                self.edges = [hinge if edge is one else edge for edge in kept]

    def _edge(self, part: Joint | Loop, link1: str, link2: str, placement: pin.SE3) -> Edge:
        frame = self.frames[link1] * placement
        return Edge(
            part.name, part.kind, (link1, link2), np.array(frame.translation), frame.rotation @ part.axis
        )


# ----------------------------------------------------------------------------------------------------
# The same mechanism with every loop closed by balls, for software that knows no other loops
# ----------------------------------------------------------------------------------------------------

_SHARE = 0.25
"""Distance of the balls, as a part of the robot's size: far enough apart for good conditioning."""


def loops_by_balls(chain: ClosedChain, *, distance: float | None = None) -> ClosedChain:
    """Hold hinges by two balls on their axis, and rigid closures by three, so that all loops are spherical.

    The motions are the same. A hinge gets one row more than it has conditions, a rigid closure three: the reactions of
    these balls are not unique.

    Parameters
    ----------
    chain
        Closed chain.
    distance
        Distance between the balls of one loop [m]; default: a quarter of the robot's size.

    Returns
    -------
    ClosedChain
        Balls of a loop are called after it, with a number; spherical loops, tree, motors and home stay.

    Raises
    ------
    InputError
        If the distance is not positive.
    UnsupportedError
        If a loop slides, or keeps a distance or angle only: no set of balls does the same. If a loop that is no ball
        has springs, damping or friction.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> by_balls = loops_by_balls(stp.load("five_bar"))
    >>> [(loop.name, str(loop.kind)) for loop in by_balls.loops]
    [('tip_pin_1', 'spherical'), ('tip_pin_2', 'spherical')]
    """
    as_chain(chain)
    apart = as_positive("distance", _SHARE * chain.length_scale if distance is None else distance)
    for loop in chain.loops:
        if any(loop.physics) and loop.kind is not JointKind.SPHERICAL:
            told = ", ".join(str(own) for own in loop.physics if own)
            raise UnsupportedError(
                f"joint '{loop.name}' closes a loop and has {told}, for which the balls that would stand for it have "
                "no place; take it away by with_joint_physics, or let the joint stand in the tree"
            )
    loops = tuple(ball for loop in chain.loops for ball in _balls(loop, apart))
    lost = tuple(
        Note(f"loop '{loop.name}'", "its limits: the balls that stand for it have other coordinates")
        for loop in chain.loops
        if loop.bounds and loop.kind is not JointKind.SPHERICAL
    )
    notes = (*chain.mechanism.notes, *lost)
    return replace(chain, mechanism=replace(chain.mechanism, loops=loops, notes=notes))


def _balls(loop: Loop, distance: float) -> list[Loop]:
    axis, across, _ = orthonormal_triad(loop.axis)
    points: list[FloatArray]
    match loop.kind:
        case JointKind.SPHERICAL:
            return [loop]
        case JointKind.REVOLUTE:
            points = [axis * distance / 2, -axis * distance / 2]
        case JointKind.FIXED:
            points = [np.zeros(3), axis * distance, across * distance]
        case _:
            raise UnsupportedError(
                f"loop '{loop.name}' is of type '{loop.kind}', which no balls replace; cut it at a hinge or a ball"
            )
    # The same coordinates in both frames: the points meet where the frames do.
    shifts = [pin.SE3(np.eye(3), point) for point in points]
    return [
        replace(
            loop,
            name=f"{loop.name}_{number}",
            kind=JointKind.SPHERICAL,
            placement1=loop.placement1 * shift,
            placement2=loop.placement2 * shift,
            bounds=(),
        )
        for number, shift in enumerate(shifts, start=1)
    ]


# ----------------------------------------------------------------------------------------------------
# Parts of a chain that share no loop: each can be closed, moved and judged as a chain of its own
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Part:
    """Loops and couplings that share no joint with others, as a chain of their own.

    Attributes
    ----------
    chain
        The links that carry them; joints between these that move none of the loops are fixed.
    at
        (k,) where its configuration stands in that of the whole [index].
    joints
        Names of its joints that move.
    """

    chain: ClosedChain
    at: np.ndarray
    joints: tuple[str, ...]


def part_of(chain: ClosedChain, rows: BoolArray, entries: BoolArray) -> Part:
    """Leave out of a chain what has nothing to do with some of its loops.

    Parameters
    ----------
    chain
        Closed chain, loops perhaps open.
    rows
        (nc,) rows of these loops and couplings.
    entries
        (nv,) tangent entries that move them.

    Returns
    -------
    Part
        A chain whose loops are open by the same gaps.
    """
    old, table = chain.mechanism, chain.loop_table
    names = tuple(
        name
        for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True)
        if entries[joint.idx_v]
    )
    loops = tuple(loop for loop, own in zip(old.loops, table.slices, strict=True) if rows[own].any())
    couplings = tuple(
        coupling for coupling, row in zip(old.couplings, table.coupling.index, strict=True) if rows[row]
    )
    above = {joint.child: joint for joint in old.joints}
    wanted = {old.root}
    ends = [link for loop in loops for link in (loop.link1, loop.link2)]
    for link in [*ends, *(joint.child for joint in old.joints if joint.name in names)]:
        while link not in wanted:
            wanted.add(link)
            link = above[link].parent
    mechanism = replace(
        old,
        links=tuple(link for link in old.links if link.name in wanted),
        joints=tuple(
            joint if joint.name in names else replace(joint, kind=JointKind.FIXED)
            for joint in old.joints
            if joint.child in wanted
        ),
        loops=loops,
        couplings=couplings,
        platform=None,
        home={name: values for name, values in old.home.items() if name in names},
        notes=(),
    )
    model = build_tree(mechanism, chain.gravity)
    part = ClosedChain(mechanism, model, (), None, np.zeros(model.nq))
    whole = [chain.model.joints[chain.model.getJointId(name)] for name in model.names[1:]]
    at = np.concatenate([np.arange(joint.idx_q, joint.idx_q + joint.nq) for joint in whole])
    return Part(part, at, names)
