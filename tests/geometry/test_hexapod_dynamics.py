"""Legs with mass against three formulations that share no formula with the closed form.

Pinocchio (recursive Newton-Euler on the tree of opened legs), energies of clouds of particles that stand for
the bodies (differentiated numerically), and the massless limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError, UnsupportedError
from stewart_pin.geometry.rotations import rotation_from_rpy, skew

GRAVITY = np.array([0.3, -0.2, -9.81])  # tilted, so that a confusion of axes shows
# fmt: off
# Central differences of order 8 on the nodes -4 ... 4.
FIRST = np.array([1/280, -4/105, 1/5, -4/5, 0, 4/5, -1/5, 4/105, -1/280])
SECOND = np.array([-1/560, 8/315, -1/5, 8/5, -205/72, 8/5, -1/5, 8/315, -1/560])
# fmt: on
NODES = np.arange(-4, 5)
H = 0.02  # [s, m, rad]: truncation (rate h)⁸ / 630 and round-off eps / h² both near 1e-12


def real_bodies(lower_joint: str = "universal") -> stp.hexapods.HexapodBodies:
    return stp.hexapods.HexapodBodies(
        stp.hexapods.RigidBody(20.0, [0, 0, 0], np.diag([1.5, 1.5, 2.8])),
        stp.hexapods.RigidBody(2.0, [0, 0, 0.2], np.diag([0.03, 0.03, 0.002])),
        stp.hexapods.RigidBody(1.5, [0, 0, -0.2], np.diag([0.02, 0.02, 0.001])),
        lower_joint,
    )


def random_body(rng: np.random.Generator, mass: float, com: list[float]) -> stp.hexapods.RigidBody:
    half = 0.15 * rng.normal(size=(3, 3))
    second_moments = mass * half @ half.T  # positive semidefinite: the triangle inequality holds
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    return stp.hexapods.RigidBody(mass, com + 0.1 * rng.normal(size=3), inertia)


def random_bodies(rng: np.random.Generator) -> stp.hexapods.HexapodBodies:
    lower = tuple(random_body(rng, 2.0, [0, 0, 0.2]) for _ in range(6))
    upper = tuple(random_body(rng, 1.5, [0, 0, -0.2]) for _ in range(6))
    return stp.hexapods.HexapodBodies(random_body(rng, 20.0, [0, 0, 0.05]), lower, upper)


def random_states(rng: np.random.Generator, *shape: int) -> tuple[np.ndarray, ...]:
    position = [0, 0, 1.0] + rng.uniform(-0.2, 0.2, (*shape, 3))
    rotation = rotation_from_rpy(*rng.uniform(-np.deg2rad(20), np.deg2rad(20), (3, *shape)))
    return position, rotation, rng.normal(size=(*shape, 6)), 3 * rng.normal(size=(*shape, 6))


# --- Pinocchio: legs opened at the platform, tip forces found from the balance of all bodies ---------------


def open_tree(hexapod: stp.Hexapod, bodies: stp.hexapods.HexapodBodies) -> pin.Model:
    model = pin.Model()
    model.gravity.linear = GRAVITY
    turns = [pin.JointModelRX(), pin.JointModelRY()]
    turns += [pin.JointModelRZ()] if bodies.lower_joint == "spherical" else []
    for i, (point, *parts) in enumerate(zip(hexapod.base_points, bodies.lower, bodies.upper, strict=True)):
        joint, place = 0, pin.SE3(np.eye(3), point)
        for k, turn in enumerate(turns):
            joint, place = model.addJoint(joint, turn, place, f"turn{i}{k}"), pin.SE3.Identity()
        tip = model.addJoint(joint, pin.JointModelPZ(), place, f"tip{i}")
        for j, body in zip((joint, tip), parts, strict=True):
            model.appendBodyToJoint(j, pin.Inertia(body.mass, body.com, body.inertia), place)
    platform = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
    body = bodies.platform
    model.appendBodyToJoint(platform, pin.Inertia(body.mass, body.com, body.inertia), pin.SE3.Identity())
    return model


def pinocchio_forces(
    hexapod, model, position, rotation, twist, acceleration
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the balance of the tree, tau = S f_motor - Jᵀ f_tip, and of the platform at once."""
    data, n = model.createData(), (model.nv - 6) // 6
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    tips = [model.getJointId(f"tip{i}") for i in range(6)]
    arms = hexapod.platform_points @ rotation.T
    legs = position + arms - hexapod.base_points
    lengths = np.linalg.norm(legs, axis=1)

    q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for i, (leg, length) in enumerate(zip(legs, lengths, strict=True)):
        q[n * i : n * i + 2] = np.arctan2(-leg[1], leg[2]), np.arcsin(leg[0] / length)
        q[n * i + n - 1] = length
    q[-7:-4], q[-4:] = position, pin.Quaternion(rotation).coeffs()
    pin.computeJointJacobians(model, data, q)
    columns = np.array([[n * i, n * i + 1, n * i + n - 1] for i in range(6)])
    jacobians = [
        pin.getJointJacobian(model, data, j, axes)[:3, c] for j, c in zip(tips, columns, strict=True)
    ]
    for i, jacobian in enumerate(jacobians):
        v[columns[i]] = np.linalg.solve(jacobian, twist[:3] + np.cross(twist[3:], arms[i]))
    if n == 4:  # legs do not turn about themselves
        spins = np.arange(2, 24, 4)
        pin.forwardKinematics(model, data, q, v)
        v[spins] = [-data.v[tip].angular[2] for tip in tips]
    pin.forwardKinematics(model, data, q, v, a)
    for i, jacobian in enumerate(jacobians):
        swept = np.cross(acceleration[3:], arms[i]) + np.cross(twist[3:], np.cross(twist[3:], arms[i]))
        drift = pin.getClassicalAcceleration(model, data, tips[i], axes).linear
        a[columns[i]] = np.linalg.solve(jacobian, acceleration[:3] + swept - drift)
    v[-6:] = np.concatenate([rotation.T @ twist[:3], rotation.T @ twist[3:]])
    # Pinocchio's free-flyer acceleration is the spatial one: a - ω × v, in platform axes.
    a[-6:-3] = rotation.T @ (acceleration[:3] - np.cross(twist[3:], twist[:3]))
    a[-3:] = rotation.T @ acceleration[3:]
    if n == 4:
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        a[spins] = -pin.rnea(model, data, q, v, a)[spins] / mass[spins, spins]

    tau = pin.rnea(model, data, q, v, a)
    balance, right = np.zeros((24, 24)), np.zeros(24)  # unknowns: six tip forces, six motor forces
    for i, jacobian in enumerate(jacobians):
        rows = slice(3 * i, 3 * i + 3)
        balance[rows, rows] = -jacobian.T
        balance[3 * i + 2, 18 + i] = 1.0
        right[rows] = tau[columns[i]]
        balance[18:21, rows], balance[21:, rows] = rotation.T, rotation.T @ skew(arms[i])
    right[18:] = tau[-6:]
    solution = np.linalg.solve(balance, right)
    return solution[18:], solution[:18].reshape(6, 3)


