r"""The block system of the maximal coordinates.

    -I a + C η = f_p,    Cᵀ a = c_a,    f_p = -f_e - I g + v ×* I v per body.

A rotor of inertia r on the freedom of a joint resists its own acceleration ẍ = wᵀ a - b alone, with w the pair of
wrenches that a motor there would put on the two bodies: it adds w r wᵀ to I and -w r b to f_p. What else a joint does
by itself, springs, damping and dry friction with the effort f, adds -w f to f_p.

a are the spatial accelerations of the bodies, η the amplitudes of the joint wrenches; the last entries of η are the
motor efforts. Couplings give columns to C too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy.sparse

from stewart_pin.brief import Brief
from stewart_pin.mechanics.constraint_matrix.columns import (
    Columns,
    Freedoms,
    compound_freedoms,
    effort_column,
    loop_columns,
    passive_columns,
)
from stewart_pin.mechanics.constraint_matrix.joint_efforts import (
    OwnEffort,
    acting_joints,
    moves,
    own_efforts,
)
from stewart_pin.mechanics.constraint_matrix.kinematics import (
    JointMotion,
    LinkMotion,
    cross_force,
    force_at,
    spatial_inertia,
    tree_motion,
)
from stewart_pin.mechanics.constraint_matrix.topology import Topology, topology
from stewart_pin.model.description import Cable, Coupling
from stewart_pin.state.base_motion import BaseMotion
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import OutsideWrenches, Wrenches, as_wrenches
from stewart_pin.state.state import State, as_state
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

# ----------------------------------------------------------------------------------------------------
# Columns of couplings: a gear between joints, two of which may hang on four bodies
#
# With q1 = p(q2) + Σ r q, the gear gives joint 1 an effort η, joint 2 the effort -p' η, the others -r η, and demands
# a1 - p' a2 - Σ r a = p'' v2².
# ----------------------------------------------------------------------------------------------------


def coupling_parts(
    chain: ClosedChain,
    coupling: Coupling,
    layout: Topology,
    freedoms: Sequence[Freedoms],
    number: Mapping[str, int],
    q: Configuration,
    v: Tangent,
) -> list[tuple[int | None, int, Columns]]:
    """Build what a coupling does at each of its joints.

    Parameters
    ----------
    chain
        Closed chain.
    coupling
        The gear.
    layout
        Bodies and compound joints.
    freedoms
        Freedoms of each compound joint.
    number
        Index of each body.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    list
        Predecessor, successor and column of either joint.
    """
    power = np.polynomial.Polynomial(coupling.polynomial)
    parts = [(coupling.joint1, 1.0, 0.0)]
    if coupling.joint2 is not None:
        q2, v2 = _coordinate(chain, coupling.joint2, q, v)
        parts.append((coupling.joint2, -float(power.deriv()(q2)), float(power.deriv(2)(q2)) * v2**2))
    parts += [(name, -ratio, 0.0) for name, ratio in coupling.others]
    built = []
    for name, ratio, demand in parts:
        at = layout.compound(name)
        compound = layout.tree[at]
        entry = chain.model.joints[chain.model.getJointId(name)].idx_v
        column = effort_column(freedoms[at], entry, 0.0)
        scaled = Columns(ratio * column.wrenches, ratio * column.acceleration + demand)
        built.append((number[compound.predecessor], number[compound.successor], scaled))
    return built


def coupling_opening(
    chain: ClosedChain, coupling: Coupling, q: Configuration, v: Tangent, a: Tangent
) -> tuple[float, float, float]:
    """Measure how far a coupling is from being kept, by the joints' own coordinates.

    Parameters
    ----------
    chain
        Closed chain.
    coupling
        The gear.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].

    Returns
    -------
    tuple of float
        Residual of position, velocity and acceleration [m or rad, per s, per s²].
    """
    power = np.polynomial.Polynomial(coupling.polynomial)
    q1, v1 = _coordinate(chain, coupling.joint1, q, v)
    a1 = _coordinate(chain, coupling.joint1, q, a)[1]
    for name, ratio in coupling.others:
        turned, rate = _coordinate(chain, name, q, v)
        q1, v1, a1 = q1 - ratio * turned, v1 - ratio * rate, a1 - ratio * _coordinate(chain, name, q, a)[1]
    if coupling.joint2 is None:
        return q1 - float(power(0.0)), v1, a1
    q2, v2 = _coordinate(chain, coupling.joint2, q, v)
    a2 = _coordinate(chain, coupling.joint2, q, a)[1]
    slope, curve = float(power.deriv()(q2)), float(power.deriv(2)(q2))
    return q1 - float(power(q2)), v1 - slope * v2, a1 - slope * a2 - curve * v2**2


def _reel_part(
    chain: ClosedChain,
    cable: Cable,
    layout: Topology,
    freedoms: Sequence[Freedoms],
    number: Mapping[str, int],
) -> tuple[int, int, Columns]:
    """Tell what a cable does at its reel: l + ratio q is kept, so that a reaction η gives it ratio η."""
    assert cable.reel is not None
    at = layout.compound(cable.reel)
    entry = chain.model.joints[chain.model.getJointId(cable.reel)].idx_v
    column = effort_column(freedoms[at], entry, 0.0)
    compound = layout.tree[at]
    scaled = Columns(cable.ratio * column.wrenches, cable.ratio * column.acceleration)
    return number[compound.predecessor], number[compound.successor], scaled


def wound_in(chain: ClosedChain, cable: Cable, q: Configuration) -> float:
    """Measure what a reel has wound in.

    Parameters
    ----------
    chain
        Closed chain.
    cable
        Reel and ratio.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    float
        Length, 0 without a reel [m].
    """
    return (
        0.0 if cable.reel is None else cable.ratio * _coordinate(chain, cable.reel, q, np.zeros(chain.nv))[0]
    )


def _coordinate(chain: ClosedChain, name: str, q: Configuration, v: Tangent) -> tuple[float, float]:
    joint = chain.model.joints[chain.model.getJointId(name)]
    return float(q[joint.idx_q]), float(v[joint.idx_v])


# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class ConstraintMatrixSystem(Brief):
    """Maximal-coordinate equations of motion at one state.

    Attributes
    ----------
    I
        (6 n_bodies, 6 n_bodies) sparse spatial inertia, world frame at the world origin [kg, kg m, kg m²]:
        block-diagonal but for rotors, which tie the two bodies of their joint.
    C
        (6 n_bodies, n_columns) sparse matrix of joint wrenches [force, moment per unit].
    f_p
        (6 n_bodies,) gravity, velocity forces and what joints do by themselves, on the side of the wrenches [N, N m].
    c_a
        (n_columns,) demanded relative accelerations [m/s², rad/s²].
    bodies
        Names of the bodies, six rows each; the ground first.
    joints
        Names of the joints: ground, tree joints outwards, loops, couplings, motors.
    kinds
        Kind of each joint: ground, universal, prismatic, spherical, ..., motor.
    columns
        Columns of each joint.
    """

    I: scipy.sparse.csc_array  # noqa: E741 - the source's symbol
    C: scipy.sparse.csc_array
    f_p: FloatArray
    c_a: FloatArray
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    kinds: tuple[str, ...]
    columns: tuple[slice, ...]

    @property
    def matrix(self) -> scipy.sparse.csc_array:
        """Block matrix [[-I, C], [Cᵀ, 0]] (n, n) of the unknowns [a; η]."""
        return scipy.sparse.csc_array(scipy.sparse.bmat([[-self.I, self.C], [self.C.T, None]], format="csc"))

    @property
    def right_hand_side(self) -> FloatArray:
        """Vector [f_p; c_a] (n,) [N, N m, m/s², rad/s²]."""
        return np.concatenate([self.f_p, self.c_a])


@dataclass(frozen=True, eq=False)
class AssembledSystem:
    """The system together with the kinematics it was assembled from.

    Attributes
    ----------
    system
        The equations.
    topology
        Bodies and joints.
    links, joints
        Motion of every link and tree joint.
    freedoms
        Freedoms of each compound tree joint.
    resting
        Coordinates with dry friction that are at rest.
    rubbing
        What friction does at each of them for the demanded acceleration, as it is in the equations [N or N m].
    """

    system: ConstraintMatrixSystem
    topology: Topology
    links: dict[str, LinkMotion]
    joints: dict[str, JointMotion]
    freedoms: tuple[Freedoms, ...]
    resting: tuple[OwnEffort, ...]
    rubbing: FloatArray


def constraint_matrix_system(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    *,
    wrenches: Wrenches | None = None,
) -> ConstraintMatrixSystem:
    """Assemble the equations of motion in maximal coordinates.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity, with a chain [m/s, rad/s].
    a
        (nv,) tangent acceleration, of which the motors' entries are demanded; with a chain [m/s², rad/s²]. Dry friction
        of a joint at rest opposes its entry here, and does nothing where that is zero.
    wrenches
        {link: (6,)} what acts from outside: [force; moment] on the link, at the origin of its frame, world axes; a link
        without inertia that bears one and moves on its own is a body too [N, N m].

    Returns
    -------
    ConstraintMatrixSystem
        I, C, f_p, c_a with the names of bodies and joints.
    """
    state = as_state(chain, q, v, a)
    outside = as_wrenches(state.chain, wrenches)
    a, moved = state.require_accelerating(), state.base_motion
    return assemble(state.chain, state.q, state.v, a, outside=outside, base_motion=moved).system


def _moving_ground(
    base: BaseMotion, about: FloatArray, gravity: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity and acceleration (6,) of a moving ground at a point of it, and gravity (3,), in its own axes.

    Spatial ones: those of the ground's matter that is at the point of space, which lacks the ω × v of a point of it.
    """
    turn = base.rotation.T
    v, w = turn @ base.twist[:3], turn @ base.twist[3:]
    linear, angular = turn @ base.acceleration[:3] - np.cross(w, v), turn @ base.acceleration[3:]
    velocity = np.concatenate([v + np.cross(w, about), w])
    return velocity, np.concatenate([linear + np.cross(angular, about), angular]), turn @ gravity


