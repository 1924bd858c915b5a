"""The maximal-coordinate system: its shape, its columns, its solution, and its independence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import scipy.sparse.linalg

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import ActuationError, SingularityError
from stewart_pin.model.description import LOOP_KINDS, Joint, JointKind, Link, Mechanism
from stewart_pin.state import loop_rows
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.mechanisms import (
    FREE,
    ONE,
    F,
    P,
    R,
    S,
    X,
    Y,
    Z,
    arm,
    at,
    body,
    five_bar,
    four_bar,
    turned,
    two_bodies,
)


def system_of(chain: stp.ClosedChain, q=None, v=None, a=None) -> stp.dynamics.ConstraintMatrixSystem:
    zero = np.zeros(chain.nv)
    pick = (chain.q_home if q is None else q), (zero if v is None else v), (zero if a is None else a)
    return stp.constraint_matrix_system(chain, *pick)


def rank(system: stp.dynamics.ConstraintMatrixSystem) -> int:
    # Between the smallest entry of a rod's inertia, 1e-3 kg m², and round-off of 40 kg there is a wide gap.
    return int(np.linalg.matrix_rank(system.matrix.toarray(), tol=1e-9))


# --- shape: the figures of the source ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "light", "columns", "wanted"),
    [
        ("stewart", False, 84, 168),
        ("stewart", True, 84, 168),
        ("stewart_sps", False, 78, 162),
        ("stewart_sps", True, 78, 156),
    ],
)
def test_shape_and_rank(name: str, light: bool, columns: int, wanted: int, rng: np.random.Generator) -> None:
    """Six spherical lower joints leave six spins: determined by the rods' inertia, if they have any."""
    chain = robot(name)
    q = random_configuration(chain, rng, 0.1)
    if light:
        chain = stp.massless_legs(chain, point_platform=True)
    system = system_of(chain, q)
    assert system.I.shape == (84, 84) and system.C.shape == (84, columns)
    assert system.f_p.shape == (84,) and system.c_a.shape == (columns,)
    assert system.matrix.shape == (84 + columns, 84 + columns)
    assert rank(system) == wanted


def test_bodies_and_joints_in_order() -> None:
    chain = robot("stewart")
    system = system_of(chain)
    legs = range(1, 7)
    assert len(system.bodies) == 14 and len(system.joints) == 25
    assert system.bodies[0] == "base" and set(system.bodies[1:]) == {
        "platform", *(f"leg{i}_{part}" for i in legs for part in ("lower", "upper")),
    }  # fmt: skip
    assert system.joints == (
        "ground",
        *(f"leg{i}_x+leg{i}_y" for i in legs),
        *(f"leg{i}" for i in legs),
        *(f"leg{i}_ball" for i in legs),
        *(f"motor leg{i}" for i in legs),
    )
    widths = [columns.stop - columns.start for columns in system.columns]
    assert widths == [6] + [4] * 6 + [5] * 6 + [3] * 6 + [1] * 6
    assert [w.stop - w.start for w in system_of(robot("stewart_sps")).columns] == [6] + [3] * 6 + [5] * 6 + [
        3
    ] * 6 + [1] * 6


def test_where_the_columns_are_zero() -> None:
    """The pattern of the source's table: each joint acts on its two bodies, with opposite wrenches."""
    chain = robot("stewart")
    system = system_of(chain)
    dense = system.C.toarray()
    number = {name: slice(6 * k, 6 * k + 6) for k, name in enumerate(system.bodies)}
    np.testing.assert_array_equal(dense[number["base"], :6], np.eye(6))
    assert not dense[6:, :6].any()
    ends = {
        "leg2_x+leg2_y": ("base", "leg2_lower"),
        "leg2": ("leg2_lower", "leg2_upper"),
        "leg2_ball": ("platform", "leg2_upper"),
        "motor leg2": ("leg2_lower", "leg2_upper"),
    }
    for joint, (predecessor, successor) in ends.items():
        columns = system.columns[system.joints.index(joint)]
        block = dense[:, columns]
        np.testing.assert_array_equal(block[number[predecessor]], -block[number[successor]])
        assert (np.abs(block[number[successor]]).max(axis=0) > 0.1).all()
        others = [k for name, k in number.items() if name not in (predecessor, successor)]
        assert not any(block[k].any() for k in others)
    # The prismatic joint passes no force along the leg, the motor nothing else.
    points = stp.Hexapod.from_chain(chain)
    pose = stp.platform_pose(chain, chain.q_home)
    leg = pose.act(points.platform_points[1]) - points.base_points[1]
    leg /= np.linalg.norm(leg)
    slider = dense[number["leg2_upper"], system.columns[system.joints.index("leg2")]]
    motor = dense[number["leg2_upper"], system.columns[system.joints.index("motor leg2")]][:, 0]
    assert np.abs(leg @ slider[:3]).max() <= 1e-14
    close(motor, np.concatenate([leg, np.cross(points.base_points[1], leg)]), 1e-13)


