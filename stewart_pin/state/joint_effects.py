"""What joints of a chain do by themselves in a state: the efforts of springs, damping and dry friction.

They stand on the right of the equation of motion of the tree, M a + nle = Sᵀ tau_motor + J_cᵀ lambda_c + Σ J_fᵀ w_f +
these. Armature is in M already, where Pinocchio puts it.

Dry friction opposes the motion of its joint; where that is at rest, the motion that an acceleration is about to start;
and at rest altogether it is anything between its two limits, whatever equilibrium asks for.

This is the one place of the formulations on the tree that knows it; `mechanics.constraint_matrix` and
`mechanics.articulated_body`, which judge them, put efforts on bodies and joints by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
import proxsuite
from numpy.polynomial import polynomial

from stewart_pin.errors import ConvergenceError
from stewart_pin.model.description import JointKind, physics_coordinates
from stewart_pin.model.joint_physics import JointPhysics, read_fields
from stewart_pin.state.joint_coordinates import TURNS, Coordinate, coordinates_of_ball, coordinates_of_loop
from stewart_pin.tolerances import AT_REST, AT_REST_BESIDE
from stewart_pin.typing import BoolArray, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain
    from stewart_pin.state.state import State

_STEP = 1e-5
"""Displacement, in radians and robot sizes, by which efforts of balls and loops are differentiated: with rounding 1e-16
and third derivatives of one, derivatives are right to 1e-10."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs and constant forces along coordinates.

    Attributes
    ----------
    rest
        (k,) where they are at rest [m or rad].
    polynomial
        (d, k) coefficients of the effort by powers of the displacement, the constant one first [N or N m per power].
    """

    rest: FloatArray
    polynomial: FloatArray

    def efforts(self, x: FloatArray) -> FloatArray:
        """Tell the efforts at some positions.

        Parameters
        ----------
        x
            (k,) positions [m or rad].

        Returns
        -------
        numpy.ndarray
            (k,) efforts [N or N m].
        """
        return polynomial.polyval(x - self.rest, self.polynomial, tensor=False)

    def slopes(self, x: FloatArray) -> FloatArray:
        """Differentiate the efforts by the positions.

        Parameters
        ----------
        x
            (k,) positions [m or rad].

        Returns
        -------
        numpy.ndarray
            (k,) slopes [N/m or N m/rad].
        """
        return polynomial.polyval(x - self.rest, polynomial.polyder(self.polynomial), tensor=False)

    def energy(self, x: FloatArray) -> float:
        """Sum up the energy that they hold.

        Parameters
        ----------
        x
            (k,) positions [m or rad].

        Returns
        -------
        float
            Zero at rest [J].
        """
        own = -polynomial.polyval(x - self.rest, polynomial.polyint(self.polynomial), tensor=False)
        return float(np.sum(own))


def _springs(physics: list[JointPhysics]) -> Springs:
    degree = max((len(own.polynomial) for own in physics), default=1)
    table = np.zeros((degree, len(physics)))
    for k, own in enumerate(physics):
        table[: len(own.polynomial), k] = own.polynomial
    return Springs(np.array([own.rest for own in physics]), table)


class JointEffects:
    """What the joints of one chain do by themselves, in arrays; armature, damping and friction are read off the model.

    Parameters
    ----------
    chain
        Closed chain.
    """

    def __init__(self, chain: ClosedChain) -> None:
        self._chain = chain
        own = [joint for joint in chain.mechanism.joints if joint.physics.pushes]
        entries = {joint.name: chain.model.joints[chain.model.getJointId(joint.name)] for joint in own}
        single = [joint for joint in own if joint.has_axis]
        self.in_q = np.array([entries[joint.name].idx_q for joint in single], dtype=int)
        self.in_v = np.array([entries[joint.name].idx_v for joint in single], dtype=int)
        self.springs = _springs([joint.physics for joint in single])
        # Balls that are springs, and joints that close loops: coordinates that no configuration holds.
        pairs: list[tuple[Coordinate, JointPhysics, int]] = []
        for joint in own:
            if joint.kind is JointKind.SPHERICAL:
                entry = entries[joint.name]
                spring = JointPhysics(stiffness=joint.physics.stiffness)
                turns = coordinates_of_ball(joint, entry.idx_q, entry.idx_v, TURNS)
                pairs += [(each, spring, -1) for each in turns]
        for k, loop in enumerate(chain.loops):
            for word, physics in zip(physics_coordinates(loop.kind), loop.physics, strict=False):
                words = TURNS if word == "turn" else (word,)
                pairs += [(each, physics, k) for each in coordinates_of_loop(chain, k, words)]
        pairs = [(each, physics, k) for each, physics, k in pairs if physics]
        self.coordinates = tuple(each for each, _, _ in pairs)
        self.loops = tuple(k for _, _, k in pairs)  # of which loop each is; -1 of a ball of the tree
        self.own_springs = _springs([physics for _, physics, _ in pairs])
        self.own_damping = np.array([physics.damping for _, physics, _ in pairs])
        self.own_friction = np.array([physics.friction for _, physics, _ in pairs])
        self.pushes = bool(self.in_v.size or self.coordinates)
        # Angles of loops are known up to whole turns: displacements are taken to the nearest.
        self.own_angles = np.array([each.is_angle for each in self.coordinates], dtype=bool)

    @property
    def present(self) -> bool:
        """Whether joints have rotors, springs, damping or friction, as the model stands."""
        model = self._chain.model
        fields = model.armature, model.damping, model.upperDryFrictionLimit
        return self.pushes or any(field.any() for field in fields)

    def in_state(self, state: State) -> Effects:
        """Tell what joints do in a state.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        Effects
            Their efforts.
        """
        fields = read_fields(self._chain.model)
        return Effects(self, state, fields["damping"], fields["friction"])

    def elastic_energy(self, state: State) -> float:
        """Sum up the energy of springs and constant forces.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        float
            [J]; zero where springs are at rest, and constant forces at the rest position.
        """
        energy = self.springs.energy(state.q[self.in_q])
        if self.coordinates:
            energy += self.own_springs.energy(self.positions(state))
        return energy

    def positions(self, state: State) -> FloatArray:
        """Read the coordinates of balls and loops.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        numpy.ndarray
            (k,) positions, angles within half a turn of rest [m or rad].
        """
        x = np.array([each.at(state._placed, state.q) for each in self.coordinates])
        rest = self.own_springs.rest
        return np.where(self.own_angles, rest + (x - rest + np.pi) % (2 * np.pi) - np.pi, x)

    def rows(self, state: State) -> FloatArray:
        """Differentiate these coordinates.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        numpy.ndarray
            (k, nv) rates per tangent velocity [m and rad per m or rad].
        """
        found = [each.row(state._placed, state.q) for each in self.coordinates]
        return np.array(found).reshape(-1, self._chain.nv)


class Effects:
    """What joints do by themselves in one state.

    Parameters
    ----------
    table
        Of the chain.
    state
        The state.
    damping, friction
        (nv,) of the tangent entries [N s/m and N, or N m s/rad and N m].
    """

    def __init__(self, table: JointEffects, state: State, damping: FloatArray, friction: FloatArray) -> None:
        self._table, self._state = table, state
        self.damping, self.friction = damping, friction

    @cached_property
    def rows(self) -> FloatArray:
        """(k, nv) Jacobian of the coordinates of balls and loops [m and rad per m or rad]."""
        return self._table.rows(self._state)

    @cached_property
    def elastic(self) -> Tangent:
        """(nv,) efforts of springs and constant forces [N, N m]."""
        table, state = self._table, self._state
        efforts = np.zeros(state.chain.nv)
        efforts[table.in_v] = table.springs.efforts(state.q[table.in_q])
        if table.coordinates:
            efforts += table.own_springs.efforts(table.positions(state)) @ self.rows
        return efforts

    @cached_property
    def viscous(self) -> Tangent:
        """(nv,) efforts of damping [N, N m]."""
        v = self._state.v
        efforts = -self.damping * v
        if self._table.coordinates:
            efforts -= (self._table.own_damping * (self.rows @ v)) @ self.rows
        return efforts

    @cached_property
    def smooth(self) -> Tangent:
        """(nv,) efforts of springs and damping [N, N m]."""
        return self.elastic + self.viscous if self._state.v.any() else self.elastic

    @cached_property
    def rubbing(self) -> Rubbing:
        """Coordinates with dry friction."""
        entries = np.flatnonzero(self.friction)
        own = np.flatnonzero(self._table.own_friction) if self._table.coordinates else np.zeros(0, dtype=int)
        chain = self._state.chain
        rows = np.eye(chain.nv)[entries]
        sizes = chain.tangent_scale[entries]
        if own.size:
            rows = np.vstack([rows, self.rows[own]])
            lengths = [1.0 if self._table.coordinates[k].is_angle else chain.length_scale for k in own]
            sizes = np.concatenate([sizes, lengths])
        limits = np.concatenate([self.friction[entries], self._table.own_friction[own]])
        v, bias = self._state.v, np.zeros(len(rows))
        if own.size and v.any():
            # The rows of loops turn along the velocity: their rates are differences over a step of it.
            h = _STEP / float(np.abs(v / chain.tangent_scale).max())
            after, before = (self._table.rows(_displaced(self._state, step * v))[own] for step in (h, -h))
            bias[len(entries) :] = (after - before) @ v / (2 * h)
        return Rubbing(rows, limits, sizes, bias, moving(rows @ v, v, sizes, chain))

    def efforts(self, a: Tangent | None = None) -> Tangent:
        """Sum up all efforts, dry friction against the motion.

        Parameters
        ----------
        a
            (nv,) acceleration, which tells where joints at rest are about to move; default: they stay [m/s², rad/s²].

        Returns
        -------
        numpy.ndarray
            (nv,) [N, N m].
        """
        rub = self.rubbing
        if not rub.limits.size:
            return self.smooth
        return self.smooth - (rub.limits * self.directions(a)) @ rub.rows

    def loop_wrenches(self, a: Tangent, held: FloatArray) -> FloatArray:
        """Tell what joints that close loops give, as wrenches.

        Parameters
        ----------
        a
            (nv,) acceleration [m/s², rad/s²].
        held
            (k,) friction of the coordinates of `rubbing` beside that of `efforts`: of those that it holds [N or N m].

        Returns
        -------
        numpy.ndarray
            (loops, 6) [force; moment] of each on link 2, at the origin of its frame 1 and in its axes [N, N m].
        """
        table, state = self._table, self._state
        wrenches = np.zeros((len(state.chain.loops), 6))
        if not table.coordinates:
            return wrenches
        given = table.own_springs.efforts(table.positions(state)) - table.own_damping * (self.rows @ state.v)
        own = np.flatnonzero(table.own_friction)
        if own.size:
            rub = held - self.rubbing.limits * self.directions(a)
            given[own] += rub[len(rub) - own.size :]
        for each, loop, effort in zip(table.coordinates, table.loops, given, strict=True):
            if loop >= 0:
                wrenches[loop] += effort * each.wrench(state._placed, state.q)
        return wrenches

    def directions(self, a: Tangent | None = None) -> FloatArray:
        """Tell where each coordinate with dry friction moves, or is about to: 1, -1, or 0 where it stays at rest.

        Parameters
        ----------
        a
            (nv,) acceleration, or None [m/s², rad/s²].

        Returns
        -------
        numpy.ndarray
            (k,) dimensionless.
        """
        rub, v, chain = self.rubbing, self._state.v, self._state.chain
        found = np.where(rub.moving, np.sign(rub.rows @ v), 0.0)
        if a is not None and not rub.moving.all():
            rates = rub.rows @ a + rub.bias
            starts = moving(rates, a, rub.sizes, chain)
            found = np.where(rub.moving, found, np.where(starts, np.sign(rates), 0.0))
        return found

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """Differentiate the efforts by configuration and velocity; those of dry friction do not change.

        Returns
        -------
        by_q, by_v : numpy.ndarray
            (nv, nv) each [N, N m per m, rad, and per m/s, rad/s].
        """
        table, state = self._table, self._state
        by_q, by_v = np.zeros((2, state.chain.nv, state.chain.nv))
        by_q[table.in_v, table.in_v] = table.springs.slopes(state.q[table.in_q])
        np.fill_diagonal(by_v, -self.damping)
        if table.coordinates:
            by_v -= self.rows.T @ (table.own_damping[:, None] * self.rows)
            for k, step in enumerate(np.diag(_STEP * state.chain.tangent_scale)):
                after, before = (self._own_efforts(_displaced(state, sign * step)) for sign in (1.0, -1.0))
                by_q[:, k] += (after - before) / (2 * step[k])
        return by_q, by_v

    def stiffness(self) -> FloatArray:
        """Differentiate the efforts of springs along their own coordinates, as if these did not turn.

        Returns
        -------
        numpy.ndarray
            (nv, nv) what holds back, symmetric [N, N m per m, rad].
        """
        table, state = self._table, self._state
        found = np.zeros((state.chain.nv, state.chain.nv))
        found[table.in_v, table.in_v] = -table.springs.slopes(state.q[table.in_q])
        if table.coordinates:
            slopes = table.own_springs.slopes(table.positions(state))
            found -= self.rows.T @ (slopes[:, None] * self.rows)
        return found

    def _own_efforts(self, state: State) -> Tangent:
        """(nv,) efforts of balls and loops elsewhere, dry friction as it is here."""
        table, rows, v = self._table, self._table.rows(state), self._state.v
        rub = np.zeros(len(rows))
        own = np.flatnonzero(table.own_friction)
        rub[own] = table.own_friction[own] * self.directions()[len(self.directions()) - len(own) :]
        return (
            table.own_springs.efforts(table.positions(state)) - table.own_damping * (rows @ v) - rub
        ) @ rows


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Coordinates with dry friction in one state.

    Attributes
    ----------
    rows
        (k, nv) Jacobian of the coordinates [m and rad per m or rad].
    limits
        (k,) dry friction [N or N m].
    sizes
        (k,) natural size of each coordinate [m or 1].
    bias
        (k,) acceleration of each that is there without that of the tangent [m/s² or rad/s²].
    moving
        (k,) mask of those that move.
    """

    rows: FloatArray
    limits: FloatArray
    sizes: FloatArray
    bias: FloatArray
    moving: BoolArray


