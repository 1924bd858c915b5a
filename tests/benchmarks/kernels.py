"""Time of the kernels for a state, against other ways to the same numbers. Run by hand; one minute.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.kernels``. All run in turn in one process, round after round; medians,
and the ratio to Pinocchio driven from Python in the same round. Each way is first checked to give the same forces.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.building.hexapod_bodies import hexapod_bodies
from stewart_pin.state.loop_verbs import constraint_models
from tests.kernels.hexapod_graph import sample_states
from tests.oracles.test_mujoco import compiled

N = 16384
FEW = 32
"""States of the ways that take one at a time."""
Way = tuple[Callable[[], object], int]
"""What to call, and how many states that treats."""


def lean_pinocchio(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Inverse dynamics as a user of Pinocchio would write it, all that can be prepared being prepared."""
    model, data = chain.model, pin.Data(chain.model)
    models = constraint_models(chain)
    datas = pin.StdVec_RigidConstraintData()
    for constraint in models:
        datas.append(constraint.createData())
    pairs = list(zip(models, datas, strict=True))
    motor = np.asarray(chain.motor_index)
    passive = np.setdiff1d(np.arange(chain.nv), motor)
    tau = np.empty((len(q), chain.nu))
    for k in range(len(q)):
        needed = pin.rnea(model, data, q[k], v[k], a[k])
        pin.computeJointJacobians(model, data, q[k])
        for constraint, place in pairs:
            constraint.calc(model, data, place)  # else the Jacobian is that of an older state
        jacobian = pin.getConstraintsJacobian(model, data, models, datas)
        reaction = np.linalg.solve(jacobian[:, passive].T, needed[passive])
        tau[k] = needed[motor] - jacobian[:, motor].T @ reaction
    return tau


