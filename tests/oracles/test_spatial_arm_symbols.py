"""The spatial three-joint arm against a derivation in symbols (S3.2, S3.3)."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp

sympy = pytest.importorskip("sympy")

LENGTHS = np.array([0.3, 0.5, 0.4])
FRAMES = (3, 4)


def test_symbols_give_the_same() -> None:
    """Differentiate the forward kinematics and propagate the velocities in symbols; both equal the closed form."""
    q, rates, lengths = (sympy.symbols(f"{x}1:4", real=True) for x in ("theta", "omega", "L"))

    def turn(angle):
        c, s = sympy.cos(angle), sympy.sin(angle)
        return sympy.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    upright = sympy.Matrix([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    steps = [
        (sympy.zeros(3, 1), turn(q[0])),
        (sympy.Matrix([lengths[0], 0, 0]), upright * turn(q[1])),
        (sympy.Matrix([lengths[1], 0, 0]), turn(q[2])),
        (sympy.Matrix([lengths[2], 0, 0]), sympy.eye(3)),
    ]
    z = sympy.Matrix([0, 0, 1])
    rotation, origin = sympy.eye(3), sympy.zeros(3, 1)
    omega = velocity = sympy.zeros(3, 1)
    propagated, differentiated = [], []
    for (shift, step), rate in zip(steps, (*rates, 0), strict=True):
        velocity = step.T * (velocity + omega.cross(shift))
        omega = step.T * omega + rate * z
        origin, rotation = origin + rotation * shift, rotation * step
        propagated.append((omega, velocity))
        differentiated.append((origin.jacobian(sympy.Matrix(q)), rotation))

    points = np.random.default_rng(7).uniform(-3, 3, (5, 3))
    for frame in FRAMES:
        jacobian, rotation = differentiated[frame - 1]
        omega, velocity = propagated[frame - 1]
        local = rotation.T * jacobian
        symbolic = {
            "base": jacobian,
            "frame": local,
            "carried": velocity.jacobian(sympy.Matrix(rates)),
            "spin": omega.jacobian(sympy.Matrix(rates)),
        }
        numeric = sympy.lambdify([q, lengths], list(symbolic.values()))
        for x in points:
            base, own = (
                stp.arms.spatial_arm_jacobian(LENGTHS, x, frame=frame, axes=axes)
                for axes in ("base", "frame")
            )
            for value, wanted in zip(numeric(x, LENGTHS), (base[:3], own[:3], own[:3], own[3:]), strict=True):
                np.testing.assert_allclose(value, wanted, rtol=0, atol=1e-14)

    # The elements the source gets wrong, as expressions.
    (_, l2, l3), (q1, q2, q3), (s, c) = lengths, q, (sympy.sin, sympy.cos)
    carried, omega3 = propagated[3][1].jacobian(sympy.Matrix(rates)), propagated[2][0]
    reach = lengths[0] + l2 * c(q2) + l3 * c(q2 + q3)
    for found, right in (
        (carried[1, 1], l2 * c(q3) + l3),
        (carried[2, 0], -reach),
        (omega3[0], s(q2 + q3) * rates[0]),
        (differentiated[2][0][0, 1], -l2 * s(q2) * c(q1)),
    ):
        assert sympy.simplify(found - right) == 0
