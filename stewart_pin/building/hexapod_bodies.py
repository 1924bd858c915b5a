"""The bodies of a hexapod: read off its chain for the closed form, or made from three masses."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.building.from_hexapod import OVERLAP, default_home, read_stroke
from stewart_pin.building.joints import require_no_physics
from stewart_pin.checks import as_positive
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.geometry.hexapod_dynamics import HexapodBodies, LowerJoint, RigidBody
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray

_SAME = 1e-9
"""Deviation of a link from where the closed form has it that is round-off, in leg lengths and radians."""


def hexapod_bodies(chain: ClosedChain) -> HexapodBodies:
    """Read platform, cylinders and rods off a chain.

    Parameters
    ----------
    chain
        Chain of six legs: lower joints universal with the second axis square to the leg, or balls, or three hinges
        through the foot. Frames of links, senses of axes and zeros of joints may be any, and so may be the base's
        frame and the cut of the loops.

    Returns
    -------
    HexapodBodies
        Bodies in the frames that the closed form expects [kg, m, kg m²].

    Raises
    ------
    UnsupportedError
        If the chain is no such hexapod, or has further bodies or rotors.
    """
    require_no_physics(chain, "the closed form")
    hexapod = Hexapod.from_chain(chain)
    graph = BodyGraph(chain)
    platform = graph.frames[chain.platform_link]
    lower, upper, firsts, kinds = [], [], [], set()
    known = {graph.ground, graph.platform}
    for motor, foot, head in zip(chain.motors, hexapod.base_points, hexapod.platform_points, strict=True):
        end = platform.act(head)
        below, above, hinges = _parts(graph, motor)
        kind, first = _lower_joint(motor, hinges, end - foot)
        leg = _leg_axes(end - foot, first)
        lower.append(_rigid_body(chain, graph, below, pin.SE3(leg, foot)))
        upper.append(_rigid_body(chain, graph, above, pin.SE3(leg, end)))
        firsts.append(first)
        kinds.add(kind)
        known |= {below, above}
    others = sorted({graph.body[link.name] for link in chain.mechanism.links if link.inertia} - known)
    if others:
        raise UnsupportedError(f"the closed form has no place for the bodies {', '.join(others)}")
    if len(kinds) != 1:
        raise UnsupportedError("the closed form needs legs whose lower joints are all of one kind")
    body = _rigid_body(chain, graph, graph.platform, platform)
    return HexapodBodies(body, tuple(lower), tuple(upper), kinds.pop(), np.array(firsts))


def _leg_axes(leg: FloatArray, first: FloatArray) -> FloatArray:
    """Axes of a leg frame as columns: z along the leg, y square to it and to the first axis of the lower joint."""
    z = leg / np.linalg.norm(leg)
    y = np.cross(z, first)
    size = np.linalg.norm(y)
    if size < _SAME:
        raise UnsupportedError("a leg lies along the first axis of its lower joint")
    return np.column_stack([np.cross(y / size, z), y / size, z])


def _parts(graph: BodyGraph, motor: str) -> tuple[str, str, list[Edge]]:
    """Find the bodies below and above a motor, and the joints from the ground to the lower one."""
    slide = graph.edge(motor)
    assert slide is not None  # it drives a leg
    sides: dict[str, tuple[str, list[Edge]]] = {}
    for start in (graph.body[link] for link in slide.links):
        body, path = start, [slide]
        while body not in (graph.ground, graph.platform):
            path.append(graph.onward(body, path[-1])[0])
            body = graph.across(path[-1], body)
        sides[body] = start, path[:0:-1]
    below, hinges = sides[graph.ground]
    return below, sides[graph.platform][0], hinges


def _lower_joint(motor: str, hinges: list[Edge], leg: FloatArray) -> tuple[LowerJoint, FloatArray]:
    """Tell the kind of a lower joint, and its first axis with the first component that is not zero positive."""
    match [edge.kind for edge in hinges]:
        case [JointKind.REVOLUTE, JointKind.REVOLUTE]:
            lean = max(abs(hinges[1].axis @ leg) / np.linalg.norm(leg), abs(hinges[1].axis @ hinges[0].axis))
            if lean > PRINTED:
                raise UnsupportedError(
                    f"the closed form needs lower joints whose second axis is square to leg and first axis; that of "
                    f"'{motor}' leans by {lean:.3g} rad"
                )
            kind: LowerJoint = "universal"
        case [JointKind.REVOLUTE, JointKind.REVOLUTE, JointKind.REVOLUTE]:
            kind = "spherical"
        case [JointKind.SPHERICAL]:
            # A ball has no axes: any that is not along the leg names the leg frame.
            return "spherical", np.eye(3)[int(np.argmin(np.abs(leg)))]
        case others:
            raise UnsupportedError(
                f"the closed form needs universal or spherical lower joints, '{motor}' has "
                f"{', '.join(others) or 'none'}"
            )
    axis = hinges[0].axis
    return kind, axis * np.sign(axis[np.abs(axis) > PRINTED][0])


def _rigid_body(chain: ClosedChain, graph: BodyGraph, body: str, at: pin.SE3) -> RigidBody:
    """Read a body, all links that are fixed to each other, in a frame that is given in the world at home."""
    whole = pin.Inertia.Zero()
    for link in chain.mechanism.links:
        if link.inertia is None or graph.body[link.name] != body:
            continue
        there = at.actInv(graph.frames[link.name])
        # A link that stands as the closed form has it keeps its numbers to the last bit.
        moved = link.inertia if there.isIdentity(_SAME) else link.inertia.se3Action(there)
        whole = moved if whole.mass == 0.0 else whole + moved
    return RigidBody(whole.mass, whole.lever, whole.inertia)


# ----------------------------------------------------------------------------------------------------
# Bodies of a six-legged platform from three masses: a disc, and slender rods
# ----------------------------------------------------------------------------------------------------

_SLENDER = 20.0
"""Length over radius of the legs' bodies."""
_FLAT = 20.0
"""Radius over thickness of the platform."""


