"""The three passes of the articulated-body algorithm, for one or several load cases at once.

The articulated inertias depend on the configuration alone. Forces, bias and accelerations therefore carry a trailing
axis of load cases: the state itself, and unit forces whose response is asked for. The base may move as prescribed.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, sec. 7.3 and table 7.1; equation numbers below
   are his.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.errors import SingularityError
from stewart_pin.mechanics.articulated_body.bodies import Body, cross_motion
from stewart_pin.state.base_motion import BaseMotion
from stewart_pin.typing import Configuration, FloatArray, Tangent

_NO_INERTIA = 1e-15
"""Apparent inertia of a joint, relative to the largest articulated inertia beyond it, that is round-off of zero."""


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """What the first pass finds, body by body in body coordinates.

    Attributes
    ----------
    to_parent
        (n, 6, 6) transforms ⁱX_λ(i) of motion vectors from the parent [1 and m].
    to_base
        (n, 6, 6) transforms ⁱX₀ of motion vectors from the base [1 and m].
    velocity
        (n, 6) spatial velocities v [rad/s, m/s].
    velocity_product
        (n, 6) accelerations c that are there without joint acceleration [rad/s², m/s²].
    bias
        (n, 6) forces p that are there without acceleration [N m, N].
    """

    to_parent: FloatArray
    to_base: FloatArray
    velocity: FloatArray
    velocity_product: FloatArray
    bias: FloatArray


@dataclass(frozen=True, eq=False)
class Response:
    """What the third pass finds.

    Attributes
    ----------
    joint
        (nv, m) joint accelerations in Pinocchio's order, one column per load case [rad/s², m/s²].
    body
        (n, 6, m) spatial accelerations in body coordinates, less that of gravity [rad/s², m/s²].
    """

    joint: FloatArray
    body: FloatArray


def first_pass(bodies: Sequence[Body], q: Configuration, v: Tangent, base_velocity: FloatArray) -> BodyMotion:
    """Walk outwards: velocities, velocity-product accelerations and bias forces.

    Parameters
    ----------
    bodies
        Bodies, parents first.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    base_velocity
        (6,) spatial velocity v₀ of the base in its coordinates [rad/s, m/s].

    Returns
    -------
    BodyMotion
        Motion of every body.
    """
    n = len(bodies)
    to_parent, to_base = np.empty((n, 6, 6)), np.empty((n, 6, 6))
    velocity, product, bias = np.empty((n, 6)), np.zeros((n, 6)), np.empty((n, 6))
    to_parent[0] = to_base[0] = np.eye(6)
    velocity[0] = base_velocity
    for i, body in enumerate(bodies):
        if i:
            to_parent[i] = body.transform(q)  # ⁱX_λ(i) = X_J X_T(i)
            to_base[i] = to_parent[i] @ to_base[body.parent]
            joint_velocity = body.subspace @ v[body.v_index]  # v_J = S q̇
            velocity[i] = to_parent[i] @ velocity[body.parent] + joint_velocity
            # c = c_J + v × v_J; the axes are constant in the child, so c_J = 0.
            product[i] = cross_motion(velocity[i]) @ joint_velocity
        bias[i] = -cross_motion(velocity[i]).T @ (body.inertia @ velocity[i])  # p = v ×* I v
    return BodyMotion(to_parent, to_base, velocity, product, bias)


def without_inertia(bodies: Sequence[Body], rotors: FloatArray, to_parent: FloatArray) -> list[int]:
    """Find the joints that move nothing with inertia while the loops are open.

    Parameters
    ----------
    bodies
        Bodies, parents first.
    rotors
        (nv,) inertia that each joint rate has of its own, Pinocchio's armature [kg m², kg].
    to_parent
        (n, 6, 6) transforms ⁱX_λ(i) of motion vectors [1 and m].

    Returns
    -------
    list of int
        Their numbers in the tangent.
    """
    articulated = np.array([body.inertia for body in bodies])
    found: list[int] = []
    for i in range(len(bodies) - 1, 0, -1):
        body, x = bodies[i], to_parent[i]
        u_matrix = articulated[i] @ body.subspace
        apparent = body.subspace.T @ u_matrix + np.diag(rotors[body.v_index])
        handed_on = articulated[i]
        if apparent.size and _least(apparent) <= _NO_INERTIA * np.abs(articulated[i]).max():
            found += np.arange(len(rotors))[body.v_index].tolist()
        elif apparent.size:
            handed_on = handed_on - u_matrix @ np.linalg.inv(apparent) @ u_matrix.T
        articulated[body.parent] += x.T @ handed_on @ x
    return sorted(found)


def respond(
    bodies: Sequence[Body],
    rotors: FloatArray,
    to_parent: FloatArray,
    tau: FloatArray,
    bias: FloatArray,
    velocity_product: FloatArray,
    base_acceleration: FloatArray,
) -> Response:
    """Walk inwards for articulated inertias and bias forces, then outwards for the accelerations.

    Parameters
    ----------
    bodies
        Bodies, parents first.
    rotors
        (nv,) inertia that each joint rate has of its own, Pinocchio's armature [kg m², kg].
    to_parent
        (n, 6, 6) transforms ⁱX_λ(i) of motion vectors [1 and m].
    tau
        (nv, m) joint efforts [N m, N].
    bias
        (n, 6, m) bias forces p, less the external forces, in body coordinates [N m, N].
    velocity_product
        (n, 6, m) accelerations c [rad/s², m/s²].
    base_acceleration
        (6, m) spatial acceleration of the base, less that of gravity, a₀ = -a_g at rest [rad/s², m/s²].

    Returns
    -------
    Response
        Accelerations of joints and bodies.

    Raises
    ------
    SingularityError
        If a joint moves nothing that has inertia.
    """
    n, m = len(bodies), tau.shape[1]
    articulated = np.array([body.inertia for body in bodies])  # Iᴬ, to which children will be added
    bias = bias.copy()  # pᴬ, likewise
    force_per_joint: list[FloatArray] = [np.empty(0)] * n  # U
    inverse: list[FloatArray] = [np.empty(0)] * n  # D⁻¹
    effort_left: list[FloatArray] = [np.empty(0)] * n  # u
    # Second pass, inwards.
    for i in range(n - 1, 0, -1):
        body, x = bodies[i], to_parent[i]
        s = body.subspace
        u_matrix = articulated[i] @ s  # U = Iᴬ S                            (7.43)
        # D = Sᵀ U (7.44); a rotor feels the rate of its joint alone.
        d_inverse = _inverse(body, s.T @ u_matrix + np.diag(rotors[body.v_index]), articulated[i])
        left = tau[body.v_index] - s.T @ bias[i]  # u = τ - Sᵀ pᴬ               (7.45)
        handed_on = articulated[i] - u_matrix @ d_inverse @ u_matrix.T  # Iᵃ = Iᴬ - U D⁻¹ Uᵀ
        # pᵃ = pᴬ + Iᵃ c + U D⁻¹ u
        force = bias[i] + handed_on @ velocity_product[i] + u_matrix @ (d_inverse @ left)
        articulated[body.parent] += x.T @ handed_on @ x
        bias[body.parent] += x.T @ force
        force_per_joint[i], inverse[i], effort_left[i] = u_matrix, d_inverse, left
    # Third pass, outwards.
    acceleration, joint = np.empty((n, 6, m)), np.empty((tau.shape[0], m))
    acceleration[0] = base_acceleration
    for i in range(1, n):
        body = bodies[i]
        carried = to_parent[i] @ acceleration[body.parent] + velocity_product[i]  # a' = X a_λ + c
        rate = inverse[i] @ (effort_left[i] - force_per_joint[i].T @ carried)  # q̈ = D⁻¹ (u - Uᵀ a')
        acceleration[i] = carried + body.subspace @ rate  # a = a' + S q̈
        joint[body.v_index] = rate
    return Response(joint, acceleration)


def _inverse(body: Body, apparent: FloatArray, articulated: FloatArray) -> FloatArray:
    """Invert D, the apparent inertia of a joint; refuse where nothing with inertia moves."""
    if not apparent.size:
        return apparent
    least = _least(apparent)
    if least <= _NO_INERTIA * np.abs(articulated).max():
        name = "" if body.joint is None else body.joint.name
        raise SingularityError(
            f"joint '{name}' moves nothing that has inertia (apparent inertia {least:.3g}), so no effort determines "
            "its acceleration; give the links beyond it mass, or use forward_dynamics",
            smallest_singular_value=max(least, 0.0),
            names=(name,),
        )
    return 1.0 / apparent if apparent.size == 1 else np.linalg.inv(apparent)


def _least(apparent: FloatArray) -> float:
    return float(apparent[0, 0]) if apparent.size == 1 else float(np.linalg.eigvalsh(apparent)[0])


# ----------------------------------------------------------------------------------------------------
# A base that moves as prescribed: a ship, a satellite's bus on rails, a shaking floor
# ----------------------------------------------------------------------------------------------------


def spatial_base(base: BaseMotion | None, gravity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Express the motion of a base in its own coordinates, with gravity as an upward acceleration.

    Parameters
    ----------
    base
        How it moves; None: it rests.
    gravity
        (3,) acceleration of free fall in the inertial frame [m/s²].

    Returns
    -------
    velocity : numpy.ndarray
        (6,) spatial velocity v₀, [angular; linear], base axes [rad/s, m/s].
    acceleration : numpy.ndarray
        (6,) spatial acceleration a₀ - a_g, base axes [rad/s², m/s²].
    """
    base = base or BaseMotion()
    linear, omega = base.twist[:3], base.twist[3:]
    # Spatial acceleration misses the ω × v of the origin.
    push = base.acceleration[:3] - np.cross(omega, linear) - gravity
    turned = np.stack([omega, linear, base.acceleration[3:], push]) @ base.rotation
    return turned[:2].ravel(), turned[2:].ravel()