@pytest.mark.parametrize("kind", ["universal", "spherical", "uneven"])
def test_agrees_with_pinocchio_on_a_thousand_states(report_ideal: stp.Hexapod, rng, kind: str) -> None:
    bodies = random_bodies(rng) if kind == "uneven" else real_bodies(kind)
    model = open_tree(report_ideal, bodies)
    states = random_states(rng, 1000)
    forces = stp.hexapods.hexapod_inverse_dynamics(report_ideal, bodies, *states, gravity=GRAVITY)
    for k, state in enumerate(zip(*states, strict=True)):
        actuator, joint = pinocchio_forces(report_ideal, model, *state)
        # Round-off times the condition of the poses (up to 9): 3e-15 measured.
        assert np.abs(forces.actuator[k] - actuator).max() <= 1e-13 * np.abs(actuator).max()
        assert np.abs(forces.platform_joint[k] - joint).max() <= 1e-13 * np.abs(joint).max()


def test_idle_spin_changes_the_forces(report_ideal: stp.Hexapod, rng) -> None:
    # Else the spherical case above would prove nothing.
    states = random_states(rng, 50)
    universal, spherical = (
        stp.hexapods.hexapod_inverse_dynamics(report_ideal, real_bodies(joint), *states).actuator
        for joint in ("universal", "spherical")
    )
    assert np.abs(universal - spherical).max() > 1e-3


# --- Energies of particles ---------------------------------------------------------------------------------


