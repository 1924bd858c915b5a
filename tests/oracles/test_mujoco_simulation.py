"""MuJoCo, given the exported file and the same motor efforts, moves the platform along the same path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'stewart_pin[oracles]'")

TWIST = np.array([0.3, -0.2, 0.2, 0.5, 0.4, -0.3])
EFFORTS = np.array([60.0, 45.0, 55.0, 50.0, 40.0, 58.0])
DURATION = 0.1


@pytest.mark.parametrize(("integrator", "dt", "accuracy"), [("RK4", 1e-3, 4e-7), ("EULER", 2.5e-4, 8e-6)])
def test_same_path(integrator: str, dt: float, accuracy: float, tmp_path: Path) -> None:
    from tests.oracles.test_mujoco import compiled

    chain = stp.load("stewart")
    state = stp.platform_motion(chain, stp.platform_pose(chain, chain.q_home), TWIST, np.zeros(6))
    ours = stp.simulate(chain, state.q, state.v, lambda t, q, v: EFFORTS, duration=DURATION, dt=2e-3)

    engine = compiled(chain, tmp_path)
    model, data = engine.model, engine.data
    model.opt.timestep = dt
    model.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}"))
    engine.set(state.q, state.v)
    data.qfrc_applied[[int(model.joint(name).dofadr[0]) for name in chain.motors]] = EFFORTS
    for _ in range(round(DURATION / dt)):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    path = np.linalg.norm(ours.platform.position[-1] - ours.platform.position[0])
    assert path > 0.03
    # RK4: its loops yield 6e-7 m under load, whatever the step. Euler: an error of first order, 4e-6 m at this step.
    there = data.xpos[model.body(chain.platform).id]
    np.testing.assert_allclose(there, ours.platform.position[-1], rtol=0, atol=accuracy)
    turn = data.xmat[model.body(chain.platform).id].reshape(3, 3)
    np.testing.assert_allclose(turn, ours.platform.rotation[-1], rtol=0, atol=10 * accuracy)
