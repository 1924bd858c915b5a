r"""Vibrations of a chain on elastic motors: stiffness, natural and damped frequencies, and how it answers shaking.

Every motor is a spring and a damper between its commanded and its real position. Along the motions T that keep the
loops closed, with displacements :math:`\xi`,

.. math:: M \ddot\xi + D \dot\xi + K \xi = (S T)^\top (k + d\,s)\,δx - T^\top (M_b\,\ddot u + w(-φ \times g)),

with δx commanded displacements of the motors, u = [x; φ] those of the ground about the world's origin, M_b the joint
efforts per acceleration of the ground, and w those of a field of weight, which turns for those who stand on the ground.
The stiffness has an elastic and a geometric part,

.. math:: K = (S T)^\top k\, S T + T^\top \frac{\partial}{\partial q}\left(g - S^\top \tau - J_c^\top λ - f\right) T,

the second one from gravity, from the preload :math:`\tau, λ` that balances it (a pendulum has no other), and from the
springs f of the joints. At an equilibrium K is symmetric. Dry friction is left out: no linear system has any.
References: Merlet, "Parallel Robots", 2nd ed., ch. 9 (stiffness of a preloaded platform).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import pinocchio as pin
import scipy.linalg

from stewart_pin.brief import Brief
from stewart_pin.building.joints import without_dry_friction
from stewart_pin.checks import as_array, as_spread
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.mechanics.derivatives import force_derivatives
from stewart_pin.mechanics.effort import weight_moved
from stewart_pin.mechanics.equilibrium import coordinate_motions, require_balance
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import OutsideWrenches, Wrenches, as_wrenches, outside_efforts
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import CONSISTENT, NO_INERTIA
from stewart_pin.typing import ArrayLike, ComplexArray, FloatArray

_NO_STIFFNESS = 1e-9
"""Stiffness of a weightless motion, relative to the largest, below which nothing holds it."""
_CANCELLED = 64 * np.finfo(float).eps
"""Share of the sum of its terms, all taken as positive, below which a stiffness is their round-off."""
_NO_DAMPING = 1e-13
"""Damping of a motion that nothing holds, relative to the largest, below which it is round-off."""
_SLOW = 1e-5
"""Share of the fastest pole below which a slow one has lost more than a third of its digits to it."""
_HIGHEST = 1e100
"""Frequency whose square still has a number [Hz]."""


@dataclass(frozen=True, eq=False, repr=False)
class Vibration(Brief):
    """Natural vibrations of a chain on elastic motors.

    Attributes
    ----------
    frequency
        (n,) natural frequencies, the lowest first; negative where a disturbance grows instead of swinging, with the
        rate ``|2π f|`` [Hz].
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
    poles
        (k,) complex eigenvalues with damping, the slowest first: of each pair the one that turns forwards; those that
        do not swing one by one [1/s].
    """

    frequency: FloatArray
    shape: FloatArray
    stiffness: FloatArray
    inertia: FloatArray
    motions: FloatArray
    names: tuple[str, ...]
    stable: bool
    poles: ComplexArray

    @property
    def damped_frequency(self) -> FloatArray:
        """(k,) frequency with which each of the poles swings, zero for those that do not [Hz]."""
        return np.asarray(self.poles.imag, dtype=float) / (2 * np.pi)

    @property
    def damping_ratio(self) -> FloatArray:
        """(k,) damping of each of the poles, as a share of the critical one; negative where it grows, dimensionless."""
        size, real = np.abs(self.poles), np.asarray(self.poles.real, dtype=float)
        return np.divide(-real, size, out=np.zeros_like(size), where=size > 0)


def natural_frequencies(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    motor_stiffness: ArrayLike,
    motor_damping: ArrayLike = 0.0,
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
    motor_damping
        (nu,) or one number: damping of each motor, beside that of the joints [N s/m or N m s/rad].
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`: forces, which keep their axes and act at the
        origin of the frame wherever it goes [N, N m].
    preload
        Whether gravity, the wrenches, and the forces that balance them take part in the stiffness. Springs of joints
        always do, and armature in the inertia.

    Returns
    -------
    Vibration
        Frequencies and shapes, without damping; as many as there are motions with inertia. With damping its poles.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, q is no equilibrium, a stiffness is negative, or wrenches have no potential, as a moment
        about fixed axes.
    SingularityError
        If a motion has stiffness but no inertia: its frequency is infinite.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> stp.natural_frequencies(chain, chain.q_home, motor_stiffness=1e7).frequency.shape
    (6,)
    """
    system = _elastic(_at_rest(as_state(chain, q)), motor_stiffness, motor_damping, preload, wrenches)
    chain, stiffness, mass, motions = system.state.chain, system.stiffness, system.mass, system.motions
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
        names=system.names,
        stable=bool((squares >= 0).all()),
        poles=_poles(squares, vectors.T @ (reduced.T @ system.damping @ reduced) @ vectors),
    )