def as_particles(body: stp.hexapods.RigidBody) -> tuple[np.ndarray, np.ndarray]:
    """Replace a body by six equal particles with its mass, centre and inertia."""
    moments, axes = np.linalg.eigh(np.trace(body.inertia) / 2 * np.eye(3) - body.inertia)
    reach = axes * np.sqrt(3 * np.maximum(moments, 0) / body.mass)
    return np.full(6, body.mass / 6), body.com + np.concatenate([reach.T, -reach.T])


class ParticlePlatform:
    """All bodies as particles, placed by coordinates x, y, z, roll, pitch, yaw."""

    def __init__(self, hexapod: stp.Hexapod, bodies: stp.hexapods.HexapodBodies) -> None:
        self.hexapod = hexapod
        parts = [bodies.platform, *bodies.lower, *bodies.upper]
        masses, points = zip(*(as_particles(body) for body in parts), strict=True)
        self.masses, self.points = np.concatenate(masses), points

    def places(self, x: np.ndarray) -> np.ndarray:
        """Return (..., particles, 3) in the world."""
        rotation = rotation_from_rpy(*np.moveaxis(x[..., 3:], -1, 0))
        tips = x[..., None, :3] + self.hexapod.platform_points @ np.swapaxes(rotation, -1, -2)
        clouds = [x[..., None, :3] + self.points[0] @ np.swapaxes(rotation, -1, -2)]
        legs = [self._leg_rotation(tips[..., i, :] - self.hexapod.base_points[i]) for i in range(6)]
        for i, turn in enumerate(legs):
            clouds.append(self.hexapod.base_points[i] + self.points[1 + i] @ np.swapaxes(turn, -1, -2))
        for i, turn in enumerate(legs):
            clouds.append(tips[..., None, i, :] + self.points[7 + i] @ np.swapaxes(turn, -1, -2))
        return np.concatenate(clouds, axis=-2)

    @staticmethod
    def _leg_rotation(leg: np.ndarray) -> np.ndarray:
        angles = np.arctan2(-leg[..., 1], leg[..., 2]), np.arcsin(leg[..., 0] / np.linalg.norm(leg, axis=-1))
        turn = Rotation.from_euler("XY", np.stack(angles, axis=-1).reshape(-1, 2)).as_matrix()
        return turn.reshape(*leg.shape, 3)

    def lengths(self, x: np.ndarray) -> np.ndarray:
        return stp.leg_lengths(self.hexapod, x[..., :3], rotation_from_rpy(*np.moveaxis(x[..., 3:], -1, 0)))

    def potential(self, x: np.ndarray) -> np.ndarray:
        return -np.einsum("k,...kj,j->...", self.masses, self.places(x), GRAVITY)

    def mass_matrix(self, x: np.ndarray) -> np.ndarray:
        jacobian = gradient(self.places, x)
        return np.einsum("k,i...kj,l...kj->...il", self.masses, jacobian, jacobian)


def gradient(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Differentiate along each of the six coordinates; (6, ...)."""
    steps = NODES[:, None, None] * H * np.eye(6)
    values = function(x[..., None, None, :] + steps)  # (..., 9, 6, ...)
    return np.moveaxis(np.tensordot(FIRST, np.moveaxis(values, x.ndim - 1, 0), 1), x.ndim - 1, 0) / H


class Path:
    """A smooth motion of the six coordinates, and its twist by differences of poses."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.start = np.array([0, 0, 1.0, 0, 0, 0]) + rng.uniform(-0.1, 0.1, 6)
        self.amplitude, self.rate, self.phase = 0.1 * rng.normal(size=6), *rng.uniform(1, 3, (2, 6))

    def __call__(self, t: np.ndarray) -> np.ndarray:
        return self.start + self.amplitude * np.sin(np.multiply.outer(t, self.rate) + self.phase)

    def derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """Return first and second derivative of the coordinates at t = 0."""
        swing = self.amplitude * self.rate
        return swing * np.cos(self.phase), -swing * self.rate * np.sin(self.phase)

    def state(self) -> tuple[np.ndarray, ...]:
        x = self(H * NODES)
        rotations = rotation_from_rpy(*x[:, 3:].T)
        turn, turn_rate = (np.tensordot(w, rotations, 1) @ rotations[4].T for w in (FIRST / H, SECOND / H**2))
        parts = [(FIRST @ x[:, :3] / H, turn), (SECOND @ x[:, :3] / H**2, turn_rate)]
        # The antisymmetric part of R'Rᵀ is ω×, that of R''Rᵀ is (dω/dt)×.
        twist, acceleration = (
            np.concatenate(
                [linear, [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]] * np.full(3, 0.5)]
            )
            for linear, m in parts
        )
        return x[4, :3], rotations[4], twist, acceleration