def test_system_is_the_equation_of_motion(rng: np.random.Generator) -> None:
    """Solve the printed block system as it stands: accelerations of the bodies, and the efforts last."""
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    system = system_of(chain, q, v, a)
    unknowns = scipy.sparse.linalg.spsolve(system.matrix, system.right_hand_side)
    close(unknowns[-6:], stp.inverse_dynamics(chain, q, v, a).tau_motor, 1e-11)
    close(unknowns[:84], accelerations(chain, system, q, v, a), 1e-11)
    total = sum(link.inertia.mass for link in chain.mechanism.links if link.inertia)
    # What holds the ground carries all the weight at rest.
    rest = system_of(chain)
    ground = scipy.sparse.linalg.spsolve(rest.matrix, rest.right_hand_side)[84:90]
    assert ground[2] == pytest.approx(9.81 * total, rel=1e-12)


# --- columns: against the motion as Pinocchio sees it --------------------------------------------------------


def accelerations(chain, system, q, v, a, order: Callable = pin.getFrameAcceleration) -> np.ndarray:
    """Spatial accelerations (or velocities) of all bodies at the world origin, by Pinocchio."""
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q, v, a)
    frames = [chain.model.getFrameId(name, pin.FrameType.BODY) for name in system.bodies]
    return np.concatenate([order(chain.model, data, f, pin.ReferenceFrame.WORLD).vector for f in frames])


def one_joint(kind: JointKind, rng: np.random.Generator) -> stp.ClosedChain:
    """Two bodies on a driven rail, with one joint of the tree between them."""
    axis = rng.normal(size=3)
    joints = (
        Joint("rail", P, "ground", "cart", turned(rng), Y, independent=True),
        Joint("between", kind, "cart", "bob", turned(rng), axis / np.linalg.norm(axis)),
    )
    links = (Link("ground"), Link("cart", body(rng)), Link("bob", body(rng)))
    return build_chain(Mechanism(str(kind), links, joints, platform="cart"))


MECHANISMS = {
    **{f"tree {k}": (lambda rng, k=k: one_joint(k, rng)) for k in (R, P, S, F, FREE)},
    **{f"loop {k}": (lambda rng, k=k: two_bodies(k, rng)) for k in LOOP_KINDS},
    "four-bar": lambda rng: four_bar(),
    "five-bar": lambda rng: five_bar(),
    "arm": lambda rng: arm(rng, 7),
    "massless hub": lambda rng: hub(rng, None),
    "zero-mass hub": lambda rng: hub(rng, pin.Inertia.Zero()),
    "massless tip": lambda rng: massless_tip(rng),
    "massless finger": lambda rng: massless_finger(rng),
    "welded": lambda rng: welded(rng),
    "cross": lambda rng: cross(rng),
    "ornaments": lambda rng: ornaments(rng),
}


def hub(rng: np.random.Generator, inertia: pin.Inertia | None) -> stp.ClosedChain:
    """Two driven bodies branch from one link without mass."""
    joints = (
        Joint("turn", R, "ground", "hub", turned(rng), X, independent=True),
        Joint("left", P, "hub", "left_body", turned(rng), Y, independent=True),
        Joint("right", R, "hub", "right_body", turned(rng), Z, independent=True),
    )
    links = (
        Link("ground"),
        Link("hub", inertia),
        Link("left_body", body(rng)),
        Link("right_body", body(rng)),
    )
    return build_chain(Mechanism("hub", links, joints, platform="left_body"))


def massless_tip(rng: np.random.Generator) -> stp.ClosedChain:
    """Let the last motor of an arm move a platform without mass, on a bracket without mass."""
    joints = (
        Joint("first", R, "ground", "link", turned(rng), X, independent=True),
        Joint("bracket_fixed", F, "link", "bracket", turned(rng)),
        Joint("second", R, "bracket", "tip", turned(rng), Y, independent=True),
    )
    links = (Link("ground"), Link("link", body(rng)), Link("bracket"), Link("tip"))
    return build_chain(Mechanism("massless_tip", links, joints, platform="tip"))