def _poles(squares: FloatArray, damping: FloatArray) -> ComplexArray:
    """Eigenvalues of z'' + damping z' + squares z = 0, one of each pair."""
    if not damping.any():
        roots = np.sqrt(np.abs(squares))
        swinging, others = roots[squares > 0] * 1j, roots[squares <= 0]
        return _slowest_first(np.concatenate([swinging, others, -others]) + 0.0)
    # What nothing holds has a pole at zero, and another one if nothing damps it. These are told, not computed: beside
    # fast poles, round-off does not tell them from slow ones.
    held, free = squares != 0, squares == 0
    rates, axes = np.linalg.eigh(damping[np.ix_(free, free)])
    damped = np.abs(rates) > _NO_DAMPING * np.abs(damping).max()
    count = int(np.count_nonzero(held))
    turn = np.zeros((len(squares), count + int(np.count_nonzero(damped))))
    turn[np.flatnonzero(held), np.arange(count)] = 1.0
    turn[free, count:] = axes[:, damped]
    zeros = np.zeros(2 * int(np.count_nonzero(free)) - int(np.count_nonzero(damped)), dtype=complex)
    # States: displacements of what is held, and all rates; this matrix is regular.
    size = count + turn.shape[1]
    system = np.zeros((size, size))
    system[:count, count : 2 * count] = np.eye(count)
    system[count : 2 * count, :count] = -np.diag(squares[held])
    system[count:, count:] = -turn.T @ damping @ turn
    return _slowest_first(np.concatenate([zeros, _eigenvalues(system)]))


def _eigenvalues(system: FloatArray) -> ComplexArray:
    """Eigenvalues of a regular matrix, the small ones to their own digits: they are the large ones of its inverse."""
    fast = _by_size(np.linalg.eigvals(system))
    if not len(fast) or abs(fast[0]) > _SLOW * abs(fast[-1]):
        return fast
    slow = _by_size(1.0 / np.linalg.eigvals(np.linalg.inv(system)))
    # Each from the end where it is exact; parted at the widest gap, which no pair straddles.
    size = np.log(np.where(np.abs(fast) > _SLOW * abs(fast[-1]), np.abs(fast), np.abs(slow)))
    split = int(np.argmax(np.diff(size))) + 1
    return np.concatenate([slow[:split], fast[split:]])


def _by_size(values: FloatArray | ComplexArray) -> ComplexArray:
    return np.asarray(values, dtype=complex)[np.argsort(np.abs(values))]


