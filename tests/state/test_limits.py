"""What limits know of joints that have no coordinate: those that close loops, and balls."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain, open_chain
from stewart_pin.model.description import Bounds, Joint, JointKind, Link, Loop, Mechanism, loop_coordinates
from stewart_pin.model.tree import KINDS
from tests.closed_states import robot

HERE = pin.SE3.Identity()
WIDE = Bounds(position=(-100.0, 100.0), velocity=(-100.0, 100.0), acceleration=(-100.0, 100.0))
BODY = pin.Inertia(1.0, np.zeros(3), np.eye(3))
COORDINATES = {
    JointKind.REVOLUTE: [0.7],
    JointKind.PRISMATIC: [-0.4],
    JointKind.POINT_ON_LINE: [0.3],
    JointKind.CYLINDRICAL: [0.2, -1.1],
    JointKind.UNIVERSAL: [0.6, -0.8],
    JointKind.PLANAR: [0.2, -0.3, 2.5],
}


def placed(kind: JointKind, values: list[float], axis: np.ndarray, axis2: np.ndarray) -> pin.SE3:
    """Frame 2 in frame 1, written down without the package."""

    def turn(direction: np.ndarray, angle: float) -> np.ndarray:
        return pin.AngleAxis(angle, direction).toRotationMatrix()

    across = np.cross(axis, axis2)
    match kind:
        case JointKind.REVOLUTE:
            return pin.SE3(turn(axis, values[0]), np.zeros(3))
        case JointKind.PRISMATIC | JointKind.POINT_ON_LINE:
            return pin.SE3(np.eye(3), values[0] * axis)
        case JointKind.CYLINDRICAL:
            return pin.SE3(turn(axis, values[1]), values[0] * axis)
        case JointKind.UNIVERSAL:
            return pin.SE3(turn(axis, values[0]) @ turn(axis2, values[1]), np.zeros(3))
        case _:
            return pin.SE3(turn(axis, values[2]), values[0] * axis2 + values[1] * across)


def floating(kind: JointKind, rng: np.random.Generator, bounds: Bounds = WIDE) -> stp.ClosedChain:
    """Hold a free body by a loop of a kind, its frames in general position."""
    places = [pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2)]
    axis, axis2, _ = pin.exp3(rng.normal(size=3)).T
    loop = Loop(
        "tie", kind, "ground", "body", *places, axis, axis2, bounds=(bounds,) * len(loop_coordinates(kind))
    )
    mechanism = Mechanism(
        "held",
        (Link("ground"), Link("body", BODY), Link("arm", BODY)),
        (
            Joint("free", JointKind.FLOATING, "ground", "body", HERE),
            Joint("motor", JointKind.REVOLUTE, "ground", "arm", HERE, independent=True),
        ),
        (loop,),
        platform="body",
    )
    return build_chain(mechanism)


def at(chain: stp.ClosedChain, relative: pin.SE3) -> np.ndarray:
    loop = chain.loops[0]
    pose = loop.placement1 * relative * loop.placement2.inverse()
    q = np.array(chain.q_home)
    index = chain.model.joints[chain.model.getJointId("free")].idx_q
    q[index : index + 7] = pin.SE3ToXYZQUAT(pose)
    return q


def read(chain: stp.ClosedChain, *motion: np.ndarray, kind: str = "position") -> np.ndarray:
    asked = chain.judge.asked(*(part[None] for part in motion))
    return next(each.values[0] for each in asked if each.kind == kind)


@pytest.mark.parametrize("kind", COORDINATES, ids=str)
def test_coordinates_of_loops_are_those_of_the_joint(kind: JointKind, rng: np.random.Generator) -> None:
    chain = floating(kind, rng)
    loop, values = chain.loops[0], COORDINATES[kind]
    q = at(chain, placed(kind, values, loop.axis, loop.axis2))
    found = read(chain, q)
    if kind is JointKind.PLANAR:  # which directions of the plane are x and y is a convention
        assert np.hypot(*found[:2]) == pytest.approx(np.hypot(*values[:2]))
        found, values = found[2:], values[2:]
    # Frames in general position cost a few units of round-off.
    np.testing.assert_allclose(found, values, atol=1e-13)


def test_swing_and_angle_of_a_ball(rng: np.random.Generator) -> None:
    chain = floating(JointKind.SPHERICAL, rng)
    axis = chain.loops[0].axis
    across = np.cross(axis, [0.6, 0.0, 0.8])
    across /= np.linalg.norm(across)
    swung = pin.AngleAxis(0.5, across).toRotationMatrix() @ pin.AngleAxis(1.3, axis).toRotationMatrix()
    swing, angle = read(chain, at(chain, pin.SE3(swung, np.zeros(3))))
    assert swing == pytest.approx(0.5, abs=1e-13)
    # The whole angle of two turns about axes at right angles: cos(a/2) cos(b/2), by quaternions.
    assert angle == pytest.approx(2 * np.arccos(np.cos(0.25) * np.cos(0.65)), abs=1e-13)


def test_rates_of_loops_are_those_of_the_joint(rng: np.random.Generator) -> None:
    """A hinge that turns by 0.7 + 2 t + 1.5 t², its body led along by pure rotation about the hinge."""
    chain = floating(JointKind.REVOLUTE, rng)
    loop = chain.loops[0]

    def pose(t: float) -> np.ndarray:
        return at(chain, placed(JointKind.REVOLUTE, [0.7 + 2 * t + 1.5 * t * t], loop.axis, loop.axis2))

    # Body velocity of a hinge is constant but for its rate: its twist per radian, taken by a difference.
    twist = pin.difference(chain.model, pose(0.0), pose(1e-7)) / (2e-7 + 1.5e-14)
    q, v, a = pose(0.0), 2.0 * twist, 3.0 * twist
    # The twist is known to 1e-8 only, as a difference.
    assert read(chain, q, v, a, kind="velocity")[0] == pytest.approx(2.0, rel=1e-7)
    assert read(chain, q, v, a, kind="acceleration")[0] == pytest.approx(3.0, rel=1e-6)


def on_balls(rng: np.random.Generator) -> stp.ClosedChain:
    """Tell of an arm of two balls and a slide, and loops of every kind that has coordinates, all of them open."""

    def place() -> pin.SE3:
        return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))

    def bound(kind: JointKind) -> tuple[Bounds, ...]:
        return (WIDE,) * len(loop_coordinates(kind))

    joints = tuple(
        Joint(f"to_{link}", kind, parent, link, place(), pin.exp3(rng.normal(size=3))[0], swing=3.0, turn=3.0)
        for parent, link, kind in (
            ("ground", "arm", JointKind.SPHERICAL),
            ("arm", "slide", JointKind.PRISMATIC),
            ("slide", "hand", JointKind.SPHERICAL),
        )
    )
    loops = []
    for kind in (*COORDINATES, JointKind.SPHERICAL):
        axis, axis2, _ = pin.exp3(rng.normal(size=3)).T
        ends = (("ground", "hand"), ("arm", "hand"), ("hand", "arm"))[len(loops) % 3]
        loops.append(Loop(f"by_{kind}", kind, *ends, place(), place(), axis, axis2, bounds=bound(kind)))
    links = (Link("ground"), *(Link(joint.child, BODY) for joint in joints))
    mechanism = Mechanism("on_balls", links, joints, tuple(loops))
    return open_chain(mechanism)


def test_rates_of_coordinates_are_their_differences(rng: np.random.Generator) -> None:
    """Along every tangent direction, the loops open, hinges and balls anywhere."""
    chain = on_balls(rng)
    rows = chain.limits.stated("position")
    # Swing and angle of three balls, ten coordinates of the other loops.
    assert rows.size == 2 * 3 + 10
    for _ in range(5):
        q = pin.integrate(chain.model, pin.neutral(chain.model), rng.uniform(-2, 2, chain.nv))
        rates = chain.judge.rates(q, np.eye(chain.nv), rows)
        for k, direction in enumerate(np.eye(chain.nv)):
            after, before = (read(chain, pin.integrate(chain.model, q, h * direction)) for h in (1e-5, -1e-5))
            # Rounding 1e-16 over the step, and its square times curvature: a swing of 0.1 rad has third derivatives
            # of a hundred.
            np.testing.assert_allclose(rates[:, k], (after - before) / 2e-5, atol=2e-8)


def test_rates_of_accelerating_motions_are_their_differences(rng: np.random.Generator) -> None:
    chain = on_balls(rng)
    q = pin.integrate(chain.model, pin.neutral(chain.model), rng.uniform(-2, 2, chain.nv))
    v, a, h = rng.normal(size=chain.nv), rng.normal(size=chain.nv), 1e-4
    moved = [(pin.integrate(chain.model, q, t * v + t * t / 2 * a), v + t * a) for t in (-h, h)]
    before, after = (read(chain, *motion, kind="velocity") for motion in moved)
    np.testing.assert_allclose(
        read(chain, q, v, a, kind="acceleration"), (after - before) / (2 * h), atol=1e-5
    )


@pytest.mark.parametrize("kind", [JointKind.SPHERICAL, JointKind.REVOLUTE])
def test_where_a_coordinate_has_a_kink_its_rate_is_none(kind: JointKind, rng: np.random.Generator) -> None:
    """A ball at its middle swings and turns by none, whichever way it goes; a hinge there moves as ever."""
    chain = floating(kind, rng)
    q = at(chain, HERE)
    rows = np.flatnonzero(np.char.startswith(chain.limits.names, "tie"))
    rates = chain.judge.rates(q, np.eye(chain.nv), rows)
    assert np.isfinite(rates).all()
    assert np.linalg.norm(rates) == pytest.approx(1.0 if kind is JointKind.REVOLUTE else 0.0)


def test_angles_are_counted_by_the_turn_that_suits_the_range(rng: np.random.Generator) -> None:
    chain = floating(JointKind.REVOLUTE, rng, Bounds(position=(3.0, 5.0)))
    loop = chain.loops[0]
    for angle, inside in ((4.0, True), (4.0 - 2 * np.pi, True), (2.5, False), (5.5 - 2 * np.pi, False)):
        q = at(chain, placed(JointKind.REVOLUTE, [angle], loop.axis, loop.axis2))
        assert bool(chain.judge.positions(q)) is not inside


def test_what_is_not_stated_is_a_value_of_its_own() -> None:
    chain = robot("stewart")
    limits = chain.limits
    motors = limits.of("effort")[chain.motor_index]
    np.testing.assert_array_equal(motors, np.tile([-1e4, 1e4], (6, 1)))
    assert np.isnan(limits.effort[chain.passive_index]).all()
    assert np.isnan(limits.acceleration).all()
    assert np.isinf(limits.bounds("acceleration")).all()
    assert limits.stated("velocity").tolist() == sorted(chain.motor_index)
    for kind in KINDS:
        assert limits.of(kind).shape == (len(limits), 2) == (len(limits.names), 2)
    assert limits.names[: chain.nv] == chain.tangent_names


def test_a_number_that_is_none_keeps_no_limit() -> None:
    chain = robot("stewart")
    q = np.array(chain.q_home)
    q[chain.motor_q_index[2]] = np.nan
    (excess,) = chain.judge.positions(q)
    assert excess.joint == "leg3"
