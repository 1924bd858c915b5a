"""CasADi functions of a hexapod, written by hand: what a compiled kernel is measured and checked on."""

from __future__ import annotations

import casadi as ca
import numpy as np

import stewart_pin as stp

GRAVITY = np.array([0.0, 0.0, -9.81])


def rotation_of(q: ca.SX) -> ca.SX:
    """Rotation matrix of a unit quaternion x y z w."""
    x, y, z, w = (q[i] for i in range(4))
    return ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        ca.horzcat(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        ca.horzcat(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def lengths_function(hexapod: stp.Hexapod) -> ca.Function:
    """Leg lengths of a pose."""
    pose = ca.SX.sym("pose", 7)
    turn = rotation_of(pose[3:])
    legs = [
        pose[:3] + turn @ p - b for b, p in zip(hexapod.base_points, hexapod.platform_points, strict=True)
    ]
    lengths = ca.vertcat(*(ca.sqrt(ca.dot(d, d)) for d in legs))
    return ca.Function("inverse_kinematics", [pose], [lengths], ["pose"], ["q_motor"])


def inverse_dynamics_function(
    hexapod: stp.Hexapod,
    bodies: stp.hexapods.HexapodBodies,
    pivots: np.ndarray,
    *,
    conditioning: bool = False,
) -> ca.Function:
    """Motor forces of a 6-UPS hexapod whose leg parts are axisymmetric; the formulas of `hexapod_inverse_dynamics`."""
    pose, twist, acc = (ca.SX.sym(n, k) for n, k in (("pose", 7), ("twist", 6), ("acceleration", 6)))
    turn = rotation_of(pose[3:])
    linear, omega, felt, omega_rate = twist[:3], twist[3:], acc[:3] - GRAVITY, acc[3:]
    platform = bodies.platform
    arm = turn @ platform.com
    inertia = turn @ platform.inertia @ turn.T
    force = platform.mass * (felt + ca.cross(omega_rate, arm) + ca.cross(omega, ca.cross(omega, arm)))
    moment = inertia @ omega_rate + ca.cross(omega, inertia @ omega) + ca.cross(arm, force)
    rows, along = [], []
    for base, point, lower, upper in zip(
        hexapod.base_points, hexapod.platform_points, bodies.lower, bodies.upper, strict=True
    ):
        swept = turn @ point
        d = pose[:3] + swept - base
        inverse = 1 / ca.sqrt(ca.dot(d, d))
        length = ca.dot(d, d) * inverse
        u = d * inverse
        turned = ca.cross(omega, swept)
        tip_felt = felt + ca.cross(omega_rate, swept) + ca.cross(omega, turned)
        velocity = linear + turned
        rate = ca.dot(u, velocity)
        swing = (velocity - rate * u) * inverse
        tilt = u[1] * u[1] + u[2] * u[2]  # cos² β
        across = ca.cross(u, swing)
        spin = -(across[1] * u[1] + across[2] * u[2]) / tilt
        w = across + spin * u
        bend = ca.cross(u, tip_felt + GRAVITY - 2 * rate * swing) * inverse
        turned_about_y = w[0] * (w[1] * u[2] - w[2] * u[1])
        spin_rate = (
            turned_about_y - bend[1] * u[1] - bend[2] * u[2] - spin * (swing[1] * u[1] + swing[2] * u[2])
        ) / tilt
        w_rate = bend + spin_rate * u + spin * swing
        # Both parts turn with ω: inertia across and along add up; centres of mass lie on the leg.
        across_inertia = lower.inertia[0, 0] + upper.inertia[0, 0]
        along_inertia = lower.inertia[2, 2] + upper.inertia[2, 2]
        momentum = across_inertia * across + along_inertia * spin * u
        m_leg = (
            across_inertia * w_rate
            + (along_inertia - across_inertia) * ca.dot(u, w_rate) * u
            + ca.cross(w, momentum)
        )
        twirl = ca.cross(w, swing) + ca.cross(w_rate, u)  # d²u/dt²
        f_lower = lower.mass * (lower.com[2] * twirl - GRAVITY)
        f_upper = upper.mass * (upper.com[2] * twirl + tip_felt)
        m_leg += ca.cross(u, lower.com[2] * f_lower + (upper.com[2] + length) * f_upper)
        torque = ca.dot(m_leg, u) / tilt
        passed = ca.vertcat(0, torque * u[1], torque * u[2]) - m_leg
        f_across = ca.cross(passed, u) * inverse
        force -= f_across
        moment -= ca.cross(swept, f_across)
        rows.append(ca.vertcat(u, ca.cross(swept, u)))
        along.append(ca.dot(f_upper, u))
    matrix = ca.horzcat(*rows)
    thrust, smallest = eliminate(matrix, ca.vertcat(force, moment), pivots)
    outputs = [thrust + ca.vertcat(*along)] + ([smallest] if conditioning else [])
    return ca.Function(
        "inverse_dynamics",
        [pose, twist, acc],
        outputs,
        ["pose", "twist", "acceleration"],
        ["tau_motor", "smallest_pivot"][: len(outputs)],
    )


def eliminate(matrix: ca.SX, right: ca.SX, pivots: np.ndarray) -> tuple[ca.SX, ca.SX]:
    """Solve by elimination with pivots (row, column) in a given order; the smallest pivot as well."""
    n = len(pivots)
    a = [[matrix[r, c] for c in range(n)] for r in range(n)]
    b = [right[r] for r in range(n)]
    smallest = ca.SX.inf()
    open_rows, open_columns = list(range(n)), list(range(n))
    for r, c in pivots:
        open_rows.remove(r)
        open_columns.remove(c)
        smallest = ca.fmin(smallest, ca.fabs(a[r][c]))
        for i in open_rows:
            factor = a[i][c] / a[r][c]
            for j in open_columns:
                a[i][j] = a[i][j] - factor * a[r][j]
            b[i] = b[i] - factor * b[r]
    x: list[ca.SX] = [ca.SX(0)] * n
    for k in reversed(range(n)):
        r, c = pivots[k]
        rest = b[r]
        for _, j in pivots[k + 1 :]:
            rest = rest - a[r][j] * x[j]
        x[c] = rest / a[r][c]
    return ca.vertcat(*x), smallest


def pivot_order(matrix: np.ndarray) -> np.ndarray:
    """Order of full pivoting of a sample matrix."""
    a = np.array(matrix, dtype=float)
    n = len(a)
    rows, columns, order = list(range(n)), list(range(n)), []
    for _ in range(n):
        size = np.abs(a[np.ix_(rows, columns)])
        i, j = np.unravel_index(np.argmax(size), size.shape)
        r, c = rows.pop(i), columns.pop(j)
        order.append((r, c))
        for k in rows:
            a[k] -= a[k, c] / a[r, c] * a[r]
    return np.array(order)


def sample_hexapod() -> tuple[stp.Hexapod, stp.hexapods.HexapodBodies]:
    """Geometry and masses of the bundled robot ``stewart``."""
    s = np.sqrt(3.0)
    # fmt: off
    base = [[.15, 7*s/20, 0], [.6, -s/10, 0], [.45, -s/4, 0],
            [-.45, -s/4, 0], [-.6, -s/10, 0], [-.15, 7*s/20, 0]]
    platform = [[.35, s/5, 0], [.475, 3*s/40, 0], [.125, -11*s/40, 0],
                [-.125, -11*s/40, 0], [-.475, 3*s/40, 0], [-.35, s/5, 0]]
    # fmt: on
    bodies = stp.hexapods.HexapodBodies(
        platform=stp.hexapods.RigidBody(20.0, np.zeros(3), np.diag([1.5, 1.5, 2.8])),
        lower=stp.hexapods.RigidBody(2.0, np.array([0, 0, 0.2]), np.diag([0.03, 0.03, 0.002])),
        upper=stp.hexapods.RigidBody(1.5, np.array([0, 0, -0.2]), np.diag([0.02, 0.02, 0.001])),
    )
    return stp.Hexapod(np.array(base), np.array(platform)), bodies


def sample_states(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (N, 7), twists and accelerations (N, 6) around the middle of the workspace."""
    axis = rng.normal(size=(n, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    half = rng.uniform(0, 0.15, size=(n, 1))
    position = np.array([0, 0, 1.0]) + rng.uniform(-0.2, 0.2, size=(n, 3))
    pose = np.concatenate([position, axis * np.sin(half), np.cos(half)], axis=1)
    return pose, rng.normal(size=(n, 6)), rng.normal(size=(n, 6))


def sample_inverse_dynamics(*, conditioning: bool = False) -> ca.Function:
    """Inverse dynamics of the sample, with pivots from its home pose."""
    hexapod, bodies = sample_hexapod()
    jacobian = stp.leg_jacobian(hexapod, np.array([0.03, 0.05, 1.0]), np.eye(3))
    return inverse_dynamics_function(hexapod, bodies, pivot_order(jacobian.T), conditioning=conditioning)
