"""Gap, Jacobian and bias of every kind of loop, by differences, and against Pinocchio's own constraints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ClosureError, InputError, SingularityError
from stewart_pin.model.description import LOOP_KINDS, JointKind
from stewart_pin.model.loop_rows import orthonormal_triad
from tests.closed_states import along, close, derivative, random_configuration, random_motion
from tests.mechanisms import two_bodies

ROWS = {
    "fixed": 6,
    "revolute": 5,
    "prismatic": 5,
    "spherical": 3,
    "universal": 4,
    "cylindrical": 4,
    "planar": 3,
    "point_on_line": 2,
    "distance": 1,
    "cable": 1,
}


@pytest.fixture(params=LOOP_KINDS)
def chain(request: pytest.FixtureRequest, rng: np.random.Generator) -> stp.ClosedChain:
    """Return two bodies held together by each kind of loop, its frames and axes in general position."""
    return two_bodies(request.param, rng)


@pytest.fixture(params=["closed", "open"])
def q(request: pytest.FixtureRequest, chain: stp.ClosedChain, rng: np.random.Generator) -> np.ndarray:
    """Return a closed configuration and one with every joint moved at random."""
    if request.param == "closed":
        return random_configuration(chain, rng, 0.5)
    return pin.integrate(chain.model, chain.q_home, rng.normal(size=chain.nv))


def test_number_of_rows(chain: stp.ClosedChain) -> None:
    assert chain.nc == ROWS[chain.name]
    # A generic loop takes away as many freedoms as it has rows.
    assert stp.mobility(chain).dof == chain.nv - chain.nc


def test_gap_vanishes_where_the_loop_closes(chain: stp.ClosedChain) -> None:
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() <= 1e-13


# Differences of order 4 at h = 1e-3 with rates near one: 1e-11; entries are of size one.
def test_jacobian_is_the_derivative_of_the_gap(chain: stp.ClosedChain, q: np.ndarray) -> None:
    jacobian = stp.loop_jacobian(chain, q)
    for k, direction in enumerate(np.eye(chain.nv)):
        slope = derivative(lambda t, d=direction: stp.loop_gap(chain, along(chain, q, d)(t)))
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-10)


def test_bias_is_the_rate_of_the_jacobian(
    chain: stp.ClosedChain, q: np.ndarray, rng: np.random.Generator
) -> None:
    v = rng.normal(size=chain.nv)
    slope = derivative(lambda t: stp.loop_jacobian(chain, along(chain, q, v)(t)) @ v)
    close(stp.loop_bias(chain, q, v), slope, 1e-9)


def test_bias_is_the_second_derivative_of_the_gap(
    chain: stp.ClosedChain, q: np.ndarray, rng: np.random.Generator
) -> None:
    v, h = rng.normal(size=chain.nv), 1e-3
    curve = along(chain, q, v)
    second = (
        stp.loop_gap(chain, curve(h)) - 2 * stp.loop_gap(chain, q) + stp.loop_gap(chain, curve(-h))
    ) / h**2
    # h²/12 times the fourth derivative, about 1e2 here.
    np.testing.assert_allclose(stp.loop_bias(chain, q, v), second, rtol=1e-4, atol=1e-4)


def test_gap_of_a_motion_stays_closed(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    """Of a closed motion, position, velocity and acceleration level are consistent: the gap opens with t³ only."""
    q = random_configuration(chain, rng, 0.3)
    curve = along(chain, q, *random_motion(chain, rng, q))
    gaps = [np.abs(stp.loop_gap(chain, curve(t))).max() for t in (1e-2, 5e-3)]
    assert gaps[1] < gaps[0] / 7 or gaps[0] < 1e-9


@pytest.mark.parametrize("kind", [JointKind.SPHERICAL, JointKind.FIXED])
def test_jacobian_is_minus_that_of_the_rigid_constraint_model(
    kind: JointKind, rng: np.random.Generator
) -> None:
    """Trap: the two families of Pinocchio's constraints have opposite signs, and need `calc` (here `computeData`)."""
    chain = two_bodies(kind, rng)
    q = random_configuration(chain, rng, 0.3)
    models = stp.loops.constraint_models(chain)
    data = pin.Data(chain.model)
    datas = pin.StdVec_RigidConstraintData()
    datas.append(models[0].createData())
    pin.computeJointJacobians(chain.model, data, q)
    models[0].calc(chain.model, data, datas[0])
    theirs = pin.getConstraintsJacobian(chain.model, data, models, datas)
    ours = stp.loop_jacobian(chain, q)
    np.testing.assert_allclose(ours[:3], -theirs[:3], atol=1e-13)
    # Rows 4 to 6 turn about the loop's axes a, b, c; Pinocchio's about x, y, z.
    axes = np.cross(chain.loop_table.angle.vector2, chain.loop_table.angle.vector1)
    if kind is JointKind.FIXED:
        np.testing.assert_allclose(ours[3:], -axes @ theirs[3:], atol=1e-13)