def massless_finger(rng: np.random.Generator) -> stp.ClosedChain:
    """Let a motor move a link without mass that carries nothing, beside the platform."""
    joints = (
        Joint("first", R, "ground", "hand", turned(rng), X, independent=True),
        Joint("second", P, "hand", "finger", turned(rng), Y, independent=True),
    )
    links = (Link("ground"), Link("hand", body(rng)), Link("finger"))
    return build_chain(Mechanism("massless_finger", links, joints, platform="hand"))


def welded(rng: np.random.Generator) -> stp.ClosedChain:
    """Bodies joined by fixed joints, one of them to the ground, one through a bracket without mass."""
    joints = (
        Joint("post_fixed", F, "ground", "post", turned(rng)),
        Joint("turn", R, "post", "link", turned(rng), X, independent=True),
        Joint("bracket_fixed", F, "link", "bracket", turned(rng)),
        Joint("load_fixed", F, "bracket", "load", turned(rng)),
    )
    links = (
        Link("ground"),
        Link("post", body(rng)),
        Link("link", body(rng)),
        Link("bracket"),
        Link("load", body(rng)),
    )
    return build_chain(Mechanism("welded", links, joints, platform="load"))


def cross(rng: np.random.Generator) -> stp.ClosedChain:
    """Two driven joints in a row through a cross without mass, whose axes neither meet nor stand square."""
    joints = (
        Joint("one", R, "ground", "cross", turned(rng), X, independent=True),
        Joint("two", R, "cross", "link", turned(rng), Y, independent=True),
    )
    links = (Link("ground"), Link("cross"), Link("link", body(rng)))
    return build_chain(Mechanism("cross", links, joints, platform="link"))


def ornaments(rng: np.random.Generator) -> stp.ClosedChain:
    """Frames without mass hang on the arm, one of them on a hinge of its own that nothing drives."""
    joints = (
        Joint("turn", R, "ground", "link", turned(rng), X, independent=True),
        Joint("flag_hinge", R, "link", "flag", turned(rng), Y),
        Joint("mark_fixed", F, "flag", "mark", at(0.1)),
    )
    links = (Link("ground"), Link("link", body(rng)), Link("flag"), Link("mark"))
    return build_chain(Mechanism("ornaments", links, joints, platform="link"))


@pytest.fixture(params=MECHANISMS)
def state(
    request: pytest.FixtureRequest, rng: np.random.Generator
) -> tuple[stp.ClosedChain, np.ndarray, np.ndarray, np.ndarray]:
    """Return each small mechanism in a random closed motion."""
    chain = MECHANISMS[request.param](rng)
    q = random_configuration(chain, rng, 0.3)
    return chain, q, *random_motion(chain, rng, q)


def test_columns_resist_no_allowed_motion(state) -> None:
    """Power of every wrench on any closed motion: nothing, but for the motors their own rate."""
    chain, q, v, a = state
    system = system_of(chain, q, v, a)
    velocity = lambda m, d, f, r: pin.getFrameVelocity(m, d, f, r)  # noqa: E731
    power = system.C.T @ accelerations(chain, system, q, v, a, velocity)
    close(power[-chain.nu :], v[chain.motor_index], 1e-12)
    assert np.abs(power[: -chain.nu]).max() <= 1e-12
    np.testing.assert_allclose(system.C.T @ accelerations(chain, system, q, v, a), system.c_a, atol=1e-11)


def test_both_methods_agree(state) -> None:
    chain, q, v, a = state
    one = stp.inverse_dynamics(chain, q, v, a)
    two = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix")
    np.testing.assert_allclose(two.tau_motor, one.tau_motor, atol=1e-11)
    np.testing.assert_allclose(two.lambda_c, one.lambda_c, atol=1e-11)
    np.testing.assert_allclose(two.a, one.a, atol=1e-11)
    assert (two.unique, two.reactions_unique) == (one.unique, one.reactions_unique)
    assert max(one.residual, two.residual) <= 1e-11


