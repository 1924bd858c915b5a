"""The rate of a displacement is that of Pinocchio's logarithm, to third order."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.motion.simulation.steppers import Displacements, displacement_jacobian


def test_rate_of_a_displacement(rng: np.random.Generator) -> None:
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    ball = model.addJoint(root, pin.JointModelSpherical(), pin.SE3.Random(), "ball")
    model.addJoint(ball, pin.JointModelRX(), pin.SE3.Random(), "hinge")
    rates = Displacements(model)
    q = pin.neutral(model)
    step, v = rng.normal(size=model.nv), rng.normal(size=model.nv)
    errors = []
    for size in (0.1, 0.05):
        moved = pin.integrate(model, q, size * step)
        exact = displacement_jacobian(model, q, moved) @ v
        errors.append(np.abs(rates.rate(size * step, v) - exact).max())
    # The first term left out is of fourth order.
    assert 12 < errors[0] / errors[1] < 20
    assert errors[1] < 1e-6
