"""Which links are bodies, and which joints hold them together.

A link without ``<inertial>`` is no body: the joints on either side of it form one compound joint, so that RX and RY
around a cross make one universal joint. The ground is a body, held by a joint with six columns. Where a massless link
has to have a motion of its own (it branches, a loop ends on it, it is what a motor moves or the platform), it is a body
without inertia; so it is where a wrench from outside acts on it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Loop, Mechanism


@dataclass(frozen=True, eq=False)
class CompoundJoint:
    """Tree joints in a row, with no body in between.

    Attributes
    ----------
    name
        Names of the parts, joined by "+".
    predecessor, successor
        Bodies at the ends.
    parts
        The tree joints, from the predecessor on.
    """

    name: str
    predecessor: str
    successor: str
    parts: tuple[Joint, ...]

    @property
    def kind(self) -> str:
        """What the parts make together: two revolute joints a universal one, three a spherical one."""
        kinds = [part.kind for part in self.parts if part.kind is not JointKind.FIXED]
        if kinds == [JointKind.REVOLUTE] * len(kinds) and len(kinds) in (2, 3):
            return (JointKind.UNIVERSAL if len(kinds) == 2 else JointKind.SPHERICAL).value
        return "+".join(kinds) or JointKind.FIXED.value


@dataclass(frozen=True, eq=False)
class LoopJoint:
    """A loop closure between two bodies.

    Attributes
    ----------
    name
        Name of the loop.
    predecessor, successor
        Bodies that carry loop frames 1 and 2.
    loop
        The loop as the file describes it.
    """

    name: str
    predecessor: str
    successor: str
    loop: Loop


@dataclass(frozen=True, eq=False)
class Topology:
    """Bodies and joints of the maximal-coordinate system.

    Attributes
    ----------
    bodies
        Links that are bodies, the ground first.
    tree
        Compound joints, by their distance from the ground.
    loops
        Loop closures.
    couplings
        Joints that move together.
    fixed
        For each loaded link that is no body, the body that it is fixed to.
    """

    bodies: tuple[Link, ...]
    tree: tuple[CompoundJoint, ...]
    loops: tuple[LoopJoint, ...]
    couplings: tuple[Coupling, ...] = ()
    fixed: Mapping[str, str] = field(default_factory=dict)

    def carrier(self, link: str) -> str:
        """Find the body that a link belongs to.

        Parameters
        ----------
        link
            Name of the link.

        Returns
        -------
        str
            Itself, or the body that it is fixed to.
        """
        return self.fixed.get(link, link)

    def compound(self, joint: str) -> int:
        """Find the compound joint that a tree joint is part of.

        Parameters
        ----------
        joint
            Name of the tree joint.

        Returns
        -------
        int
            Its index in `tree`.
        """
        return next(k for k, c in enumerate(self.tree) if any(part.name == joint for part in c.parts))


@lru_cache(maxsize=64)
def topology(
    mechanism: Mechanism, motors: tuple[str, ...], platform: str | None, loaded: tuple[str, ...] = ()
) -> Topology:
    """Sort a mechanism into bodies and joints.

    Parameters
    ----------
    mechanism
        Valid description.
    motors
        Names of the motor joints, and of those with a rotor.
    platform
        Name of the platform link.
    loaded
        Links without inertia that bear a wrench from outside.

    Returns
    -------
    Topology
        Bodies and joints.
    """
    return _Sorter(mechanism, motors, platform, loaded).run()


class _Sorter:
    def __init__(
        self, mechanism: Mechanism, motors: tuple[str, ...], platform: str | None, loaded: tuple[str, ...]
    ) -> None:
        self.mechanism, self.loaded = mechanism, loaded
        # A coupling acts on a joint's own freedom as a motor does, and a cable on its reel.
        coupled = {name for coupling in mechanism.couplings for name in coupling.joints}
        self.motors = {*motors, *coupled, *mechanism.reels}
        self.platform = platform
        self.parent = {joint.child: joint for joint in mechanism.joints}
        self.children: dict[str, list[Joint]] = defaultdict(list)
        for joint in mechanism.joints:
            self.children[joint.parent].append(joint)
        self.closing: dict[str, int] = defaultdict(int)
        for loop in mechanism.loops:
            self.closing[loop.link1] += 1
            self.closing[loop.link2] += 1
        self.bodies = {link.name for link in mechanism.links if link.inertia is not None} | {mechanism.root}

    def run(self) -> Topology:
        self._promote_branching_links()
        tree: list[CompoundJoint] = []
        frontier = [self.mechanism.root]
        while frontier:  # breadth first: joints in the order of their distance from the ground
            found = [compound for body in frontier for compound in self._below(body)]
            tree += found
            frontier = [compound.successor for compound in found]
        order = [self.mechanism.root, *(compound.successor for compound in tree)]
        links = {link.name: link for link in self.mechanism.links}
        return Topology(
            bodies=tuple(links[name] for name in order),
            tree=tuple(tree),
            loops=tuple(
                LoopJoint(loop.name, self._carrier(loop.link1), self._carrier(loop.link2), loop)
                for loop in self.mechanism.loops
            ),
            couplings=self.mechanism.couplings,
            fixed={name: self._carrier(name) for name in self.loaded},
        )

    def _promote_branching_links(self) -> None:
        """Make a massless link a (massless) body where a chain of joints cannot pass through it."""
        for link in self.mechanism.links:
            name = link.name
            if name in self.bodies or self._rigid_to_parent(name):
                continue
            onward, ends = self._hanging(name)
            driven = name in self.parent and self.parent[name].name in self.motors
            if ends or len(onward) > 1 or (driven and not onward):
                self.bodies.add(name)

    def _rigid_to_parent(self, name: str) -> bool:
        return name in self.parent and self.parent[name].kind is JointKind.FIXED

    def _hanging(self, name: str) -> tuple[list[Joint], int]:
        """Joints that lead on from a massless link and what is fixed to it, and how many ends, `_ends`."""
        onward, ends = [], self._ends(name)
        for joint in self.children[name]:
            if joint.kind is JointKind.FIXED and joint.child not in self.bodies:
                further, more = self._hanging(joint.child)
                onward += further
                ends += more
            elif self._leads_on(joint):
                onward.append(joint)
        return onward, ends

    def _ends(self, name: str) -> int:
        return self.closing[name] + (name == self.platform) + (name in self.loaded)

    def _leads_on(self, joint: Joint) -> bool:
        """Whether a body, a loop, a motor or the platform is on the far side: anything else is an ornament."""
        if joint.child in self.bodies or joint.name in self.motors or self._ends(joint.child):
            return True
        return any(self._leads_on(below) for below in self.children[joint.child])

    def _carrier(self, name: str) -> str:
        """Body that a link belongs to: itself, or the one it is fixed to."""
        while name not in self.bodies:
            name = self.parent[name].parent
        return name

    def _below(self, body: str) -> list[CompoundJoint]:
        found: list[CompoundJoint] = []
        stack = [(joint, ()) for joint in reversed(self.children[body])]
        while stack:
            joint, before = stack.pop()
            if not self._leads_on(joint):
                continue
            parts = (*before, joint)
            if joint.child in self.bodies:
                name = "+".join(part.name for part in parts)
                found.append(CompoundJoint(name, body, joint.child, parts))
            else:
                stack += [(below, parts) for below in reversed(self.children[joint.child])]
        return found