def _slowest_first(poles: ComplexArray) -> ComplexArray:
    poles = poles[poles.imag >= 0]
    return poles[np.lexsort((poles.real, poles.imag, np.abs(poles)))]


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
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, held by the motors; with a chain [m, rad, unit quaternions].
    motor_stiffness
        (nu,) or one number: stiffness of each motor [N/m or N m/rad].
    wrenches
        {link: (6,)} what acts from outside, as in `natural_frequencies` [N, N m].
    preload
        Whether gravity, the wrenches, and the forces that balance them take part. Springs of joints always do.

    Returns
    -------
    numpy.ndarray
        (6, 6) symmetric: force and moment at the platform origin per displacement and rotation, in world axes
        [N/m, N/rad, N m/m, N m/rad]. Of a platform with fewer freedoms it is singular: it takes displacements that
        the platform can do, motors among themselves as their springs have it, and gives of their wrench the least,
        lengths in robot sizes; the loops add what they like. See `platform_compliance`, which has no such choice.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, q is no equilibrium, a stiffness is negative, or wrenches have no potential.
    """
    system = _elastic(_at_rest(as_state(chain, q)), motor_stiffness, 0.0, preload, wrenches)
    chain, stiffness = system.state.chain, system.stiffness
    u, s, vt = np.linalg.svd(system.twists / chain.twist_sizes[:, None], full_matrices=False)
    n, count = len(stiffness), system.state.freedom.count.platform
    # y = V^T ξ of a displacement that the platform can do, and of all ξ with this y the one that K prefers: K ξ = V μ.
    reach = (u[:, :count] / s[:count]).T / chain.twist_sizes
    # In units of its own each row has entries of one, however unlike the motors are.
    units = np.sqrt(np.abs(np.diagonal(stiffness)))
    units = np.where(units > 0, units, max(1.0, units.max(initial=0.0)))
    rows = vt[:count] / units
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = rows / sizes
    system_matrix = np.block([[stiffness / np.outer(units, units), rows.T], [rows, np.zeros((count, count))]])
    right = np.vstack([np.zeros((n, count)), np.eye(count)])
    own = -np.linalg.lstsq(system_matrix, right, rcond=1e-12)[0][n:] / (sizes * sizes.T)
    own = (own + own.T) / 2
    return reach.T @ own @ reach


def platform_compliance(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    motor_stiffness: ArrayLike,
    wrenches: Wrenches | None = None,
    preload: bool = True,
) -> FloatArray:
    """Compute the compliance of the platform on elastic motors: small displacement per wrench.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, held by the motors; with a chain [m, rad, unit quaternions].
    motor_stiffness
        (nu,) or one number: stiffness of each motor [N/m or N m/rad].
    wrenches
        {link: (6,)} what acts from outside, as in `natural_frequencies` [N, N m].
    preload
        Whether gravity, the wrenches, and the forces that balance them take part. Springs of joints always do.

    Returns
    -------
    numpy.ndarray
        (6, 6) symmetric: displacement and rotation of the platform origin per force and moment on it, in world axes
        [m/N, m/(N m), rad/N, rad/(N m)]. What the platform cannot do has no compliance.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, q is no equilibrium, a stiffness is negative, or wrenches have no potential.
    SingularityError
        If nothing holds a motion of the platform: its compliance is infinite.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("five_bar")
    >>> soft = stp.dynamics.platform_compliance(chain, chain.q_home, motor_stiffness=1e4)
    >>> int(np.linalg.matrix_rank(soft))
    2
    """
    system = _elastic(_at_rest(as_state(chain, q)), motor_stiffness, 0.0, preload, wrenches)
    loose = (
        "nothing holds a motion of the platform, so its compliance is infinite; give every motor a stiffness"
    )
    soft = system.twists @ _answer(system, 0.0, system.twists.T, loose).real
    return (soft + soft.T) / 2


def _at_rest(state: State) -> State:
    chain = without_dry_friction(state.require_still_ground("a vibration").chain)
    return state if chain is state.chain and not state.v.any() else State(chain, state.q)


@dataclass(frozen=True, eq=False)
class _Elastic:
    """What swings: M ξ'' + D ξ' + K ξ, with dq = T ξ."""

    state: State
    stiffness: FloatArray
    damping: FloatArray
    mass: FloatArray
    motions: FloatArray
    names: tuple[str, ...]
    springs: FloatArray
    dampers: FloatArray
    outside: OutsideWrenches | None

    @property
    def twists(self) -> FloatArray:
        """(6, n) twist of the platform per coordinate; idle freedoms leave it at rest, but for round-off."""
        return _without_idle(self.state, self.state.P @ self.motions)

    @property
    def share(self) -> FloatArray:
        """(nu, n) displacement of each motor per coordinate."""
        return _without_idle(self.state, self.motions[self.state.chain.motor_index])


def _without_idle(state: State, effects: FloatArray) -> FloatArray:
    """Take away what idle freedoms do to motors and platform: round-off, which would couple them to stiff motors."""
    effects = effects.copy()
    effects[:, effects.shape[1] - state.freedom.idle.shape[1] :] = 0.0
    return effects


