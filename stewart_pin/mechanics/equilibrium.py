r"""The linear system that a chain is for small motions about an equilibrium.

With :math:`\xi` coordinates along the motions T that keep the loops closed, :math:`\ddot\xi = A_{21}\,\xi + B_2\,δτ`.
At rest, curvature of the motions meets no force that is not in balance already, so that the derivatives of the
acceleration along T are all there is; velocities enter by their squares only. Stiffness on elastic motors and
natural frequencies follow below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_spread
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.mechanics.derivatives import force_derivatives, forward_dynamics_derivatives
from stewart_pin.mechanics.effort import hangs
from stewart_pin.mechanics.forward_dynamics import forward_dynamics
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import Wrenches, as_wrenches
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import CONSISTENT, NO_INERTIA
from stewart_pin.typing import ArrayLike, FloatArray

_AT_REST = 1e-6
"""Acceleration, in robot sizes and radians per s², below which a state counts as an equilibrium: printed digits."""


@dataclass(frozen=True, eq=False, repr=False)
class LinearSystem(Brief):
    """Small motions about an equilibrium, d[ξ; ξ̇]/dt = A [ξ; ξ̇] + B δτ.

    Attributes
    ----------
    A
        (2n, 2n) system matrix [1, 1/s, 1/s²].
    B
        (2n, nu) input matrix: acceleration per motor effort [m or rad per N s² or N m s²].
    motions
        (nv, n) T, tangent displacement per coordinate: dq = T ξ [m, rad].
    names
        Names of the coordinates: the motors, then ``idle 1`` and so on.
    q
        (nq,) configuration [m, rad, unit quaternions].
    tau_motor
        (nu,) motor efforts that hold it [N or N m].
    """

    A: FloatArray
    B: FloatArray
    motions: FloatArray
    names: tuple[str, ...]
    q: FloatArray
    tau_motor: FloatArray


def linearise(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    tau_motor: ArrayLike | None = None,
    wrenches: Wrenches | None = None,
) -> LinearSystem:
    """Linearise the motion of a chain about an equilibrium.

    The coordinates are the displacements of the motors (or of as many of them as the chain has freedoms), and of the
    idle freedoms.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    tau_motor
        (nu,) motor efforts that hold it there [N or N m]; default: those that gravity and the wrenches need.
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`; they keep their axes, and act at the
        frame's origin wherever it goes [N, N m].

    Returns
    -------
    LinearSystem
        A, B and the coordinates.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, or the efforts do not hold the configuration.
    SingularityError
        If a motion that motors or platform take part in has no inertia.

    Notes
    -----
    Idle freedoms with inertia but nothing that holds them stay in the system, with zero eigenvalues; those without
    inertia do not move.
    """
    state = as_state(chain, q)
    state = State(state.chain, state.q)  # at rest
    chain = state.chain
    needed = inverse_dynamics(state, wrenches=wrenches)
    tau = needed.tau_motor if tau_motor is None else as_array("tau_motor", tau_motor, (chain.nu,))
    left = _without_hanging(state, forward_dynamics(state, tau_motor=tau, wrenches=wrenches).a)
    left = left / chain.tangent_scale
    if np.abs(left).max(initial=0.0) > _AT_REST * max(1.0, float(np.linalg.norm(chain.gravity))):
        worst = int(np.argmax(np.abs(left)))
        raise InputError(
            f"q is no equilibrium under these efforts: '{chain.tangent_names[worst]}' accelerates with "
            f"{left[worst]:.3g} robot sizes or radians per s²; leave tau_motor out, or choose a configuration at rest "
            "(idle freedoms hang down)"
        )
    motions, names = coordinate_motions(state)
    slopes = forward_dynamics_derivatives(state, tau_motor=tau, wrenches=wrenches)
    scale = chain.tangent_scale[:, None]
    coordinates = np.linalg.pinv(motions / scale) / scale.T  # ξ of a motion
    n = motions.shape[1]
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = coordinates @ slopes.a_q @ motions
    B = np.vstack([np.zeros((n, chain.nu)), coordinates @ slopes.a_tau])
    return LinearSystem(A, B, motions, names, state.q, tau)


def _without_hanging(state: State, a: FloatArray) -> FloatArray:
    """Leave out the acceleration of idle freedoms that is due to printed digits."""
    idle = state.freedom.idle
    if not idle.shape[1]:
        return a
    moments = idle.T @ state.M @ idle
    loads = idle.T @ (state.M @ a)
    if not hangs(state, idle, loads):
        return a
    return a - idle @ np.linalg.lstsq(moments, loads, rcond=NO_INERTIA)[0]


def coordinate_motions(state: State) -> tuple[FloatArray, tuple[str, ...]]:
    """Choose readable coordinates of the motions: motors first, idle freedoms after.

    Parameters
    ----------
    state
        State of a chain whose motors hold it.

    Returns
    -------
    motions : numpy.ndarray
        (nv, n) motion per unit of each coordinate: a motor with the other ones at rest, or an idle freedom [m, rad].
    names : tuple of str
        One per coordinate.
    """
    chain, freedom = state.chain, state.freedom
    scale = chain.tangent_scale[:, None]
    idle, held = freedom.idle / scale, freedom.active
    share = (held * scale)[chain.motor_index]
    motors = list(range(chain.nu))
    if chain.nu > held.shape[1]:
        motors = _independent(share / chain.tangent_scale[chain.motor_index, None], held.shape[1])
    moving = scale * held @ np.linalg.inv(share[motors])
    names = [*(chain.motors[k] for k in motors), *(f"idle {k + 1}" for k in range(idle.shape[1]))]
    return np.hstack([moving, freedom.idle]), tuple(names)


def _independent(share: FloatArray, count: int) -> list[int]:
    """Pick rows one after the other, each the first that is not nearly dependent on those before."""
    chosen: list[int] = []
    for k in range(share.shape[0]):
        rows = share[[*chosen, k]]
        if len(chosen) < count and np.linalg.svd(rows, compute_uv=False)[-1] > 1e-3 * np.linalg.norm(
            share, 2
        ):
            chosen.append(k)
    return chosen


# ----------------------------------------------------------------------------------------------------
# Stiffness of a chain on elastic motors, and the natural frequencies that follow
#
# Every motor is a spring between its commanded and its real position. The stiffness along the motions T that keep the
# loops closed has an elastic and a geometric part,
#
# .. math:: K = (S T)^\top k\, S T + T^\top \frac{\partial}{\partial q}\left(g - S^\top \tau - J_c^\top λ\right) T,
#
# the second one from gravity and from the preload :math:`\tau, λ` that balances it (a pendulum has no other). At an
# equilibrium K is symmetric. References: Merlet, "Parallel Robots", 2nd ed., ch. 9 (stiffness of a preloaded platform).
# ----------------------------------------------------------------------------------------------------

_NO_STIFFNESS = 1e-9
"""Stiffness of a weightless motion, relative to the largest, below which nothing holds it."""


@dataclass(frozen=True, eq=False, repr=False)
class Vibration(Brief):
    """Natural vibrations of a chain on elastic motors.

    Attributes
    ----------
    frequency
        (n,) natural frequencies, the lowest first; negative where a disturbance grows instead of swinging, with the
        rate |2π f| [Hz].
    shape
        (nv, n) motion of each vibration, its largest entry one robot size or radian [m, rad].
    stiffness
        (m, m) K along the coordinates of `motions` [N/m, N m/rad and so on].
    inertia
        (m, m) mass matrix along them [kg, kg m² and so on].
    motions
        (nv, m) tangent displacement per coordinate [m, rad].
    names
        Names of the coordinates: motors, then idle freedoms.
    stable
        Whether no disturbance grows.
    """

    frequency: FloatArray
    shape: FloatArray
    stiffness: FloatArray
    inertia: FloatArray
    motions: FloatArray
    names: tuple[str, ...]
    stable: bool


def natural_frequencies(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    motor_stiffness: ArrayLike,
    wrenches: Wrenches | None = None,
    preload: bool = True,
) -> Vibration:
    """Find the natural frequencies of a chain that stands on elastic motors.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, held by the motors; with a chain [m, rad, unit quaternions].
    motor_stiffness
        (nu,) or one number: stiffness of each motor [N/m or N m/rad].
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`: forces, which keep their axes and act at the
        origin of the frame wherever it goes [N, N m].
    preload
        Whether gravity, the wrenches, and the forces that balance them take part in the stiffness.

    Returns
    -------
    Vibration
        Frequencies and shapes; as many as there are motions with inertia.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, a stiffness is negative, or wrenches have no potential, as a moment about fixed axes.
    SingularityError
        If a motion has stiffness but no inertia: its frequency is infinite.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> stp.natural_frequencies(chain, chain.q_home, motor_stiffness=1e7).frequency.shape
    (6,)
    """
    state = _at_rest(as_state(chain, q))
    chain = state.chain
    stiffness, mass, motions, names = _matrices(state, motor_stiffness, preload, wrenches)
    moments, axes = scipy.linalg.eigh(mass)
    heavy = moments > NO_INERTIA * moments.max(initial=0.0)
    weightless = axes[:, ~heavy]
    held = np.abs(weightless.T @ stiffness).max(initial=0.0)
    if held > _NO_STIFFNESS * np.abs(stiffness).max(initial=0.0):
        raise SingularityError(
            f"{np.count_nonzero(~heavy)} motion(s) with stiffness have no inertia, so their frequency is infinite; "
            "give the bodies mass",
            smallest_singular_value=float(moments[0]),
        )
    reduced = axes[:, heavy] / np.sqrt(moments[heavy])
    squares, vectors = scipy.linalg.eigh(reduced.T @ stiffness @ reduced)
    # Round-off of the largest square leaves the zero ones this far from zero.
    squares[np.abs(squares) < 1e-13 * np.abs(squares).max(initial=0.0)] = 0.0
    shape = motions @ (reduced @ vectors)
    shape = shape / np.abs(shape / chain.tangent_scale[:, None]).max(axis=0, initial=0.0)
    return Vibration(
        frequency=np.sign(squares) * np.sqrt(np.abs(squares)) / (2 * np.pi),
        shape=shape,
        stiffness=stiffness,
        inertia=mass,
        motions=motions,
        names=names,
        stable=bool((squares >= 0).all()),
    )


def platform_stiffness(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    motor_stiffness: ArrayLike,
    wrenches: Wrenches | None = None,
    preload: bool = True,
) -> FloatArray:
    """Compute the stiffness of the platform on elastic motors: wrench per small displacement.

    Parameters
    ----------
    chain
        Closed chain whose platform has six freedoms, or a state of it.
    q
        (nq,) configuration with closed loops, held by the motors; with a chain [m, rad, unit quaternions].
    motor_stiffness
        (nu,) or one number: stiffness of each motor [N/m or N m/rad].
    wrenches
        {link: (6,)} what acts from outside, as in `natural_frequencies` [N, N m].
    preload
        Whether gravity, the wrenches, and the forces that balance them take part.

    Returns
    -------
    numpy.ndarray
        (6, 6) symmetric: force and moment at the platform origin per displacement and rotation, in world axes
        [N/m, N/rad, N m/m, N m/rad].

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, a stiffness is negative, wrenches have no potential, or the platform has fewer than six
        freedoms.
    """
    state = _at_rest(as_state(chain, q))
    chain = state.chain
    stiffness, _, motions, names = _matrices(state, motor_stiffness, preload, wrenches)
    active = [k for k, name in enumerate(names) if not name.startswith("idle ")]
    if len(active) != 6:
        raise InputError(
            f"the platform of {chain.name} has {len(active)} freedoms, not six; "
            "use natural_frequencies(...).stiffness, which is along its motors"
        )
    # Twist of the platform per motor displacement; idle freedoms do not move it.
    twist = state.P @ motions[:, active]
    inverse = np.linalg.inv(twist)
    return inverse.T @ stiffness[np.ix_(active, active)] @ inverse


def _at_rest(state: State) -> State:
    return state if not state.v.any() else State(state.chain, state.q)


def _matrices(
    state: State, motor_stiffness: ArrayLike, preload: bool, wrenches: Wrenches | None
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
    """Stiffness, mass, motions and names along the coordinates."""
    chain = state.chain
    springs = as_array(
        "motor_stiffness", as_spread("motor_stiffness", motor_stiffness, chain.nu), (chain.nu,)
    )
    outside = as_wrenches(chain, wrenches)
    effort = inverse_dynamics(state, wrenches=wrenches)
    motions, names = coordinate_motions(state)
    force_q, _, inertia = force_derivatives(state, chain.rest, effort.lambda_c, outside)
    share = motions[chain.motor_index]
    stiffness = share.T @ (springs[:, None] * share)
    if preload:
        geometric = motions.T @ force_q @ motions
        if outside is not None:
            _require_potential(geometric)
        stiffness = stiffness + (geometric + geometric.T) / 2
    return stiffness, motions.T @ inertia @ motions, motions, names


def _require_potential(geometric: FloatArray) -> None:
    """Refuse wrenches that do work on a closed path: their part of the stiffness is not symmetric."""
    turning = np.abs(geometric - geometric.T).max(initial=0.0)
    if turning > CONSISTENT * np.abs(geometric).max(initial=0.0):
        raise InputError(
            f"wrenches have no potential here: their stiffness along the coordinates misses symmetry by {turning:.3g}, "
            "as that of a moment about fixed axes does; pass forces at the links on which they act, or ask linearise"
        )