def moving(rates: FloatArray, v: Tangent, sizes: FloatArray, chain: ClosedChain) -> BoolArray:
    """Tell which coordinates move, by more than the rounding of a velocity.

    Parameters
    ----------
    rates
        (k,) their rates, or accelerations [m/s or rad/s].
    v
        (nv,) tangent velocity, or acceleration [m/s, rad/s].
    sizes
        (k,) natural size of each [m or 1].
    chain
        Closed chain.

    Returns
    -------
    numpy.ndarray
        (k,) mask.
    """
    most = float(np.abs(v / chain.tangent_scale).max(initial=0.0))
    return np.abs(rates) > sizes * max(AT_REST, AT_REST_BESIDE * most)


def _displaced(state: State, step: Tangent) -> State:
    return type(state)(state.chain, pin.integrate(state.chain.model, state.q, step))


# ----------------------------------------------------------------------------------------------------
# Dry friction of joints at rest
#
# Of all accelerations that the loops allow, the one that is chosen has friction f do as much as it can against it: with
# b the accelerations of the coordinates at rest without f, and W what a unit of each effort adds to them, f minimises
#
#     fᵀ W f / 2 + bᵀ f,   |f_i| ≤ F_i,
#
# so that either a coordinate stays, or f_i = -F_i sign of its acceleration (Gauss's principle; Moreau, 1966).
# ----------------------------------------------------------------------------------------------------