def hexapod_inertias(
    hexapod: Hexapod,
    *,
    platform: float,
    lower: float,
    upper: float,
    leg_length: float | None = None,
    stroke: tuple[float, float] = (0.0, np.inf),
) -> dict[str, pin.Inertia]:
    """Estimate the inertias of a platform from its masses: a disc, and slender rods.

    The platform is a flat disc about the middle of its points, as wide as they are. Cylinders reach from the base
    points, rods from the platform points, each over 60 % of a leg, so that they overlap as telescopes do.

    Parameters
    ----------
    hexapod
        Geometry.
    platform, lower, upper
        Mass of the platform, of each cylinder and of each rod [kg].
    leg_length
        Usual length of the legs; default: the mean where `hexapod_chain` puts home by itself [m].
    stroke
        Least and greatest leg length, as for `hexapod_chain`; `leg_length` lies within [m].

    Returns
    -------
    dict
        ``platform``, ``lower`` and ``upper`` for `hexapod_chain` [kg, m, kg m²].

    Raises
    ------
    InputError
        If a mass or the length is not above zero, the stroke is empty, the length is beyond it, or the platform's
        points coincide.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> hexapod = stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3)
    >>> masses = stp.hexapods.hexapod_inertias(hexapod, platform=20.0, lower=2.0, upper=1.5)
    >>> stp.mobility(stp.hexapod_chain(hexapod, **masses)).dof
    6
    """
    masses = {
        name: as_positive(name, mass)
        for name, mass in (("platform", platform), ("lower", lower), ("upper", upper))
    }
    if leg_length is None:
        home = default_home(hexapod, *read_stroke(stroke))
        leg_length = float(leg_lengths(hexapod, home, np.eye(3)).mean())
    low, high = read_stroke(stroke)
    if not low <= leg_length <= high:
        raise InputError(
            f"leg_length {leg_length:g} m is beyond the stroke of {low:g} to {high:g} m; choose one within"
        )
    length = OVERLAP * as_positive("leg_length", leg_length)
    centre = hexapod.platform_points.mean(axis=0)
    radius = float(np.linalg.norm(hexapod.platform_points - centre, axis=1).max())
    if radius == 0.0:
        raise InputError(
            "hexapod: all platform points coincide, so the platform has no size; give inertias by hand"
        )
    # A cylinder about z, its centre of mass where told.
    across = (3 * radius**2 + (radius / _FLAT) ** 2) / 12
    disc = masses["platform"] * np.diag([across, across, radius**2 / 2])
    thin = length / _SLENDER
    rod = np.diag([(3 * thin**2 + length**2) / 12, (3 * thin**2 + length**2) / 12, thin**2 / 2])
    half = np.array([0.0, 0.0, length / 2])
    return {
        "platform": pin.Inertia(masses["platform"], centre, disc),
        "lower": pin.Inertia(masses["lower"], half, masses["lower"] * rod),
        "upper": pin.Inertia(masses["upper"], -half, masses["upper"] * rod),
    }