def _elastic(
    state: State,
    motor_stiffness: ArrayLike,
    motor_damping: ArrayLike,
    preload: bool,
    wrenches: Wrenches | None,
) -> _Elastic:
    """Stiffness, damping, mass, motions and names along the coordinates."""
    chain = state.chain
    springs, dampers = (
        as_array(name, as_spread(name, value, chain.nu), (chain.nu,))
        for name, value in (("motor_stiffness", motor_stiffness), ("motor_damping", motor_damping))
    )
    outside = as_wrenches(chain, wrenches)
    effort = inverse_dynamics(state, wrenches=wrenches)
    if preload:
        require_balance(
            state, effort.a, "choose a configuration at rest (idle freedoms hang down), or pass preload=False"
        )
    motions, names = coordinate_motions(state)
    force_q, force_v, inertia = force_derivatives(state, chain.rest, effort.lambda_c, outside)
    share = _without_idle(state, motions[chain.motor_index])
    stiffness = share.T @ (springs[:, None] * share)
    if preload:
        geometric = motions.T @ force_q @ motions
        if outside is not None:
            _require_potential(geometric)
        # What is left of terms that cancel is no stiffness: an idle rod would be held by it, against all others.
        weights = np.sqrt(weight_moved(state, motions))
        terms = np.abs(motions).T @ np.abs(force_q) @ np.abs(motions) + np.outer(weights, weights)
        geometric = np.where(np.abs(geometric) > _CANCELLED * terms, geometric, 0.0)
        stiffness = stiffness + (geometric + geometric.T) / 2
    elif state.effects is not None:
        stiffness = stiffness + motions.T @ state.effects.stiffness() @ motions
    damping = share.T @ (dampers[:, None] * share) + motions.T @ force_v @ motions
    mass = motions.T @ inertia @ motions
    return _Elastic(state, stiffness, damping, mass, motions, names, springs, dampers, outside)


def _require_potential(geometric: FloatArray) -> None:
    """Refuse wrenches that do work on a closed path: their part of the stiffness is not symmetric."""
    turning = np.abs(geometric - geometric.T).max(initial=0.0)
    if turning > CONSISTENT * np.abs(geometric).max(initial=0.0):
        raise InputError(
            f"wrenches have no potential here: their stiffness along the coordinates misses symmetry by {turning:.3g}, "
            "as that of a moment about fixed axes does; pass forces at the links on which they act, or ask linearise"
        )


# ----------------------------------------------------------------------------------------------------
# Answers to shaking, frequency by frequency
# ----------------------------------------------------------------------------------------------------

Source = Literal["motor_position", "motor_effort", "base"]
"""What shakes: commanded positions of the elastic motors, efforts beside them, or the ground."""
_TWIST = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Brief):
    """How a platform answers small harmonic shaking.

    Attributes
    ----------
    frequency
        (N,) [Hz].
    source
        What shakes.
    inputs
        Names of the inputs: motors; or displacements ``x y z`` and rotations ``rx ry rz`` of the ground about the
        origin of the world.
    outputs
        Displacements ``x y z`` and rotations ``rx ry rz`` of the platform frame, world axes; with the ground as source
        those of a resting observer.
    values
        (N, 6, k) complex: displacement [m] or rotation [rad] of the platform per unit of each input [m, rad, N or N m].
    """

    frequency: FloatArray
    source: Source
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    values: ComplexArray

    @property
    def gain(self) -> FloatArray:
        """(N, 6, k) amplitudes [m or rad per m, rad, N or N m]."""
        return np.abs(self.values)

    @property
    def phase(self) -> FloatArray:
        """(N, 6, k) by how much the platform is ahead, without jumps along the frequencies [rad]."""
        return np.unwrap(np.angle(self.values), axis=0)