def test_bodies_of_odd_trees(rng: np.random.Generator) -> None:
    wanted = {
        "massless hub": (("ground", "hub", "left_body", "right_body"), ("turn", "left", "right")),
        "zero-mass hub": (("ground", "hub", "left_body", "right_body"), ("turn", "left", "right")),
        "massless tip": (("ground", "link", "tip"), ("first", "bracket_fixed+second")),
        "massless finger": (("ground", "hand", "finger"), ("first", "second")),
        "welded": (("ground", "post", "link", "load"), ("post_fixed", "turn", "bracket_fixed+load_fixed")),
        "cross": (("ground", "link"), ("one+two",)),
        "ornaments": (("ground", "link"), ("turn",)),
    }
    for name, (bodies, joints) in wanted.items():
        system = system_of(MECHANISMS[name](rng))
        assert system.bodies == bodies
        assert tuple(j for j in system.joints if j != "ground" and not j.startswith("motor")) == joints


def test_motors_and_platform_are_those_of_the_chain(rng: np.random.Generator) -> None:
    """A chain may name other motors and another platform than its file does."""
    chain = cross(rng)
    other = build_chain(chain.mechanism, motors=("two", "one"), platform="cross")
    system = system_of(other)
    assert system.bodies == ("ground", "cross", "link")
    assert system.joints == ("ground", "one", "two", "motor two", "motor one")
    rest = np.zeros(2)
    one, two = (
        stp.inverse_dynamics(other, other.q_home, rest, rest, method=m)
        for m in ("pinocchio", "constraint_matrix")
    )
    np.testing.assert_allclose(two.tau_motor, one.tau_motor, atol=1e-12)


def test_gimbal_lock_of_a_driven_cross() -> None:
    """Two motors on one line with nothing between them: which of them pushes is undetermined."""
    joints = (
        Joint("one", R, "ground", "cross", ONE, Z, independent=True),
        Joint("two", R, "cross", "link", ONE, Z, independent=True),
    )
    links = (Link("ground"), Link("cross"), Link("link", body(np.random.default_rng(0))))
    chain = build_chain(Mechanism("lock", links, joints, platform="link"))
    with pytest.raises(SingularityError, match="2 joints in a row without a body between them"):
        system_of(chain)


def test_independence(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    """Neither Pinocchio's algorithms nor the loop Jacobian take part: it works when they are gone."""
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    expected = stp.inverse_dynamics(chain, q, v, a)
    checked = chain.at(q, v, a)
    stp.inverse_dynamics(checked, method="constraint_matrix")  # the state has been checked, its rank is known

    def forbidden(*args, **kwargs):
        raise AssertionError("the constraint matrix is independent of this")

    for name in ("rnea", "crba", "nonLinearEffects", "forwardKinematics", "computeJointJacobians", "aba"):
        monkeypatch.setattr(pin, name, forbidden)
    for name in ("place_loops", "gap_of", "wrenches_of", "jacobian_of", "jacobian_rate_of"):
        monkeypatch.setattr(loop_rows, name, forbidden)
    found = stp.inverse_dynamics(checked, method="constraint_matrix")
    close(found.tau_motor, expected.tau_motor, 1e-11)
    with pytest.raises(AssertionError, match="independent"):
        stp.inverse_dynamics(chain, q, v, a)


def test_gravity_and_mass_enter_linearly(rng: np.random.Generator) -> None:
    """Twice the masses need twice the efforts."""
    chain = four_bar()
    heavy = {
        link.name: pin.Inertia(2 * link.inertia.mass, link.inertia.lever, 2 * link.inertia.inertia)
        for link in chain.mechanism.links
        if link.inertia
    }
    q = random_configuration(chain, rng, 0.2)
    v, a = random_motion(chain, rng, q)
    double = stp.build.replace_inertias(replace(chain), heavy)
    for method in ("pinocchio", "constraint_matrix"):
        one = stp.inverse_dynamics(chain, q, v, a, method=method).tau_motor
        close(stp.inverse_dynamics(double, q, v, a, method=method).tau_motor, 2 * one, 1e-12)


def test_missing_motors_leave_a_singular_value_of_zero() -> None:
    chain = stp.with_motors(stp.load("stewart"), ["leg1"])
    rest = np.zeros(chain.nv)
    with pytest.raises(ActuationError, match=r"smallest singular value 0\)") as caught:
        stp.inverse_dynamics(chain, chain.q_home, rest, rest, method="constraint_matrix")
    assert caught.value.smallest_singular_value == 0.0
