"""Velocity and wrench polytopes against linear programmes over all joints, which know nothing of corners."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError, UnreachableError, UnsupportedError
from stewart_pin.mechanics.capability.enumeration import image_of_limits
from stewart_pin.mechanics.capability.limits import binding_limits
from tests.closed_states import random_configuration

_spec = importlib.util.spec_from_file_location("small_robots", Path(__file__).with_name("small_robots.py"))
assert _spec is not None and _spec.loader is not None
small = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(small)

BUILD: dict[str, Callable[[Path], stp.ClosedChain]] = {
    "six legs": lambda _: stp.load("stewart_cad"),
    "idle spins": lambda _: stp.load("stewart_sps"),
    "planar": lambda folder: small.planar_platform(folder, 3),
    "redundant motors": lambda folder: small.planar_platform(folder, 4),
    "redundant arm": lambda folder: small.arm(folder, "zyzyzyz"),
    "short arm": lambda folder: small.arm(folder, "zyy"),
}


@pytest.fixture(params=list(BUILD))
def chain(request: pytest.FixtureRequest, tmp_path: Path) -> stp.ClosedChain:
    return BUILD[request.param](tmp_path)


@pytest.fixture
def cad() -> stp.ClosedChain:
    return stp.load("stewart_cad")


def generic(chain: stp.ClosedChain, rng: np.random.Generator) -> np.ndarray:
    """Give a configuration without symmetry, within the ranges."""
    q = pin.integrate(chain.model, chain.q_home, 0.02 * rng.standard_normal(chain.nv) * chain.tangent_scale)
    return stp.close_loops(chain, q).q


def platform_jacobian(chain: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
    frame = chain.model.getFrameId(chain.platform)
    return pin.computeFrameJacobian(chain.model, chain.model.createData(), q, frame, pin.LOCAL_WORLD_ALIGNED)


def block_programme(cost, equal, right, low, high) -> np.ndarray:
    """Maximise each row of `cost` over {x: equal x = right, low <= x <= high}: one programme of 50 blocks at a time."""
    best = []
    for part in np.array_split(cost, max(1, len(cost) // 100)):
        blocks = len(part)
        answer = linprog(
            -part.ravel(), A_eq=sp.block_diag([sp.csr_matrix(equal)] * blocks), b_eq=np.tile(right, blocks),
            bounds=np.tile(np.c_[low, high], (blocks, 1)),
        )  # fmt: skip
        assert answer.status == 0, answer.message
        best.append(np.einsum("bi,bi->b", part, answer.x.reshape(blocks, -1)))
    return np.concatenate(best)


def test_velocities_equal_a_programme_over_all_joint_rates(chain: stp.ClosedChain, rng) -> None:
    q = generic(chain, rng)
    polytope = stp.polytopes.velocity_polytope(chain, q)
    coordinates = np.linalg.pinv(polytope.basis)
    directions = rng.standard_normal((1000, len(polytope.names))) * polytope.scale
    rate = np.full(chain.nv, np.inf)
    rate[chain.motor_index] = chain.model.upperVelocityLimit[chain.motor_index]
    expected = block_programme(
        directions @ coordinates @ platform_jacobian(chain, q),
        stp.loop_jacobian(chain, q), np.zeros(chain.nc), -rate, rate,
    )  # fmt: skip
    found = np.array([stp.polytopes.polytope_support(polytope, d) for d in directions])
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("gravity", [False, True])
def test_wrenches_equal_a_programme_over_all_efforts_and_reactions(chain, gravity: bool, rng) -> None:
    q = generic(chain, rng)
    polytope = stp.polytopes.wrench_polytope(chain, q, gravity=gravity)
    directions = rng.standard_normal((500 if gravity else 1000, len(polytope.names))) / np.abs(
        polytope.vertices
    ).max(axis=0)
    most = chain.model.upperEffortLimit[chain.motor_index]
    weight = (
        pin.computeGeneralizedGravity(chain.model, chain.model.createData(), q)
        if gravity
        else np.zeros(chain.nv)
    )
    # Unknowns: wrench coordinates x, efforts as shares of their limits, reactions; S τ + J_cᵀ λ - Pᵀ w = g.
    motors = np.eye(chain.nv)[:, chain.motor_index] * most
    scale = most.max()
    equal = np.hstack(
        [
            -platform_jacobian(chain, q).T @ polytope.basis / scale,
            motors / scale,
            stp.loop_jacobian(chain, q).T,
        ]
    )
    free = np.full(chain.nc, np.inf)
    far = np.full(len(polytope.names), np.inf)
    bound = np.concatenate([far, np.ones(chain.nu), free])
    cost = np.hstack([directions, np.zeros((len(directions), chain.nu + chain.nc))])
    expected = block_programme(cost, equal, weight / scale, -bound, bound)
    found = np.array([stp.polytopes.polytope_support(polytope, d) for d in directions])
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


def test_faces_and_corners_describe_the_same_set(chain: stp.ClosedChain, rng) -> None:
    q = generic(chain, rng)
    for polytope in (
        stp.polytopes.velocity_polytope(chain, q),
        stp.polytopes.wrench_polytope(chain, q, gravity=True),
    ):
        over = (polytope.vertices @ polytope.normals.T - polytope.offsets) / np.abs(polytope.offsets).max()
        d = len(polytope.names)
        assert over.max() < 1e-12
        # Each corner lies on d faces at least, each face holds d corners at least.
        assert ((np.abs(over) < 1e-9).sum(axis=1) >= d).all() and (
            (np.abs(over) < 1e-9).sum(axis=0) >= d
        ).all()
        # Rays leave through the faces where the hull of the corners ends.
        for direction in rng.standard_normal((20, d)) / polytope.scale:
            end = stp.polytopes.polytope_reach(polytope, direction) * direction
            weights = linprog(
                np.zeros(len(polytope.vertices)),
                A_eq=np.vstack([(polytope.vertices * polytope.scale).T, np.ones(len(polytope.vertices))]),
                b_eq=np.append((1 - 1e-9) * end * polytope.scale, 1.0), bounds=(0, None),
            )  # fmt: skip
            assert weights.status == 0
            assert not stp.polytopes.polytope_contains(polytope, 1.001 * end)
        np.testing.assert_allclose(np.linalg.norm(polytope.normals / polytope.scale, axis=1), 1.0, atol=1e-12)


def test_zonotope_has_the_faces_that_counting_gives(tmp_path: Path) -> None:
    # Seven rates in six dimensions in general position: 2 C(7, 5) faces and 2 Σ C(6, i), i < 6, corners.
    arm = small.arm(tmp_path, "zyzyzyz")
    polytope = stp.polytopes.velocity_polytope(arm, arm.q_home)
    assert polytope.normals.shape == (42, 6) and polytope.vertices.shape == (126, 6)


def test_six_legs_equal_the_closed_form(cad: stp.ClosedChain, rng) -> None:
    hexapod = stp.Hexapod.from_chain(cad)
    q = generic(cad, rng)
    pose = stp.platform_pose(cad, q)
    jacobian = stp.leg_jacobian(hexapod, pose.translation, pose.rotation)
    velocity = stp.polytopes.velocity_polytope(cad, q, rate_limit=0.5)
    wrench = stp.polytopes.wrench_polytope(cad, q, effort_limit=1e4)
    choices = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1)
    for polytope, corners in (
        (velocity, np.linalg.solve(jacobian, 0.5 * choices)),
        (wrench, jacobian.T @ (1e4 * choices)),
    ):
        found = polytope.vertices[np.lexsort(np.round(polytope.vertices, 6).T)]
        expected = corners.T[np.lexsort(np.round(corners, 6))]
        np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())
    # A face is a leg at its limit.
    leg3 = velocity.limits.index("leg3 at +0.5")
    np.testing.assert_allclose(
        velocity.normals[leg3] / velocity.offsets[leg3], jacobian[2] / 0.5, rtol=0, atol=1e-11
    )
    assert stp.polytopes.polytope_support(
        stp.polytopes.polytope_section(velocity), [0, 1, 0]
    ) == pytest.approx(
        stp.velocity_limits(hexapod, pose.translation, pose.rotation, rate_limit=0.5)[1], rel=1e-12
    )
    assert stp.polytopes.polytope_reach(wrench, [0, 0, 1, 0, 0, 0]) == pytest.approx(
        stp.load_limit(hexapod, pose.translation, pose.rotation, force_limit=1e4), rel=1e-12
    )


def test_weight_shifts_the_wrenches_by_what_holds_it(cad: stp.ClosedChain) -> None:
    q = cad.q_home
    free, loaded = (stp.polytopes.wrench_polytope(cad, q, gravity=g) for g in (False, True))
    holding = stp.inverse_dynamics(cad, q, np.zeros(cad.nv), np.zeros(cad.nv)).tau_motor
    shift = stp.motor_jacobian(cad, q).T @ holding
    moved = free.vertices - shift
    assert all(np.abs(loaded.vertices - corner).max(axis=1).min() < 1e-8 for corner in moved)
    # What can still be lifted is less than without weight, by about the weight of the platform and half the legs.
    up = [0, 0, 1, 0, 0, 0]
    assert 2000 < stp.polytopes.polytope_reach(free, up) - stp.polytopes.polytope_reach(loaded, up) < 4000


def test_too_weak_motors_leave_nothing(cad: stp.ClosedChain) -> None:
    weak = stp.polytopes.wrench_polytope(cad, cad.q_home, effort_limit=100.0, gravity=True)
    assert stp.polytopes.inscribed_ball(weak).radius < 0
    with pytest.raises(InputError, match="cannot hold the robot"):
        stp.polytopes.polytope_reach(weak, [0, 0, 1, 0, 0, 0])


def test_ball_touches_the_nearest_face(chain: stp.ClosedChain, rng) -> None:
    polytope = stp.polytopes.velocity_polytope(chain, generic(chain, rng))
    ball = stp.polytopes.inscribed_ball(polytope)
    assert np.linalg.norm(ball.direction * polytope.scale) == pytest.approx(ball.radius)
    assert stp.polytopes.polytope_reach(polytope, ball.direction) == pytest.approx(1.0)
    directions = rng.standard_normal((500, len(polytope.names)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True) * polytope.scale
    assert min(stp.polytopes.polytope_reach(polytope, d) for d in directions) >= ball.radius


def test_section_and_shadow_in_three_dimensions(chain: stp.ClosedChain, rng) -> None:
    polytope = stp.polytopes.velocity_polytope(chain, generic(chain, rng))
    section, shadow = stp.polytopes.polytope_section(polytope), stp.polytopes.polytope_projection(polytope)
    d = len(polytope.names)
    fill = np.eye(d)[:, :3]
    for direction in rng.standard_normal((50, 3)):
        inside = stp.polytopes.polytope_reach(section, direction)
        assert inside == pytest.approx(stp.polytopes.polytope_reach(polytope, fill @ direction), rel=1e-9)
        assert stp.polytopes.polytope_support(shadow, direction) == pytest.approx(
            stp.polytopes.polytope_support(polytope, fill @ direction), rel=1e-9
        )
        # Programme over the faces for the corners of the section.
        best = linprog(-direction, A_ub=polytope.normals[:, :3], b_ub=polytope.offsets, bounds=(None, None))
        assert stp.polytopes.polytope_support(section, direction) == pytest.approx(-best.fun, rel=1e-9)
    assert section.names == polytope.names[:3]


def test_leg_at_the_end_of_its_stroke_cannot_go_on(cad: stp.ClosedChain, rng) -> None:
    # Straight up until the first legs are fully out.
    hexapod = stp.Hexapod.from_chain(cad)
    low, high = 2.4, 2.9
    for _ in range(100):
        middle = (low + high) / 2
        longest = stp.leg_lengths(hexapod, [0, 0, middle], np.eye(3)).max()
        low, high = (middle, high) if longest <= 2.70147 else (low, middle)
    q = stp.inverse_kinematics(cad, pin.SE3(np.eye(3), np.array([0, 0, low]))).q
    stopped = np.flatnonzero(stp.motor_positions(cad, q) > 2.70147 - 1e-9)
    assert 0 < len(stopped) < 6
    polytope = stp.polytopes.velocity_polytope(cad, q)
    rates = polytope.vertices @ stp.motor_jacobian(cad, q).T
    assert rates[:, stopped].max() < 1e-12 and np.delete(rates, stopped, axis=1).max() == pytest.approx(0.5)
    assert stp.polytopes.polytope_reach(polytope, [0, 0, 1, 0, 0, 0]) == 0.0
    assert stp.polytopes.inscribed_ball(polytope).radius == 0.0
    assert stp.polytopes.inscribed_ball(polytope).limit == f"leg{stopped[0] + 1} at +0"
    free = stp.polytopes.velocity_polytope(cad, q, limits=False)
    assert stp.polytopes.polytope_reach(free, [0, 0, 1, 0, 0, 0]) > 0.5
    # The section without turning: a programme over the faces.
    section = stp.polytopes.polytope_section(polytope)
    for direction in rng.standard_normal((30, 3)):
        best = linprog(-direction, A_ub=polytope.normals[:, :3], b_ub=polytope.offsets, bounds=(None, None))
        assert stp.polytopes.polytope_support(section, direction) == pytest.approx(
            -best.fun, rel=1e-9, abs=1e-12
        )


def test_stated_rates_of_passive_joints_count(tmp_path: Path, rng) -> None:
    # The cross of leg 2 may turn at 0.05 rad/s at most.
    file = Path(stp.load("stewart_cad").mechanism.source)
    head, tail = file.read_text().split('<joint name="leg2_x"', maxsplit=1)
    slow = tmp_path / "slow.urdf"
    slow.write_text(head + '<joint name="leg2_x"' + tail.replace('velocity="1e30"', 'velocity="0.05"', 1))
    chain = stp.load(slow)
    q = generic(chain, rng)
    polytope = stp.polytopes.velocity_polytope(chain, q)
    assert {"leg2_x at +0.05", "leg2_x at -0.05"} <= set(polytope.limits)
    rate = np.array(chain.model.upperVelocityLimit)
    directions = rng.standard_normal((200, 6)) * polytope.scale
    expected = block_programme(
        directions @ platform_jacobian(chain, q), stp.loop_jacobian(chain, q), np.zeros(chain.nc),
        -np.where(rate < 1e20, rate, np.inf), np.where(rate < 1e20, rate, np.inf),
    )  # fmt: skip
    found = np.array([stp.polytopes.polytope_support(polytope, d) for d in directions])
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


def test_flat_sets_have_their_corners(cad: stp.ClosedChain) -> None:
    # Legs at both ends of the stroke at once: what remains without turning is flat or a point.
    from stewart_pin.mechanics.capability.enumeration import cut, hull

    square = cut(np.vstack([np.eye(3), -np.eye(3)]), np.array([1.0, 2, 0, 1, 2, 0]), ("",) * 6)
    assert square is not None
    np.testing.assert_allclose(
        np.sort(square.vertices, axis=0)[[0, -1]], [[-1, -2, 0], [1, 2, 0]], atol=1e-12
    )
    assert len(square.vertices) == 4
    slanted = cut(
        np.array([[1.0, 1, 0], [-1, -1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]]),
        np.array([0.0, 0, 1, 1, 1, 1]), ("",) * 6,
    )  # fmt: skip
    assert slanted is not None and len(slanted.vertices) == 4
    np.testing.assert_allclose(slanted.vertices[:, 0], -slanted.vertices[:, 1], atol=1e-12)
    point = cut(np.vstack([np.eye(2), -np.eye(2)]), np.zeros(4), ("",) * 4)
    assert point is not None
    np.testing.assert_allclose(point.vertices, [[0.0, 0.0]], atol=1e-12)
    assert cut(np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]]), np.array([-1.0, 0.5, 1, 1]), ("",) * 4) is None
    flat = hull(square.vertices)
    assert len(flat.vertices) == 4 and (flat.vertices @ flat.normals.T <= flat.offsets + 1e-12).all()


def test_singular_pose_names_the_freedom() -> None:
    chain = stp.load("stewart")
    turned = pin.SE3(pin.exp3(np.array([0, 0, np.pi / 2])), np.array([0, 0, 1.0]))
    q = stp.inverse_kinematics(chain, turned).q
    for polytope in (stp.polytopes.velocity_polytope, stp.polytopes.wrench_polytope):
        with pytest.raises(SingularityError, match="platform_pose wz") as caught:
            polytope(chain, q)
        assert caught.value.smallest_singular_value < 1e-12


def test_bad_input_is_named(cad: stp.ClosedChain, report_ideal: stp.Hexapod) -> None:
    q = cad.q_home
    with pytest.raises(InputError, match="rate_limit must be finite and above zero"):
        stp.polytopes.velocity_polytope(cad, q, rate_limit=0.0)
    with pytest.raises(InputError, match=r"rate_limit must be one number or an array of shape \(6,\)"):
        stp.polytopes.velocity_polytope(cad, q, rate_limit=[1.0, 2.0])
    with pytest.raises(InputError, match="effort_limit must be finite"):
        stp.polytopes.wrench_polytope(cad, q, effort_limit=np.inf)
    with pytest.raises(InputError, match="length must be a finite number above zero"):
        stp.polytopes.wrench_polytope(cad, q, length=0.0)
    with pytest.raises(InputError, match="q must have shape"):
        stp.polytopes.velocity_polytope(cad, q[:-1])
    with pytest.raises(InputError, match="does not keep the loops closed"):
        stp.polytopes.velocity_polytope(cad, pin.integrate(cad.model, q, np.full(cad.nv, 0.1)))
    steel = pin.Inertia(20.0, np.zeros(3), np.eye(3))
    unlimited = stp.hexapod_chain(report_ideal, platform=steel, lower=steel, upper=steel)
    with pytest.raises(InputError, match=r"states no usable limit for the motors leg1, .* pass rate_limit"):
        stp.polytopes.velocity_polytope(unlimited, unlimited.q_home)
    with pytest.raises(InputError, match="pass effort_limit"):
        stp.polytopes.wrench_polytope(unlimited, unlimited.q_home)
    low = stp.inverse_kinematics(cad, pin.SE3(np.eye(3), np.array([0, 0, 0.8])), limits=False).q
    with pytest.raises(UnreachableError, match=r"'leg1' at 0\.764039") as caught:
        stp.polytopes.velocity_polytope(cad, low)
    assert len(caught.value.violations) == 6
    polytope = stp.polytopes.velocity_polytope(cad, q)
    with pytest.raises(InputError, match="direction must not be zero"):
        stp.polytopes.polytope_reach(polytope, np.zeros(6))
    with pytest.raises(InputError, match="or their indices from 0 to 5"):
        stp.polytopes.polytope_section(polytope, (0, 1, 6))
    with pytest.raises(InputError, match="different names of vx, vy"):
        stp.polytopes.polytope_section(polytope, ("vx", "up"))
    named = stp.polytopes.polytope_section(polytope, ("vx", "wz"))
    np.testing.assert_array_equal(named.vertices, stp.polytopes.polytope_section(polytope, (0, 5)).vertices)


def test_idle_motion_that_the_weight_loads_is_said() -> None:
    # Spherical lower joints leave each leg free to spin; a mass beside the leg's axis makes it do so.
    chain = stp.load("stewart_sps")
    heavy = pin.Inertia(5.0, np.array([0.3, 0.1, 0.2]), 0.1 * np.eye(3))
    chain = stp.build.replace_inertias(chain, {"leg1_lower": heavy})
    stp.polytopes.wrench_polytope(chain, chain.q_home)
    with pytest.raises(UnsupportedError, match="no motor drives"):
        stp.polytopes.wrench_polytope(chain, chain.q_home, gravity=True)


@pytest.mark.parametrize("robot", ["stewart_sps", "hexapod_rss", "delta"])
def test_stops_and_rates_of_idle_spins_do_not_bind_the_platform(robot: str, rng) -> None:
    # Joints that an idle spin moves, limited at one end or both; the programme goes over all joint rates.
    chain = stp.load(robot)
    single = np.flatnonzero(chain.judge._q >= 0)
    bare = {chain.limits.names[k]: dict.fromkeys(("position", "velocity")) for k in single}
    chain = stp.with_limits(chain, bare | {motor: {"velocity": 1.0} for motor in chain.motors})
    q = chain.q_home
    spins = np.intersect1d(single, np.flatnonzero(np.abs(chain.at(q).freedom.idle).max(axis=1) > 1e-6))
    for count in (1, 2, 4, 6):
        changes: dict[str, dict] = {}
        stops = np.full((chain.nv, 2), [-np.inf, np.inf])
        for joint in rng.choice(spins, size=count, replace=False):
            name, there, most = chain.limits.names[joint], q[chain.judge._q[joint]], rng.uniform(0.05, 1.0)
            choice = rng.integers(5)
            if choice < 2:
                changes[name] = {"position": ((there, there + 9), (there - 9, there))[choice]}
                stops[joint, choice] = 0.0
            else:
                changes[name] = {"velocity": ((None, most), (-most, None), (-most, 0.5 * most))[choice - 2]}
        limited = stp.with_limits(chain, changes)
        polytope = stp.polytopes.velocity_polytope(limited, q)
        lower, upper = limited.limits.bounds("velocity", slice(chain.nv)).T
        lower, upper = np.maximum(lower, stops[:, 0]), np.minimum(upper, stops[:, 1])
        directions = rng.standard_normal((15, len(polytope.names)))
        cost = directions @ np.linalg.pinv(polytope.basis) @ platform_jacobian(chain, q)
        best = block_programme(cost, stp.loop_jacobian(limited, q), np.zeros(chain.nc), lower, upper)
        np.testing.assert_allclose((directions @ polytope.vertices.T).max(axis=1), best, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("inner", [1, 2, 3])
def test_limits_are_projected_along_motions_that_do_not_count(inner: int, rng) -> None:
    # Two coordinates that count, both limited, and rows at one end or both that couple them with motions that do not.
    told = bound = 0
    for _ in range(40):
        m = int(rng.integers(1, 3 + 2 * inner))
        mixed = rng.standard_normal((m, 2 + inner)) * (rng.random((m, 2 + inner)) < 0.6)
        mixed = mixed[np.abs(mixed).any(axis=1)]
        turn = np.linalg.qr(rng.standard_normal((2 + inner, 2 + inner)))[0]
        rows = np.vstack([np.eye(2, 2 + inner), mixed]) @ turn
        shape = (2, mixed.shape[0])
        ends = rng.uniform(0.0, 0.7, shape) * (rng.random(shape) < 0.7)
        ends[rng.random(shape) < 0.4] = np.inf
        lower, upper = np.r_[-1.0, -1.0, -ends[0]], np.r_[1.0, 1.0, ends[1]]
        least, most = binding_limits(rows, lower, upper, turn[2:].T)
        kept = np.isfinite(least) | np.isfinite(most)
        told += np.count_nonzero(np.isfinite(np.r_[lower, upper]) & np.isinf(np.r_[least, most]))
        seen = np.linalg.svd(rows[kept])[2][: np.linalg.matrix_rank(rows[kept], tol=1e-9)].T
        found = image_of_limits(
            rows[kept] @ seen, least[kept], most[kept], (("", ""),) * np.count_nonzero(kept),
            turn[:2] @ seen, np.zeros(2),
        )  # fmt: skip
        assert found is not None
        sides, bounds = np.vstack([rows, -rows]), np.r_[upper, -lower]
        sides, bounds = sides[np.isfinite(bounds)], bounds[np.isfinite(bounds)]
        for direction in rng.standard_normal((8, 2)):
            best = linprog(-direction @ turn[:2], A_ub=sides, b_ub=bounds, bounds=(None, None))
            support = (found.vertices @ direction).max()
            assert support == pytest.approx(-best.fun, rel=1e-7, abs=1e-8)
            bound += support < np.abs(direction).sum() - 1e-6
    assert told > 20 and bound > 20


def test_a_wrench_from_outside_shifts_what_motors_can_exert(rng: np.random.Generator) -> None:
    """At the platform it adds to the set; at a leg, what inverse dynamics says that it does to the motors."""
    chain = stp.load("stewart")
    q = random_configuration(chain, rng, 0.05)
    free = stp.polytopes.wrench_polytope(chain, q, effort_limit=300.0, gravity=True)
    push = 40 * rng.normal(size=6)
    moved = stp.polytopes.wrench_polytope(
        chain, q, effort_limit=300.0, gravity=True, wrenches={"platform": push}
    )
    shift = moved.vertices.mean(axis=0) - free.vertices.mean(axis=0)
    np.testing.assert_allclose(shift, push, atol=1e-8 * np.abs(push).max())
    leg = {"leg3_lower": 40 * rng.normal(size=6)}
    held = stp.polytopes.wrench_polytope(chain, q, effort_limit=300.0, gravity=True, wrenches=leg)
    shift = held.vertices.mean(axis=0) - free.vertices.mean(axis=0)
    efforts = [
        stp.inverse_dynamics(chain.at(q), wrenches=given).tau_motor
        for given in (None, leg, {"platform": shift})
    ]
    assert np.abs(efforts[1] - efforts[0]).max() > 1.0
    np.testing.assert_allclose(efforts[2], efforts[1], atol=1e-8 * np.abs(efforts[1]).max())