@pytest.fixture(params=["real", "uneven"])
def cases(
    request, report_ideal: stp.Hexapod, rng
) -> Iterator[tuple[stp.hexapods.HexapodBodies, ParticlePlatform]]:
    bodies = random_bodies(rng) if request.param == "uneven" else real_bodies()
    return bodies, ParticlePlatform(report_ideal, bodies)


def test_power_is_the_rate_of_energy(report_ideal: stp.Hexapod, rng, cases) -> None:
    bodies, particles = cases
    for _ in range(10):
        path = Path(rng)
        places = particles.places(path(H * np.arange(-8, 9)))
        velocity = np.stack([np.tensordot(FIRST, places[k : k + 9], 1) for k in range(9)]) / H
        kinetic = np.einsum("k,tkj->t", particles.masses, velocity**2) / 2
        power = FIRST @ (kinetic + particles.potential(path(H * NODES))) / H
        position, rotation, twist, acceleration = path.state()
        forces = stp.hexapods.hexapod_inverse_dynamics(
            report_ideal, bodies, position, rotation, twist, acceleration, gravity=GRAVITY
        )
        terms = forces.actuator * stp.hexapods.leg_rates(report_ideal, position, rotation, twist)
        # Truncation of two nested differences: 2e-11 measured.
        assert abs(terms.sum() - power) <= 1e-9 * np.abs(terms).sum()


