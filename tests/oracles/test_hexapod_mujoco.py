"""The closed forms of the hexapod against MuJoCo: six tendons from the world to a free body are its legs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp

mujoco = pytest.importorskip("mujoco")


def _tendon_model(hexapod: stp.Hexapod) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    platform = spec.worldbody.add_body(name="platform", mass=1.0, inertia=[1.0, 1.0, 1.0])
    platform.add_freejoint()
    for i, (base, top) in enumerate(zip(hexapod.base_points, hexapod.platform_points, strict=True)):
        spec.worldbody.add_site(name=f"base_{i}", pos=base)
        platform.add_site(name=f"top_{i}", pos=top)
        tendon = spec.add_tendon(name=f"leg_{i}")
        tendon.wrap_site(f"base_{i}")
        tendon.wrap_site(f"top_{i}")
    return spec.compile()


@pytest.mark.parametrize("geometry", ["report_cad", "report_ideal"])
def test_legs_are_tendons(geometry: str, request: pytest.FixtureRequest, rng: np.random.Generator) -> None:
    hexapod = request.getfixturevalue(geometry)
    model = _tendon_model(hexapod)
    data = mujoco.MjData(model)
    for _ in range(10):
        position = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.3, 0.3, 3)
        turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
        rotation = turn.as_matrix()
        v, omega = rng.normal(size=(2, 3))
        data.qpos[:] = [*position, *turn.as_quat(scalar_first=True)]
        data.qvel[:] = [*v, *rotation.T @ omega]  # a free joint turns about the body's own axes
        mujoco.mj_forward(model, data)
        # Round-off of the two formulas; lengths and rates are of order one.
        np.testing.assert_allclose(data.ten_length, stp.leg_lengths(hexapod, position, rotation), rtol=1e-13)
        rates = stp.leg_jacobian(hexapod, position, rotation) @ [*v, *omega]
        np.testing.assert_allclose(data.ten_velocity, rates, rtol=0, atol=1e-12)