def frequency_response(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    frequency: ArrayLike,
    source: Source = "motor_position",
    motor_stiffness: ArrayLike,
    motor_damping: ArrayLike = 0.0,
    wrenches: Wrenches | None = None,
    preload: bool = True,
) -> FrequencyResponse:
    """Compute how the platform answers small harmonic shaking of its motors or of the ground.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, held by the motors; with a chain [m, rad, unit quaternions].
    frequency
        (N,) frequencies, zero or more [Hz].
    source
        ``"motor_position"``: commanded positions of the motors, at the other ends of their springs and dampers.
        ``"motor_effort"``: efforts beside these. ``"base"``: displacements and rotations of the ground.
    motor_stiffness
        (nu,) or one number: stiffness of each motor [N/m or N m/rad].
    motor_damping
        (nu,) or one number: damping of each motor, beside that of the joints [N s/m or N m s/rad].
    wrenches
        {link: (6,)} what acts from outside, as in `natural_frequencies`; they do not turn with the ground [N, N m].
    preload
        Whether gravity, the wrenches, and the forces that balance them take part.

    Returns
    -------
    FrequencyResponse
        Complex amplitudes of the platform's motion; see `viz.plot_frequency_response`.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, q is no equilibrium, a stiffness or a frequency is negative, the source is unknown, or
        wrenches have no potential.
    SingularityError
        If a frequency is a natural one without damping.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> found = stp.dynamics.frequency_response(
    ...     chain, chain.q_home, frequency=[0.0, 5.0], source="base", motor_stiffness=1e6, motor_damping=1e3
    ... )
    >>> found.values.shape, bool(np.allclose(found.gain[0, 2, 2], 1.0))  # lifted slowly, it comes along
    ((2, 6, 6), True)
    """
    if source not in get_args(Source):
        raise InputError(f"source must be one of {', '.join(get_args(Source))}, got {source!r}")
    values = np.atleast_1d(as_array("frequency", frequency, np.shape(frequency)))
    if values.ndim != 1 or not ((values >= 0) & (values <= _HIGHEST)).all():
        raise InputError(
            f"frequency must hold frequencies from 0 to {_HIGHEST:g} Hz, one after the other, got {frequency!r}"
        )
    system = _elastic(_at_rest(as_state(chain, q)), motor_stiffness, motor_damping, preload, wrenches)
    state, chain = system.state, system.state.chain
    share = system.share
    carried, felt, tilted = np.zeros((6, chain.nu)), np.zeros((1, 6)), np.zeros((1, 6))
    if source == "base":
        carried = pin.SE3(np.eye(3), state.pose.translation).toActionMatrixInverse()
        felt = _felt(system)
        tilted = _tilted(system) if preload else np.zeros_like(felt)
    resonance = (
        "at {:g} Hz a motion is in resonance without damping, or nothing holds it: its amplitude is infinite; give it "
        "damping, or leave the frequency out"
    )
    found = np.empty((len(values), *carried.shape), dtype=complex)
    for k, s in enumerate(2j * np.pi * values):
        match source:
            case "motor_position":
                push = share.T * (system.springs + s * system.dampers)
            case "motor_effort":
                push = share.T
            case _:
                push = -(s * s * felt + tilted)
        found[k] = carried + system.twists @ _answer(system, s, push, resonance.format(values[k]))
    inputs = _TWIST if source == "base" else chain.motors
    return FrequencyResponse(values, source, inputs, _TWIST, found)


def _answer(system: _Elastic, s: complex, push: FloatArray | ComplexArray, trouble: str) -> ComplexArray:
    """Displacements under a push; motions that nothing holds and nothing pushes stay."""
    parts = system.stiffness, s * system.damping, s * s * system.mass
    # Coordinates in units in which each weighs one, so that a light idle rod counts beside a heavy platform.
    units = np.sqrt(sum(np.abs(np.diagonal(part)) for part in parts))
    units = np.where(units > 0, units, 1.0)
    u, sizes, vt = np.linalg.svd(sum(parts) / np.outer(units, units))
    lost = sizes <= _NO_STIFFNESS
    pushed = u.conj().T @ (push / units[:, None])
    if np.abs(pushed[lost]).max(initial=0.0) > _NO_STIFFNESS * np.abs(pushed).max(initial=0.0):
        raise SingularityError(trouble, smallest_singular_value=float(sizes.min()))
    answer = vt[~lost].conj().T @ (pushed[~lost] / sizes[~lost, None])
    return (answer / units[:, None]).astype(complex)


def _felt(system: _Elastic) -> FloatArray:
    """(n, 6) efforts along the coordinates per acceleration of the ground: Tᵀ M_b, by Newton and Euler at rest."""
    chain, state = system.state.chain, system.state
    model, columns = chain.mass_model.copy(), []
    for axis in np.eye(6):
        model.gravity = pin.Motion(-axis)  # a ground that accelerates is a field of weight the other way
        columns.append(chain.mass_unit * pin.rnea(model, model.createData(), state.q, chain.rest, chain.rest))
    return system.motions.T @ np.array(columns).T


def _tilted(system: _Elastic) -> FloatArray:
    """(n, 6) efforts along the coordinates per rotation φ of the ground: weight and wrenches turn by -φ beneath it."""
    chain, state = system.state.chain, system.state
    model, found = chain.mass_model.copy(), np.zeros((len(system.names), 6))
    for k, axis in enumerate(np.eye(3)):
        model.gravity = pin.Motion(-np.cross(axis, chain.gravity), np.zeros(3))
        efforts = chain.mass_unit * pin.computeGeneralizedGravity(model, model.createData(), state.q)
        if system.outside is not None:
            turned = -np.cross(axis, system.outside.values.reshape(-1, 2, 3)).reshape(-1, 6)
            efforts = efforts - outside_efforts(state, replace(system.outside, values=turned))
        found[:, 3 + k] = system.motions.T @ efforts
    return found