def test_jacobian_is_that_of_the_point_anchor_closed_or_open(rng: np.random.Generator) -> None:
    chain = two_bodies(JointKind.SPHERICAL, rng)
    loop = chain.loop_table
    ends = [
        pin.SE3(r[0], t[0])
        for r, t in ((loop.rotation1, loop.translation1), (loop.rotation2, loop.translation2))
    ]
    anchor = pin.PointAnchorConstraintModel(chain.model, loop.joint1[0], ends[0], loop.joint2[0], ends[1])
    for q in (chain.q_home, pin.integrate(chain.model, chain.q_home, rng.normal(size=chain.nv))):
        data, scratch = pin.Data(chain.model), anchor.createData()
        pin.computeJointJacobians(chain.model, data, q)
        anchor.calc(chain.model, data, scratch)
        np.testing.assert_allclose(
            stp.loop_jacobian(chain, q), anchor.jacobian(chain.model, data, scratch), atol=1e-13
        )


def test_jacobian_needs_no_scratch_of_an_earlier_call(rng: np.random.Generator) -> None:
    """Trap: Pinocchio's constraint Jacobians silently use what `calc` left at another configuration."""
    chain = two_bodies(JointKind.SPHERICAL, rng)
    q, elsewhere = (random_configuration(chain, rng, 0.5) for _ in range(2))
    before = stp.loop_jacobian(chain, q)
    stp.loop_jacobian(chain, elsewhere)
    np.testing.assert_array_equal(stp.loop_jacobian(chain, q), before)


def test_ends_of_a_rod_that_coincide(rng: np.random.Generator) -> None:
    """The distance has a kink there: no NaN, a way out for Newton's method, and no bias."""
    chain = two_bodies(JointKind.DISTANCE, rng)
    one = pin.SE3.Identity()
    loop = replace(chain.loops[0], link1="ground", placement1=one, placement2=one)
    chain = replace(chain, mechanism=replace(chain.mechanism, loops=(loop,)))
    q = pin.neutral(chain.model)
    np.testing.assert_array_equal(stp.loop_gap(chain, q), [-loop.length])
    assert np.isfinite(stp.loop_jacobian(chain, q)).all()
    assert stp.close_loops(chain, q).success
    with pytest.raises(SingularityError, match="ends of the distance loop 'loop' coincide"):
        stp.loop_bias(chain, q, np.ones(chain.nv))
    with pytest.raises(SingularityError, match="ends of the distance loop 'loop' coincide"):
        stp.loops.loop_jacobian_rate(chain, q, np.ones(chain.nv), np.eye(chain.nv))


@pytest.mark.parametrize(
    "kind",
    [JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.PLANAR, JointKind.PRISMATIC, JointKind.FIXED],
)
def test_axes_against_each_other_are_not_closed(kind: JointKind, rng: np.random.Generator) -> None:
    """Half a turn about an axis across the loop's own leaves every row at zero: no assembly, and no success."""
    chain = two_bodies(kind, rng)
    loop = chain.loops[0]
    turn = pin.SE3(pin.exp3(np.pi * orthonormal_triad(loop.axis)[1]), np.zeros(3))
    joint = chain.model.joints[chain.model.getJointId("float")]
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, chain.q_home)
    free = data.oMf[chain.model.getFrameId("free")] * loop.placement2 * turn * loop.placement2.inverse()
    q = chain.q_home.copy()
    q[joint.idx_q : joint.idx_q + 7] = pin.SE3ToXYZQUAT(free)
    assert np.abs(stp.loop_gap(chain, q)).max() <= 1e-12
    closure = stp.close_loops(chain, q, throw=False)
    assert not closure.success and "loop 'loop'" in closure.reason
    with pytest.raises(ClosureError, match="loop 'loop' closes only with its axes against each other"):
        stp.close_loops(chain, q)
    rest = np.zeros(chain.nv)
    with pytest.raises(InputError, match="axes against each other"):
        stp.inverse_dynamics(chain, q, rest, rest)


@pytest.mark.parametrize("verb", [stp.loop_gap, stp.loop_jacobian])
def test_bad_configurations(verb, rng: np.random.Generator) -> None:
    chain = two_bodies(JointKind.SPHERICAL, rng)
    with pytest.raises(InputError, match=r"q must have shape \(12,\), got \(3,\)"):
        verb(chain, np.zeros(3))
    with pytest.raises(InputError, match="q must be finite"):
        verb(chain, np.full(chain.nq, np.nan))
    with pytest.raises(InputError, match="q holds a quaternion that is not of unit length"):
        verb(chain, 2 * chain.q_home)
    with pytest.raises(InputError, match="v must have shape"):
        stp.loop_bias(chain, chain.q_home, np.zeros(3))