def assemble(
    chain: ClosedChain,
    q: Configuration,
    v: Tangent,
    a: Tangent,
    about: FloatArray | None = None,
    outside: OutsideWrenches | None = None,
    base_motion: BaseMotion | None = None,
) -> AssembledSystem:
    """Assemble the equations and keep the kinematics.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    about
        (3,) point that is taken for the world origin; default: the origin itself [m].
    outside
        Wrenches from outside, or None.
    base_motion
        How the ground moves, or None.

    Returns
    -------
    AssembledSystem
        Equations and kinematics.
    """
    rotors = _rotors(chain)
    driven = tuple(dict.fromkeys([*chain.motors, *(name for name, _, _ in rotors), *acting_joints(chain)]))
    borne = {} if outside is None else outside.by_link()
    middle = np.zeros(3) if about is None else about
    ground, ground_rate, gravity = np.zeros(6), np.zeros(6), np.array(chain.gravity)
    if base_motion is not None:
        ground, ground_rate, gravity = _moving_ground(base_motion, middle, gravity)
        borne = {link: base_motion.to_base(wrench) for link, wrench in borne.items()}
    layout = topology(chain.mechanism, driven, chain.platform, loaded_links(chain, outside))
    links, joints = tree_motion(chain, q, v, middle, ground)
    number = {link.name: k for k, link in enumerate(layout.bodies)}
    gravity = np.concatenate([gravity, np.zeros(3)])

    inertias, forces = [], []
    for body in layout.bodies:
        motion = links[body.name]
        inertia = spatial_inertia(body.inertia or pin.Inertia.Zero(), motion.rotation, motion.origin)
        inertias.append(scipy.sparse.coo_array(inertia))  # block_diag of dense arrays warns (SciPy >= 1.18)
        forces.append(-inertia @ gravity + cross_force(motion.twist, inertia @ motion.twist))
    for link, wrench in borne.items():
        bearing = number[layout.carrier(link)]
        moved = force_at(links[link].origin, wrench[:3, None], wrench[3:, None])
        forces[bearing] = forces[bearing] - moved[:, 0]

    def driving(blocks: _Blocks, name: str, kind: str, joint: str, entry: int, demand: float) -> None:
        at = layout.compound(joint)
        compound = layout.tree[at]
        columns = effort_column(freedoms[at], entry, demand)
        blocks.add(name, kind, number[compound.predecessor], number[compound.successor], columns)

    blocks = _Blocks()
    blocks.add("ground", "ground", None, 0, Columns(np.eye(6), ground_rate))
    freedoms = tuple(compound_freedoms(compound, joints) for compound in layout.tree)
    for compound, freedom in zip(layout.tree, freedoms, strict=True):
        columns = passive_columns(freedom, chain.length_scale)
        if columns.acceleration.size:
            blocks.add(
                compound.name,
                compound.kind,
                number[compound.predecessor],
                number[compound.successor],
                columns,
            )
    for loop in layout.loops:
        columns = loop_columns(loop.loop, links[loop.loop.link1], links[loop.loop.link2])
        parts = [(number[loop.predecessor], number[loop.successor], columns)]
        if loop.loop.cable.reel is not None:
            parts.append(_reel_part(chain, loop.loop.cable, layout, freedoms, number))
        blocks.add_parts(loop.name, str(loop.loop.kind), parts)
    for coupling in layout.couplings:
        parts = coupling_parts(chain, coupling, layout, freedoms, number, q, v)
        blocks.add_parts(coupling.name, "coupling", parts)
    for motor, entry in zip(chain.motors, chain.motor_index, strict=True):
        driving(blocks, f"motor {motor}", "motor", motor, entry, float(a[entry]))
    inertia, force = scipy.sparse.block_diag(inertias, format="csc"), np.concatenate(forces)
    if rotors:
        turning = _Blocks()
        for name, entry, _ in rotors:
            driving(turning, name, "rotor", name, entry, 0.0)
        pairs, own = turning.matrix(force.size), np.array([amount for _, _, amount in rotors])
        inertia = inertia + pairs @ scipy.sparse.diags_array(own) @ pairs.T
        force = force - pairs @ (own * np.concatenate(turning.demands))
    acting = own_efforts(chain, layout, freedoms, links, q, v)
    resting, rubbing = (), np.zeros(0)
    if acting:
        resting, rubbing, efforts = _with_friction(
            chain, acting, v, a, tree_accelerations(layout, freedoms, a)
        )
        force = force - sum(
            x * own.on_bodies(len(layout.bodies)) for x, own in zip(efforts, acting, strict=True)
        )
    system = ConstraintMatrixSystem(
        I=scipy.sparse.csc_array(inertia),
        C=blocks.matrix(6 * len(layout.bodies)),
        f_p=force,
        c_a=np.concatenate(blocks.demands),
        bodies=tuple(body.name for body in layout.bodies),
        joints=tuple(blocks.names),
        kinds=tuple(blocks.kinds),
        columns=tuple(blocks.slices),
    )
    return AssembledSystem(system, layout, links, joints, freedoms, resting, rubbing)