_HELD = 1e-6
"""Distance from the limit of friction, relative to it, from which on the solver means less than the limit."""
_ROUND_OFF = 1e-10
"""Excess over a limit, and acceleration along friction, relative to the largest, that are round-off."""
_DEPENDENT = 1e-12
"""Responses of size one below which coordinates move as others do: some thousand units of round-off."""


def held_by(response: FloatArray, accelerations: FloatArray, limits: FloatArray) -> FloatArray:
    """Solve for the dry friction of coordinates at rest.

    Parameters
    ----------
    response
        (k, n) root of what a unit of each friction does: W is it times its transpose; of each coordinate more than
        round-off [1/kg^½ or 1/(kg^½ m)].
    accelerations
        (k,) accelerations of the coordinates without friction [m/s² or rad/s²].
    limits
        (k,) dry friction, above zero [N or N m].

    Returns
    -------
    numpy.ndarray
        (k,) efforts of friction; where several do the same the least ones that they can be [N or N m].

    Raises
    ------
    ConvergenceError
        If the solver finds none.
    """
    # In units in which each answers itself by one: heavy and light bodies, lengths and angles side by side.
    moved = np.linalg.norm(response, axis=1)
    root, bound, b = response / moved[:, None], limits * moved, accelerations / moved
    W = root @ root.T
    size = float(max(np.abs(b).max(), (np.abs(W) @ bound).max()))
    start = _start(W, b, bound)
    holds, left = np.abs(start) < bound * (1.0 - _HELD), np.inf
    for _ in range(4 * len(bound) + 4):
        share = _held(root, b, np.where(holds, start, np.sign(start) * bound), holds, bound)
        beyond = np.where(holds, np.abs(share) / bound - 1.0, 0.0)
        along = np.where(holds, 0.0, (W @ share + b) * np.sign(share)) / size
        left = max(float(beyond.max()), float(along.max()))
        if beyond.max() > _ROUND_OFF:  # it slips after all
            k = int(np.argmax(beyond))
            holds[k], start[k] = False, np.sign(share[k]) * bound[k]
        elif along.max() > _ROUND_OFF:  # friction would drive it
            k = int(np.argmax(along))
            holds[k] = True
        else:
            return np.clip(share, -bound, bound) / moved
    raise ConvergenceError(
        f"no dry friction of the joints at rest was found: {left:.3g} of it is left over; "
        "are some frictions many orders of magnitude larger than others?",
        residual=left,
    )