def test_forces_at_rest_are_the_slope_of_the_potential(report_ideal: stp.Hexapod, rng, cases) -> None:
    bodies, particles = cases
    for _ in range(10):
        x = Path(rng).start
        expected = np.linalg.solve(gradient(particles.lengths, x), gradient(particles.potential, x))
        forces = stp.hexapods.hexapod_inverse_dynamics(
            report_ideal, bodies, x[:3], rotation_from_rpy(*x[3:]), np.zeros(6), np.zeros(6), gravity=GRAVITY
        )
        # Truncation of the differences: 2e-12 measured.
        np.testing.assert_allclose(forces.actuator, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_forces_obey_the_euler_lagrange_equations(report_ideal: stp.Hexapod, rng, cases) -> None:
    bodies, particles = cases
    for _ in range(3):
        path = Path(rng)
        x, (dx, ddx) = path(0.0), path.derivatives()
        slopes = gradient(particles.mass_matrix, x)  # (k, i, j) = dM_ij / dx_k
        momentum_rate = particles.mass_matrix(x) @ ddx + np.einsum("kij,k,j->i", slopes, dx, dx)
        lagrange = momentum_rate - np.einsum("kij,i,j->k", slopes, dx, dx) / 2
        lagrange += gradient(particles.potential, x)
        expected = np.linalg.solve(gradient(particles.lengths, x), lagrange)
        forces = stp.hexapods.hexapod_inverse_dynamics(report_ideal, bodies, *path.state(), gravity=GRAVITY)
        # Truncation of two nested differences: 3e-12 measured.
        np.testing.assert_allclose(forces.actuator, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


# --- Limits, shapes and errors -----------------------------------------------------------------------------


def test_massless_legs_leave_the_point_mass_forces(report_ideal: stp.Hexapod, rng) -> None:
    nothing = stp.hexapods.RigidBody(0.0, [0.1, 0, 0.2], np.zeros((3, 3)))
    platform = stp.hexapods.RigidBody(20.0, np.zeros(3), np.zeros((3, 3)))
    position, rotation, twist, acceleration = random_states(rng, 200)
    expected = stp.point_mass_forces(report_ideal, position, rotation, acceleration[:, :3], mass=20.0)
    for joint in ("universal", "spherical"):
        bodies = stp.hexapods.HexapodBodies(platform, nothing, nothing, joint)
        forces = stp.hexapods.hexapod_inverse_dynamics(
            report_ideal, bodies, position, rotation, twist, acceleration
        )
        assert np.abs(forces.actuator - expected).max() <= 1e-12 * np.abs(expected).max()


def test_any_batch_shape(report_ideal: stp.Hexapod, rng) -> None:
    position, rotation, twist, acceleration = random_states(rng, 2, 4)
    bodies = random_bodies(rng)
    forces = stp.hexapods.hexapod_inverse_dynamics(
        report_ideal, bodies, position, rotation, twist, acceleration
    )
    assert forces.actuator.shape == (2, 4, 6) and forces.platform_joint.shape == (2, 4, 6, 3)
    # One argument alone carries the batch; the others are shared.
    state = [position[0, 1], rotation[0, 1], twist[0, 1], acceleration[0, 1]]
    one = stp.hexapods.hexapod_inverse_dynamics(report_ideal, bodies, *state)
    np.testing.assert_allclose(one.actuator, forces.actuator[0, 1], rtol=1e-12)
    for k, batch in enumerate((position, rotation, twist, acceleration)):
        many = stp.hexapods.hexapod_inverse_dynamics(report_ideal, bodies, *state[:k], batch, *state[k + 1 :])
        assert many.actuator.shape == (2, 4, 6) and many.platform_joint.shape == (2, 4, 6, 3)
        np.testing.assert_allclose(many.actuator[0, 1], one.actuator, rtol=1e-12)
    empty = stp.hexapods.hexapod_inverse_dynamics(report_ideal, bodies, np.empty((0, 3)), *state[1:])
    assert empty.actuator.shape == (0, 6) and empty.platform_joint.shape == (0, 6, 3)


def test_spin_of_an_uneven_leg_on_spherical_joints_is_refused(report_ideal: stp.Hexapod, rng) -> None:
    even = real_bodies().lower[0]
    upper = (even, even, random_body(rng, 1.0, [0, 0, -0.2]), even, even, even)
    bodies = stp.hexapods.HexapodBodies(real_bodies().platform, even, upper, "spherical")
    with pytest.raises(UnsupportedError, match="upper part of leg 3 is not axisymmetric"):
        stp.hexapods.hexapod_inverse_dynamics(report_ideal, bodies, *random_states(rng))


def test_singular_pose_gives_the_singular_value(report_ideal: stp.Hexapod) -> None:
    turned = rotation_from_rpy(0, 0, np.pi / 2)
    with pytest.raises(SingularityError, match="smallest singular value") as caught:
        stp.hexapods.hexapod_inverse_dynamics(
            report_ideal, real_bodies(), [0, 0, 1.0], turned, np.zeros(6), np.zeros(6)
        )
    assert caught.value.smallest_singular_value < 1e-12


def test_gimbal_lock_names_the_leg(report_ideal: stp.Hexapod) -> None:
    platform = report_ideal.platform_points.copy()
    platform[3] = report_ideal.base_points[3] + [0.7, 0, -1.0]
    lying = stp.Hexapod(report_ideal.base_points, platform)
    with pytest.raises(SingularityError, match="leg 4 lies along the first axis") as caught:
        stp.hexapods.hexapod_inverse_dynamics(
            lying, real_bodies(), [0, 0, 1.0], np.eye(3), np.zeros(6), np.zeros(6)
        )
    assert caught.value.smallest_singular_value < 1e-12 and caught.value.names == ("leg 4 α", "leg 4 β")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"position": [0, 0]}, "position must have shape"),
        ({"rotation": 2 * np.eye(3)}, "rotation must hold"),
        ({"twist": np.zeros(5)}, "twist must have shape"),
        ({"twist": [0, 0, np.inf, 0, 0, 0]}, "twist must be finite"),
        ({"acceleration": np.zeros(3)}, "acceleration must have shape"),
        ({"gravity": [0, 9.81]}, "gravity must have shape"),
        ({"twist": np.zeros((2, 6)), "acceleration": np.zeros((3, 6))}, "batch shapes"),
    ],
)
def test_bad_states_are_named(report_ideal: stp.Hexapod, changed: dict, words: str) -> None:
    state = {
        "position": [0, 0, 1.0],
        "rotation": np.eye(3),
        "twist": np.zeros(6),
        "acceleration": np.zeros(6),
    }
    with pytest.raises(InputError, match=words):
        stp.hexapods.hexapod_inverse_dynamics(report_ideal, real_bodies(), **(state | changed))