def tree_accelerations(
    layout: Topology, freedoms: Sequence[Freedoms], a: Tangent, ground: FloatArray | None = None
) -> FloatArray:
    """Accelerate all bodies as the joints of the tree do.

    Parameters
    ----------
    layout
        Bodies and compound joints.
    freedoms
        Freedoms of each compound joint.
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    ground
        (6,) spatial acceleration of the ground; default: none [m/s², rad/s²].

    Returns
    -------
    numpy.ndarray
        (6 n_bodies,) spatial accelerations at the world origin [m/s², rad/s²].
    """
    at = {layout.bodies[0].name: np.zeros(6) if ground is None else ground}
    for compound, freedom in zip(layout.tree, freedoms, strict=True):
        at[compound.successor] = at[compound.predecessor] + freedom.axes @ a[freedom.index] + freedom.bias
    return np.concatenate([at[body.name] for body in layout.bodies])


def _with_friction(
    chain: ClosedChain, acting: Sequence[OwnEffort], v: Tangent, a: Tangent, bodies: FloatArray
) -> tuple[tuple[OwnEffort, ...], FloatArray, FloatArray]:
    """Tell what joints do, dry friction against the motion, or at rest against the acceleration that is demanded."""
    sizes = np.array([own.size for own in acting])
    friction = np.array([own.friction for own in acting])
    rates = np.array([own.rate for own in acting])
    sense = moves(rates, sizes, v, chain)
    still = (sense == 0) & (friction > 0)
    starts = moves(np.array([own.acceleration(bodies) for own in acting]), sizes, a, chain)
    rubbing = -friction * np.where(sense == 0, starts, sense)
    efforts = np.array([own.smooth for own in acting]) + rubbing
    return tuple(own for own, rests in zip(acting, still, strict=True) if rests), rubbing[still], efforts