def _start(W: FloatArray, b: FloatArray, bound: FloatArray) -> FloatArray:
    """Solve the quadratic programme of friction, to the accuracy of the solver."""
    # In units of the largest friction, which W has as well: else shares grow where it is much stronger than what moves.
    largest = float(bound.max())
    qp = proxsuite.proxqp.dense.QP(len(b), 0, 0, True)
    qp.settings.eps_abs, qp.settings.max_iter = 1e-9, 10_000
    none = np.zeros((0, len(b)))
    ends = bound / largest
    qp.init(W, b / largest, none, np.zeros(0), none, np.zeros(0), np.zeros(0), -ends, ends)
    qp.solve()
    return np.clip(qp.results.x, -ends, ends) * largest


def _held(
    root: FloatArray, b: FloatArray, share: FloatArray, holds: BoolArray, bound: FloatArray
) -> FloatArray:
    """Solve for the friction of what holds, the rest as it is: the least, or the nearest within its limits."""
    share = share.copy()
    if holds.any():
        own = root[holds]
        others = b[holds] + own @ (root[~holds].T @ share[~holds])
        inner = own @ own.T
        least = -np.linalg.lstsq(inner, others, rcond=_DEPENDENT)[0]
        near = share[holds] - np.linalg.lstsq(inner, others + inner @ share[holds], rcond=_DEPENDENT)[0]
        share[holds] = least if (np.abs(least) <= bound[holds]).all() else near
    return share
