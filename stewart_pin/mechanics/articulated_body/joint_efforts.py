"""What joints do by themselves, in the textbook's terms: efforts on tree joints, wrenches across loops.

Springs, damping and dry friction of a tree joint are part of its effort τ; those of a joint that closes a loop are a
wrench T per coordinate, as the rows of the loop have one, of given amplitude: the coordinate's rate is Tᵀ v_rel.
Spatial vectors are [angular; linear]. No formula is shared with `stewart_pin.state.joint_effects`.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 3 and 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.mechanics.articulated_body.bodies import Body, cross_motion, skew
from stewart_pin.mechanics.articulated_body.passes import BodyMotion, Response
from stewart_pin.model.description import JointKind, Loop, physics_coordinates, unknown_kind
from stewart_pin.model.joint_physics import JointPhysics, read_fields
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import AT_REST, AT_REST_BESIDE
from stewart_pin.typing import Configuration, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class JointCoordinate:
    """One coordinate along which a joint does something.

    Attributes
    ----------
    entry
        Its number in the tangent; -1 of a loop [index].
    body1, body2
        Numbers of the bodies of a loop [index].
    wrench1, wrench2
        (6,) its wrench in the coordinates of either body [1, m].
    known
        Acceleration of the coordinate that is there without acceleration [m/s² or rad/s²].
    push
        Effort of spring and damping [N or N m].
    friction
        Dry friction [N or N m].
    rate
        Rate of the coordinate [m/s or rad/s].
    size
        Its natural size [m or 1].
    """

    entry: int
    body1: int
    body2: int
    wrench1: FloatArray
    wrench2: FloatArray
    known: float
    push: float
    friction: float
    rate: float
    size: float

    def give(self, amount: float, tau: FloatArray, bias: FloatArray) -> None:
        """Let the joint give an effort.

        Parameters
        ----------
        amount
            Along the coordinate [N or N m].
        tau
            (nv,) joint efforts of one load case, which are changed [N, N m].
        bias
            (n, 6) bias forces of the bodies in it, which are changed: less the external forces [N m, N].
        """
        if self.entry >= 0:
            tau[self.entry] += amount
        else:
            bias[self.body2] -= amount * self.wrench2
            bias[self.body1] += amount * self.wrench1

    def accelerations(self, response: Response) -> FloatArray:
        """Tell how the coordinate accelerates in each load case, without what is known.

        Parameters
        ----------
        response
            Accelerations of joints and bodies.

        Returns
        -------
        numpy.ndarray
            (m,) one per load case [m/s² or rad/s²].
        """
        if self.entry >= 0:
            return response.joint[self.entry]
        return self.wrench2 @ response.body[self.body2] - self.wrench1 @ response.body[self.body1]


def tree_coordinates(
    chain: ClosedChain, bodies: Sequence[Body], q: Configuration, v: Tangent
) -> list[JointCoordinate]:
    """List what the joints of the tree do.

    Parameters
    ----------
    chain
        Closed chain.
    bodies
        Bodies of its tree.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    list of JointCoordinate
        One per tangent entry that has a spring, damping or friction.
    """
    fields, none, found = read_fields(chain.model), np.zeros(6), []
    for body in bodies:
        if body.joint is None:
            continue
        entries = np.arange(chain.nv)[body.v_index]
        springs = np.zeros(entries.size)
        if body.joint.kind is JointKind.SPHERICAL:
            springs -= sum(body.joint.physics.stiffness) * Rotation.from_quat(q[body.q_index]).as_rotvec()
        elif entries.size == 1:
            springs[0] = _pull(body.joint.physics, q[body.q_index][0] - body.joint.physics.rest)
        damping, friction = fields["damping"][entries], fields["friction"][entries]
        for k in np.flatnonzero((springs != 0) | (damping != 0) | (friction != 0)):
            at, push = int(entries[k]), float(springs[k] - damping[k] * v[entries[k]])
            natural = float(chain.tangent_scale[at])
            found.append(
                JointCoordinate(at, 0, 0, none, none, 0.0, push, float(friction[k]), float(v[at]), natural)
            )
    return found


@dataclass(frozen=True, eq=False)
class LoopFrames:
    """Frames of a loop in base coordinates.

    Attributes
    ----------
    body1, body2
        Numbers of the bodies that carry them [index].
    axes1, axes2
        (3, 3) their axes.
    origin1, origin2
        (3,) their origins [m].
    """

    body1: int
    body2: int
    axes1: FloatArray
    axes2: FloatArray
    origin1: FloatArray
    origin2: FloatArray


def loop_coordinates_of(
    loop: Loop, frames: LoopFrames, motion: BodyMotion, length: float
) -> list[JointCoordinate]:
    """List what a joint that closes a loop does.

    Parameters
    ----------
    loop
        The loop.
    frames
        Its frames.
    motion
        Motion of the bodies, from the first pass.
    length
        Natural length [m].

    Returns
    -------
    list of JointCoordinate
        One per coordinate; of a ball three.
    """
    if not any(loop.physics):
        return []
    one, two = frames.body1, frames.body2
    velocity1, velocity2 = (np.linalg.solve(motion.to_base[k], motion.velocity[k]) for k in (one, two))
    relative = velocity2 - velocity1
    slide = relative[3:] - skew(frames.origin2) @ relative[:3]
    found = []
    for word, own in zip(physics_coordinates(loop.kind), loop.physics, strict=True):
        for moment, force, apart in _shapes(loop, word, own, frames):
            # About the base's origin; seen from link 1 a force follows frame 2, an axis of link 2 its turning.
            wrench = np.concatenate([moment + skew(frames.origin2) @ force, force])
            seen = skew(slide) @ force
            if word == "angle 2":
                seen = seen + skew(relative[:3]) @ moment
            rate = float(wrench @ relative)
            known = float(seen @ relative[:3] - wrench @ (cross_motion(velocity1) @ relative))
            found.append(
                JointCoordinate(
                    entry=-1,
                    body1=one,
                    body2=two,
                    wrench1=np.linalg.solve(motion.to_base[one].T, wrench),
                    wrench2=np.linalg.solve(motion.to_base[two].T, wrench),
                    known=known,
                    push=_pull(own, apart) - own.damping * rate,
                    friction=own.friction,
                    rate=rate,
                    size=length if force.any() else 1.0,
                )
            )
    return found


def _shapes(
    loop: Loop, word: str, own: JointPhysics, frames: LoopFrames
) -> list[tuple[FloatArray, FloatArray, float]]:
    """Moment and force on link 2 at the origin of frame 2 per unit of effort, and the displacement from rest."""
    none, turn = np.zeros(3), frames.axes1.T @ frames.axes2
    shift = frames.axes1.T @ (frames.origin2 - frames.origin1)
    axis, second = (np.array(each, dtype=float) for each in (loop.axis, loop.axis2))

    def nearest(angle: FloatArray) -> float:
        return float(np.remainder(angle - own.rest + np.pi, 2 * np.pi) - np.pi)

    match word:
        case "length":
            return [(none, frames.axes1 @ axis, float(axis @ shift) - own.rest)]
        case "x" | "y":
            # The coordinate axes that follow the one that the normal is nearest to, laid into the plane.
            following = np.roll(np.eye(3), -int(np.abs(axis).argmax()), axis=0)[1]
            first = following - axis * (axis @ following)
            first /= np.linalg.norm(first)
            along = first if word == "x" else skew(axis) @ first
            return [(none, frames.axes1 @ along, float(along @ shift) - own.rest)]
        case "angle":
            # R - Rᵀ = 2 sin φ a×, trace R = 1 + 2 cos φ.
            twice = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            return [(frames.axes1 @ axis, none, nearest(np.arctan2(axis @ twice, np.trace(turn) - 1.0)))]
        case "angle 1":
            across = np.array([second, skew(axis) @ second]) @ (turn @ second)
            return [(frames.axes1 @ axis, none, nearest(np.arctan2(across[1], across[0])))]
        case "angle 2":
            across = np.array([axis, skew(axis) @ second]) @ (turn.T @ axis)
            return [(frames.axes2 @ second, none, nearest(np.arctan2(across[1], across[0])))]
        case "turn":
            turned = Rotation.from_matrix(turn).as_rotvec()
            return [(u, none, float(x)) for u, x in zip(frames.axes1.T, turned, strict=True)]
    raise unknown_kind(
        f"loop '{loop.name}'", loop.kind, f"the articulated-body algorithm (coordinate '{word}')"
    )


def _pull(own: JointPhysics, apart: float) -> float:
    """Effort of a spring that is displaced from rest."""
    return own.force - float(sum(k * apart ** (n + 1) for n, k in enumerate(own.stiffness)))


def with_moving_friction(
    chain: ClosedChain, coordinates: Sequence[JointCoordinate], v: Tangent
) -> tuple[FloatArray, list[JointCoordinate]]:
    """Add dry friction where a coordinate moves.

    Parameters
    ----------
    chain
        Closed chain.
    coordinates
        What the joints do.
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    efforts : numpy.ndarray
        (k,) of all coordinates [N or N m].
    resting : list of JointCoordinate
        Those at rest that have dry friction.
    """
    fastest = float(np.abs(v / chain.tangent_scale).max(initial=0.0))
    efforts, resting = np.zeros(len(coordinates)), []
    for k, own in enumerate(coordinates):
        efforts[k] = own.push
        if abs(own.rate) > own.size * max(AT_REST, AT_REST_BESIDE * fastest):
            efforts[k] -= own.friction * np.sign(own.rate)
        elif own.friction:
            resting.append(own)
    return efforts, resting