def ways(chain: stp.ClosedChain) -> tuple[dict[str, Way], dict[str, float]]:
    """Prepare all ways, and check that they agree."""
    rng = np.random.default_rng(1)
    pose, twist, acceleration = sample_states(rng, N)
    seconds: dict[str, float] = {}

    def timed(name: str, call: Callable[[], Any]) -> Any:
        start = time.process_time()
        result = call()
        seconds[name] = time.process_time() - start
        return result

    kernels = timed("plan", lambda: stp.compile_kernels(chain))
    half_kernels = stp.compile_kernels(chain, dtype=np.float32)
    timed("graph of inverse dynamics", lambda: kernels.casadi("inverse_dynamics"))
    tau = timed("compile and run it", lambda: kernels.inverse_dynamics(pose, twist, acceleration))
    one = timed("compile it for one state", lambda: kernels.single_state("inverse_dynamics"))
    inverse = kernels.inverse_dynamics
    back = timed("first forward dynamics", lambda: kernels.forward_dynamics(pose, twist, tau))
    lengths = timed("first six lengths", lambda: kernels.inverse_kinematics(pose))
    home = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    found_pose = timed("first forward kinematics", lambda: kernels.forward_kinematics(lengths, home))
    near = pose + np.array([0.01, 0.01, 0.01, 0, 0, 0, 0])
    aside = rng.normal(size=(N, 3))
    farther = pose + np.hstack([0.05 * aside / np.linalg.norm(aside, axis=1)[:, None], np.zeros((N, 4))])
    by_motors = stp.compile_kernels(chain, coordinates="motor")
    pose_of, held = kernels.single_state("forward_kinematics"), by_motors.single_state("inverse_dynamics")
    rates = np.einsum("nij,nj->ni", kernels.motor_jacobian(pose), twist)
    sped, far = rng.normal(size=(N, chain.nu)), lengths.copy()
    far[::64, ::2] *= 5.0  # out of reach of the others

    states = [
        stp.platform_motion(chain, pin.XYZQUATToSE3(p), t, c)
        for p, t, c in zip(pose[:FEW], twist[:FEW], acceleration[:FEW], strict=True)
    ]
    q, v, a = (np.array([getattr(s, n) for s in states]) for n in "qva")
    out, status, conditioning = np.empty((N, 6)), np.empty(N, dtype=np.int8), np.empty(N)
    half = [x.astype(np.float32) for x in (pose, twist, acceleration)]
    short = [x[:1] for x in (pose, twist, acceleration)]
    first = [x[0].copy() for x in (pose, twist, acceleration)]
    hexapod, bodies = stp.Hexapod.from_chain(chain), hexapod_bodies(chain)
    rotation = Rotation.from_quat(pose[:, 3:]).as_matrix()
    folder = tempfile.TemporaryDirectory()
    engine = compiled(chain, Path(folder.name))
    theirs = []
    for k in range(FEW):
        engine.set(q[k], v[k], a[k])
        theirs.append([x.copy() for x in (engine.data.qpos, engine.data.qvel, engine.data.qacc)])

    def closed_form() -> np.ndarray:
        return np.concatenate(
            [
                stp.hexapods.hexapod_inverse_dynamics(
                    hexapod, bodies, pose[s, :3], rotation[s], twist[s], acceleration[s]
                ).actuator
                for s in (slice(k, k + 1024) for k in range(0, N, 1024))
            ]
        )

    def mujoco_inverse() -> None:
        data = engine.data
        for data.qpos[:], data.qvel[:], data.qacc[:] in theirs:
            mujoco.mj_inverse(engine.model, data)

    def verb() -> np.ndarray:
        return np.array([stp.inverse_dynamics(chain, *s).tau_motor for s in zip(q, v, a, strict=True)])

    many = [
        np.tile(x, (16, 1)) for x in (pose, twist, acceleration)
    ]  # so that the start of a thread counts little
    room = np.empty((16 * N, chain.nu))
    wide = np.empty((N, chain.nu, len(kernels.inertial_parameters)))
    size = np.abs(tau).max()
    for name, other in (
        ("lean", lean_pinocchio(chain, q, v, a)),
        ("verb", verb()),
        ("closed form", closed_form()),
    ):
        assert np.abs(other - tau[: len(other)]).max() < 1e-10 * size, name
    reactions = kernels.reactions(pose[:FEW], twist[:FEW], acceleration[:FEW])
    expected = [stp.inverse_dynamics(chain, *s).lambda_c for s in zip(q, v, a, strict=True)]
    assert np.abs(reactions - expected).max() < 1e-10 * np.abs(expected).max()
    regressor = kernels.regressor(pose[:FEW], twist[:FEW], acceleration[:FEW])
    assert np.abs(regressor @ kernels.inertial_parameters - tau[:FEW]).max() < 1e-10 * size
    moved = by_motors.inverse_dynamics(lengths[:FEW], rates[:FEW], a[:, chain.motor_index])
    assert np.abs(moved - tau[:FEW]).max() < 1e-10 * size
    assert np.isnan(by_motors.inverse_dynamics(far, rates, sped)[::64]).all()
    assert np.abs(back - acceleration).max() < 1e-9
    assert np.abs(lengths - stp.leg_lengths(hexapod, pose[:, :3], rotation)).max() < 1e-14
    assert np.abs(found_pose - pose).max() < 1e-12
    assert np.abs(kernels.forward_kinematics(lengths, farther) - pose).max() < 1e-14
    error = np.abs(half_kernels.inverse_dynamics(*half) - tau).max() / size
    print(f"float32: largest error {error:.1e} of the largest force")
    found: dict[str, Way] = {
        "Pinocchio from Python, lean": (lambda: lean_pinocchio(chain, q, v, a), FEW),
        "stp.inverse_dynamics": (verb, FEW),
        "MuJoCo mj_inverse (no motor forces)": (mujoco_inverse, FEW),
        "NumPy closed form": (closed_form, N),
        "kernel, float64": (lambda: kernels.inverse_dynamics(pose, twist, acceleration), N),
        "kernel, float64, out=": (lambda: inverse(pose, twist, acceleration, out=out), N),
        "the same with status and conditioning": (
            lambda: inverse(pose, twist, acceleration, out=out, status=status, conditioning=conditioning),
            N,
        ),
        "kernel, out=, 16 times as many states": (lambda: inverse(*many, out=room), len(room)),
        "the same on 2 threads": (lambda: inverse(*many, out=room, threads=2), len(room)),
        "kernel, float32": (lambda: half_kernels.inverse_dynamics(*half), N),
        "kernel, array of one state": (lambda: [inverse(*short, out=out[:1]) for _ in range(FEW)], FEW),
        "kernel, single state, arrays given": (lambda: [one(*first) for _ in range(FEW)], FEW),
        "kernel, single state, in place": (lambda: [one.run() for _ in range(FEW)], FEW),
        "forward kinematics, array of one state": (
            lambda: [kernels.forward_kinematics(lengths[:1], home) for _ in range(FEW)],
            FEW,
        ),
        "forward kinematics, single state": (lambda: [pose_of(lengths[0], home) for _ in range(FEW)], FEW),
        "motor coordinates, array of one state": (
            lambda: [by_motors.inverse_dynamics(lengths[:1], rates[:1], sped[:1]) for _ in range(FEW)],
            FEW,
        ),
        "motor coordinates, single state": (
            lambda: [held(lengths[0], rates[0], sped[0]) for _ in range(FEW)],
            FEW,
        ),
        "forward dynamics": (lambda: kernels.forward_dynamics(pose, twist, tau), N),
        "loop reactions": (lambda: kernels.reactions(pose, twist, acceleration), N),
        "regressor": (lambda: kernels.regressor(pose, twist, acceleration), N),
        "regressor, out=": (lambda: kernels.regressor(pose, twist, acceleration, out=wide), N),
        "six lengths": (lambda: kernels.inverse_kinematics(pose), N),
        "forward kinematics, from home": (lambda: kernels.forward_kinematics(lengths, home), N),
        "forward kinematics, 5 cm beside": (lambda: kernels.forward_kinematics(lengths, farther), N),
        "forward kinematics, 1 cm beside": (lambda: kernels.forward_kinematics(lengths, near), N),
        "inverse dynamics, motor coordinates": (lambda: by_motors.inverse_dynamics(lengths, rates, sped), N),
        "forward dynamics, motor coordinates": (lambda: by_motors.forward_dynamics(lengths, rates, tau), N),
        "the same, 1 in 64 out of reach": (lambda: by_motors.forward_dynamics(far, rates, tau), N),
    }
    return found, seconds


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--robot", default="stewart", help="a six-legged platform")
    options = parser.parse_args()
    found, seconds = ways(stp.load(options.robot))
    print(", ".join(f"{name} {value:.2f} s" for name, value in seconds.items()))
    times: dict[str, list[float]] = {name: [] for name in found}
    for _ in range(options.rounds):
        for name, (call, states) in found.items():
            repeats = 1 if states * 1e-6 > 1e-3 else 4
            call()  # what the way before has left in the caches does not count
            start = time.perf_counter()
            for _ in range(repeats):
                call()
            times[name].append((time.perf_counter() - start) / (repeats * states))
    base = next(iter(times.values()))
    print(f"{'':38s} {'median [ns]':>12} {'best [ns]':>12} {'ratio':>8} {'of best':>8}")
    for name, values in times.items():
        ratio = median(b / x for b, x in zip(base, values, strict=True))
        of_best = min(base) / min(values)
        print(
            f"{name:38s} {1e9 * median(values):>12.1f} {1e9 * min(values):>12.1f} {ratio:>8.1f} {of_best:>8.1f}"
        )


if __name__ == "__main__":
    main()
