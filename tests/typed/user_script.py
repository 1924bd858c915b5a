"""What a user writes in a first hour: this file is type-checked as a stranger's would be, and runs as a test."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp

chain = stp.load("stewart")
pose = stp.platform_pose(chain, chain.q_home)
state = stp.platform_motion(chain, pose, np.zeros(6), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
effort = stp.inverse_dynamics(state)
forces: np.ndarray = effort.tau_motor
again = stp.inverse_dynamics(chain, state.q, state.v, state.a, method="constraint_matrix")
motion = stp.forward_dynamics(chain, state.q, state.v, forces)
here: stp.State = chain.at(state.q, state.v)
found = stp.inverse_kinematics(chain, pin.SE3(np.eye(3), np.array([0.0, 0.05, 1.0])))
lengths = stp.motor_positions(chain, found.q)
back = stp.forward_kinematics(chain, lengths)
singularity = stp.singularities.classify_singularity(here, axes=("vx", "vy", "vz"))
kinds: list[str] = [str(kind) for kind in singularity.kinds]

kernels = stp.compile_kernels(chain, coordinates="motor")
many = kernels.inverse_dynamics(lengths[None], np.zeros((1, 6)), np.zeros((1, 6)))
run = stp.simulate(
    chain, found.q, chain.rest, duration=0.01, method="RK45", stop_on=("stroke", "singularity")
)
last: stp.simulation.SimulationState = run.final_state

hexapod = stp.hexapods.semi_regular_hexapod(1.0, 0.7, 0.2, 0.2)
modes = stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, [0.0, 0.0, 1.0], np.eye(3)))
poses: int = len(modes.position)
limits: stp.limits.Limits = chain.limits


def misspelt() -> None:
    """Misspell options, to which a checker must object: an unneeded ``ignore`` is an error of its own."""
    stp.simulate(chain, found.q, chain.rest, duration=0.01, method="rk4")  # type: ignore[arg-type]
    stp.velocity_limits(hexapod, [0, 0, 1], np.eye(3), rate_limit=1.0, others="none")  # type: ignore[arg-type]
    stp.compile_kernels(chain).single_state("inverse_dynamic")  # type: ignore[arg-type]
    stp.dynamics.motion_map(chain, found.q, coordinates="motors")  # type: ignore[arg-type]


print(
    chain, limits, forces, many.shape, kinds, poses, back.success, motion.a.shape, again.residual, last.time
)
