"""Wrenches that act on a mechanism from outside: where they act, and what they do to the joints of the tree.

A wrench is [force; moment] on a link, at the origin of the link's frame, in world axes. With J_f the Jacobian of that
origin the equation of motion of the tree becomes

    M a + nle = Sᵀ tau_motor + J_cᵀ lambda_c + Σ J_fᵀ w_f .

This is the one place of the formulations on the tree that knows it; `mechanics.constraint_matrix` and
`mechanics.articulated_body`, which judge them, put forces on bodies by themselves.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.model.tree import link_frame
from stewart_pin.state.state import State
from stewart_pin.typing import ArrayLike, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain

Wrenches: TypeAlias = Mapping[str, ArrayLike]
"""{link: (6,) [force; moment] on it, at the origin of its frame, world axes} [N, N m]."""
MotionWrenches: TypeAlias = Mapping[str, ArrayLike] | Callable[[float], Wrenches | None]
"""Those of a motion: {link: (6,) or (N, 6)}, or a function of the instant [s] that returns {link: (6,)} [N, N m]."""


class Place(NamedTuple):
    """Where the frame of a link stands in the tree.

    Attributes
    ----------
    link
        Name of the link.
    joint
        Number of the joint that carries it, in Pinocchio's model; 0: the ground.
    placement
        The frame in the joint.
    """

    link: str
    joint: int
    placement: pin.SE3


@dataclass(frozen=True, eq=False)
class OutsideWrenches:
    """Checked wrenches of one state.

    Attributes
    ----------
    places
        Where they act.
    values
        (k, 6) [force; moment] of each at the origin of its frame, world axes [N, N m].
    joints
        (k,) number of the joint that carries each [index].
    points
        (k, 3) origin of each frame in its joint [m].
    """

    places: tuple[Place, ...]
    values: FloatArray
    joints: np.ndarray
    points: FloatArray

    def by_link(self) -> dict[str, FloatArray]:
        """Tell which link bears what.

        Returns
        -------
        dict
            (6,) wrench of each link [N, N m].
        """
        return {place.link: value for place, value in zip(self.places, self.values, strict=True)}


@dataclass(frozen=True, eq=False)
class WrenchSamples:
    """Checked wrenches of a motion.

    Attributes
    ----------
    places
        Where they act.
    values
        (N, k, 6) [force; moment] of each at the origin of its frame, world axes, instant by instant [N, N m].
    """

    places: tuple[Place, ...]
    values: FloatArray

    def at(self, k: int) -> OutsideWrenches:
        """Give those of one instant.

        Parameters
        ----------
        k
            Its index.

        Returns
        -------
        OutsideWrenches
            For the verbs of one state.
        """
        return _outside(self.places, self.values[k])

    @property
    def links(self) -> tuple[str, ...]:
        """Links on which they act."""
        return tuple(place.link for place in self.places)

    @property
    def rows(self) -> FloatArray:
        """(N, 6 k) the wrenches of each instant in one row, as kernels take them [N, N m]."""
        return self.values.reshape(len(self.values), -1)

    def acts_on_platform(self, chain: ClosedChain) -> bool:
        """Tell whether all act on the platform, or on the ground.

        Parameters
        ----------
        chain
            Closed chain with a platform.

        Returns
        -------
        bool
            False where one acts elsewhere.
        """
        return all(place.joint in (0, chain.platform_joint[0]) for place in self.places)

    def on_platform(self, chain: ClosedChain, rotation: FloatArray) -> FloatArray | None:
        """Gather them at the platform's origin, where all act on the platform or on the ground.

        Parameters
        ----------
        chain
            Closed chain with a platform.
        rotation
            (N, 3, 3) platform axes in the world.

        Returns
        -------
        numpy.ndarray or None
            (N, 6) their sum at the origin of the platform frame, world axes; None where one acts elsewhere [N, N m].
        """
        if not self.acts_on_platform(chain):
            return None
        frame = chain.platform_joint[1]
        total = np.zeros((len(self.values), 6))
        for k, place in enumerate(self.places):
            if place.joint:
                arm = rotation @ frame.actInv(place.placement).translation
                force = self.values[:, k, :3]
                total[:, :3] += force
                total[:, 3:] += self.values[:, k, 3:] + np.cross(arm, force)
        return total


def outside_places(chain: ClosedChain, links: Iterable[str]) -> tuple[Place, ...]:
    """Find where frames of links stand in the tree.

    Parameters
    ----------
    chain
        Closed chain.
    links
        Names of links; ``chain.platform`` is the platform's.

    Returns
    -------
    tuple of Place
        One per name.

    Raises
    ------
    InputError
        If a name is none of a link.
    """
    known: dict[str, Place] = chain.found.setdefault("outside_places", {})
    found = []
    for name in links:
        place = known.get(name) if isinstance(name, str) else None
        if place is None:
            place = known[name] = _place(chain, name)
        found.append(place)
    return tuple(found)


def _place(chain: ClosedChain, name: str) -> Place:
    links = [link.name for link in chain.mechanism.links]
    if name not in links:
        raise InputError(_unknown(chain, name, links))
    frame = chain.model.frames[link_frame(chain.model, name)]
    return Place(name, frame.parentJoint, pin.SE3(frame.placement))


def _unknown(chain: ClosedChain, name: object, links: list[str]) -> str:
    """Say that a name is none of a link, with the ones that may be meant."""
    text = f"wrenches act on links, and {name!r} is no link of '{chain.name}'"
    moved = next((joint.child for joint in chain.mechanism.joints if joint.name == name), None)
    if moved is not None:
        return f"{text} but a joint; name the link that it moves, {moved!r}, or another one"
    near = difflib.get_close_matches(str(name), links, n=3)
    if near:
        return f"{text}; did you mean {' or '.join(map(repr, near))}?"
    return f"{text}; the links are: {', '.join(links)}"


def as_wrenches(chain: ClosedChain, wrenches: Wrenches | OutsideWrenches | None) -> OutsideWrenches | None:
    """Check the wrenches of one state.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        {link: (6,)} [force; moment] on the link, at the origin of its frame, world axes; or checked ones; or None
        [N, N m].

    Returns
    -------
    OutsideWrenches or None
        None where there are none.

    Raises
    ------
    InputError
        If they are no mapping, a name is none of a link, or a wrench has the wrong shape or is not finite.
    """
    if wrenches is None or isinstance(wrenches, OutsideWrenches):
        return wrenches
    places = outside_places(chain, _names(wrenches))
    if not places:
        return None
    values = np.array([as_array(f"wrenches[{p.link!r}]", wrenches[p.link], (6,)) for p in places])
    return _outside(places, values)


def wrench_samples(
    chain: ClosedChain, wrenches: MotionWrenches | WrenchSamples | None, time: FloatArray
) -> WrenchSamples | None:
    """Check the wrenches of a motion.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        {link: (6,) or (N, 6)}: the same all the time, or one per instant; or a function of the instant that returns
        {link: (6,)}, where a link that it does not name bears none; or checked ones; or None [N, N m].
    time
        (N,) instants [s].

    Returns
    -------
    WrenchSamples or None
        None where there are none.

    Raises
    ------
    InputError
        If they are neither, a name is none of a link, or a wrench has the wrong shape or is not finite.
    """
    count = len(time)
    if isinstance(wrenches, WrenchSamples):
        if len(wrenches.values) != count:
            raise InputError(f"wrenches are of {len(wrenches.values)} instants, the motion is of {count}")
        return wrenches
    if callable(wrenches):
        return gathered_samples([as_wrenches(chain, asked_wrenches(wrenches, float(t))) for t in time])
    if wrenches is None:
        return None
    places = outside_places(chain, _names(wrenches))
    if not places:
        return None
    values = np.empty((count, len(places), 6))
    for k, place in enumerate(places):
        name, rows = f"wrenches[{place.link!r}]", wrenches[place.link]
        if np.shape(rows) not in ((6,), (count, 6)):
            raise InputError(f"{name} must have shape (6,) or ({count}, 6), got {np.shape(rows)}")
        values[:, k] = as_array(name, rows, np.shape(rows))
    return WrenchSamples(places, values)


def gathered_samples(given: Sequence[OutsideWrenches | None]) -> WrenchSamples | None:
    """Put the wrenches of instants, one after the other, into one array; a link that is not named bears none.

    Parameters
    ----------
    given
        Those of each instant, or None.

    Returns
    -------
    WrenchSamples or None
        None where there are none at any instant.
    """
    places = tuple({place.link: place for one in given if one is not None for place in one.places}.values())
    if not places:
        return None
    values, column = np.zeros((len(given), len(places), 6)), {place.link: k for k, place in enumerate(places)}
    for k, one in enumerate(given):
        if one is not None:
            values[k, [column[place.link] for place in one.places]] = one.values
    return WrenchSamples(places, values)


def asked_wrenches(function: Callable[..., Wrenches | None], *given: Any) -> Wrenches | None:
    """Ask a function of the instant, or of an instant and a state, for wrenches.

    Parameters
    ----------
    function
        What the caller passed.
    *given
        Its arguments, the instant first [s].

    Returns
    -------
    Mapping or None
        What it said [N, N m].

    Raises
    ------
    InputError
        If it said something else.
    """
    said = function(*given)
    if said is not None and not isinstance(said, Mapping):
        raise InputError(
            "wrenches must return {link: (6,)}, or None where nothing acts, "
            f"got {type(said).__name__} at {given[0]:g} s"
        )
    return said


def _names(wrenches: Wrenches) -> list[str]:
    if not isinstance(wrenches, Mapping):
        raise InputError(
            "wrenches must be a mapping from the name of a link to [force; moment] on it, as "
            f"{{'platform': [0, 0, -10, 0, 0, 0]}}, got {type(wrenches).__name__}"
        )
    return list(wrenches)


def _outside(places: tuple[Place, ...], values: FloatArray) -> OutsideWrenches:
    joints = np.array([place.joint for place in places])
    points = np.array([place.placement.translation for place in places])
    return OutsideWrenches(places, values, joints, points)


# ----------------------------------------------------------------------------------------------------
# What they do to the tree
# ----------------------------------------------------------------------------------------------------


def needed_efforts(state: State, a: Tangent, outside: OutsideWrenches | None) -> FloatArray:
    """Compute what motors and loops have to give for an acceleration, M a + nle - Σ J_fᵀ w_f - efforts of joints.

    Parameters
    ----------
    state
        The state.
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    outside
        Wrenches, or None.

    Returns
    -------
    numpy.ndarray
        (nv,) [N, N m].
    """
    efforts = state.tree_efforts(a)
    given = given_efforts(state, outside, a)
    return efforts if given is None else efforts - given


def given_efforts(state: State, outside: OutsideWrenches | None, a: Tangent | None = None) -> Tangent | None:
    """Compute the joint efforts that neither motors nor loops give: of wrenches, and of the joints themselves.

    Parameters
    ----------
    state
        The state.
    outside
        Wrenches, or None.
    a
        (nv,) acceleration, which tells what joints at rest do against dry friction; default: they stay [m/s², rad/s²].

    Returns
    -------
    numpy.ndarray or None
        (nv,) Σ J_fᵀ w_f + efforts of joints; None where there are none [N, N m].
    """
    effects = state.effects
    pushed = None if outside is None else outside_efforts(state, outside)
    if effects is None:
        return pushed
    own = effects.efforts(a)
    return own if pushed is None else own + pushed


def outside_efforts(state: State, outside: OutsideWrenches) -> FloatArray:
    """Compute the joint efforts that do the same work, Σ J_fᵀ w_f.

    Parameters
    ----------
    state
        The state.
    outside
        Wrenches.

    Returns
    -------
    numpy.ndarray
        (nv,) [N, N m].
    """
    at_origin = _at_origin(_points(state, outside), _values(state, outside))
    return ((at_origin @ state._joints) * state.chain.carriers[outside.joints]).sum(axis=0)


def outside_power(state: State, outside: OutsideWrenches) -> float:
    """Compute the power that comes from outside, Σ w_fᵀ twist_f.

    Parameters
    ----------
    state
        The state.
    outside
        Wrenches.

    Returns
    -------
    float
        Power [W].
    """
    return float(outside_efforts(state, outside) @ state.v)


def outside_effort_derivative(state: State, outside: OutsideWrenches) -> FloatArray:
    """Differentiate the joint efforts of `outside_efforts` by the configuration; forces and moments keep their axes.

    Parameters
    ----------
    state
        The state.
    outside
        Wrenches.

    Returns
    -------
    numpy.ndarray
        (nv, nv) change of each effort along each tangent entry [N, N m per m or rad].
    """
    chain, joints = state.chain, state._joints
    moving, turning = joints[:3].T, joints[3:].T
    points = _points(state, outside)
    carriers = [number for number, joint in enumerate(chain.model.joints) if number for _ in range(joint.nv)]
    carried = chain.carriers[carriers]  # row i: what moves the axis of entry i, or its carrier
    derivative = np.zeros((chain.nv, chain.nv))
    for joint, point, value in zip(outside.joints, points, _values(state, outside), strict=True):
        force, moment = value[:3], value[3:] + np.cross(point, value[:3])
        # A motion j below the axis i turns and shifts it, s_j × s_i, and moves the point at which the force acts:
        # d(s_iᵀ w) = (s_j × s_i)ᵀ w + ω_iᵀ (dp_j × F), with s_j × s_i = [ω_j × v_i + v_j × ω_i; ω_j × ω_i].
        own = (
            moving @ np.cross(force, turning).T
            + turning @ (np.cross(force, moving) + np.cross(moment, turning)).T
        )
        shift = moving + np.cross(turning, point)
        support = chain.carriers[joint]
        derivative += np.outer(support, support) * (carried * own + turning @ np.cross(shift, force).T)
    return derivative


def with_outside(
    state: State, outside: OutsideWrenches, forces: Sequence[pin.Force], unit: float = 1.0
) -> pin.StdVec_Force:
    """Add the wrenches to forces on the joints that carry them, as Pinocchio's algorithms take forces from outside.

    Parameters
    ----------
    state
        The state.
    outside
        Wrenches.
    forces
        One per joint of the model, in its own axes, at its origin [`unit`, and per m].
    unit
        In which these count forces [N].

    Returns
    -------
    pinocchio.StdVec_Force
        One per joint.
    """
    total = pin.StdVec_Force()
    total.extend(forces)
    for joint, point, value in zip(
        outside.joints, outside.points, _values(state, outside) / unit, strict=True
    ):
        turned = state._placed.rotation[joint].T
        force, moment = turned @ value[:3], turned @ value[3:]
        total[int(joint)] += pin.Force(force, moment + np.cross(point, force))
    return total


def _values(state: State, outside: OutsideWrenches) -> FloatArray:
    """Wrenches (k, 6) in axes of the ground, which are those of the world unless it moves [N, N m]."""
    return outside.values if state.base_motion is None else state.base_motion.to_base(outside.values)


def _points(state: State, outside: OutsideWrenches) -> FloatArray:
    """Origins of the frames in the world (k, 3) [m]."""
    placed, joints = state._placed, outside.joints
    return placed.translation[joints] + (placed.rotation[joints] @ outside.points[:, :, None])[:, :, 0]


def _at_origin(points: FloatArray, values: FloatArray) -> FloatArray:
    """Wrenches at the world origin (k, 6) [N, N m]."""
    moved = values.copy()
    # Written out: `numpy.cross` takes longer than all else here.
    (x, y, z), (fx, fy, fz) = points.T, values[:, :3].T
    moved[:, 3] += y * fz - z * fy
    moved[:, 4] += z * fx - x * fz
    moved[:, 5] += x * fy - y * fx
    return moved