def loaded_links(chain: ClosedChain, outside: OutsideWrenches | None) -> tuple[str, ...]:
    """List the links without inertia that bear a wrench.

    Parameters
    ----------
    chain
        Closed chain.
    outside
        Wrenches from outside, or None.

    Returns
    -------
    tuple of str
        Their names, in the order of the description.
    """
    if outside is None:
        return ()
    borne = {place.link for place in outside.places}
    return tuple(link.name for link in chain.mechanism.links if link.inertia is None and link.name in borne)


def _rotors(chain: ClosedChain) -> list[tuple[str, int, float]]:
    """List joint, tangent entry and inertia of each rotor, which Pinocchio's models call armature."""
    model = chain.model
    return [
        (name, entry, float(model.armature[entry]))
        for name, joint in zip(model.names[1:], model.joints[1:], strict=True)
        for entry in range(joint.idx_v, joint.idx_v + joint.nv)
        if model.armature[entry]
    ]


class _Blocks:
    """Collects the blocks of C in coordinate form."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.kinds: list[str] = []
        self.slices: list[slice] = []
        self.demands: list[FloatArray] = []
        self._rows: list[np.ndarray] = []
        self._columns: list[np.ndarray] = []
        self._values: list[FloatArray] = []
        self._width = 0

    def add(self, name: str, kind: str, predecessor: int | None, successor: int, columns: Columns) -> None:
        self.add_parts(name, kind, [(predecessor, successor, columns)])

    def add_parts(self, name: str, kind: str, parts: Sequence[tuple[int | None, int, Columns]]) -> None:
        """Add columns that act between several pairs of bodies; their demands add up."""
        n = parts[0][2].acceleration.size
        self.names.append(name)
        self.kinds.append(kind)
        self.slices.append(slice(self._width, self._width + n))
        self.demands.append(np.sum([columns.acceleration for _, _, columns in parts], axis=0))
        for predecessor, successor, columns in parts:
            for body, sign in ((predecessor, -1.0), (successor, 1.0)):
                if body is not None:
                    rows, cols = np.divmod(np.arange(6 * n), n)
                    self._rows.append(6 * body + rows)
                    self._columns.append(self._width + cols)
                    self._values.append(sign * columns.wrenches.ravel())
        self._width += n

    def matrix(self, height: int) -> scipy.sparse.csc_array:
        values = np.concatenate(self._values)
        rows, columns = np.concatenate(self._rows), np.concatenate(self._columns)
        keep = values != 0.0
        return scipy.sparse.csc_array(
            (values[keep], (rows[keep], columns[keep])), shape=(height, self._width)
        )
