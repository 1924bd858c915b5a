"""Kernels of a six-legged platform with rotors, friction and springs beside those without. Run by hand; half a minute.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.joint_physics`` calls all in turn in one process, round after round;
medians, and the ratio to the verb without in the same round. Each is first checked against the verb of one state.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.kernels.kernels import count_operations
from tests.kernels.hexapod_graph import sample_states

N = 16384


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=101)
    parser.add_argument("--robot", default="stewart", help="a six-legged platform")
    options = parser.parse_args()
    bare, rng = stp.load(options.robot), np.random.default_rng(1)
    pose, twist, acceleration = sample_states(rng, N)
    rotors, spring = {"armature": 2.0, "friction": 11.0}, {"damping": 30.0, "stiffness": 200.0, "rest": 0.8}
    passive = [
        joint.name for joint in bare.mechanism.joints if joint.has_axis and joint.name not in bare.motors
    ]
    out, calls, counts = np.empty((N, bare.nu)), {}, {}
    for title, physics in (
        ("nothing", {}),
        ("armature of motors", {motor: {"armature": 2.0} for motor in bare.motors}),
        ("armature and friction of motors", dict.fromkeys(bare.motors, rotors)),
        ("springs and dampers of motors too", {key: {**rotors, **spring} for key in bare.motors}),
        (
            "all that and damping of hinges",
            {key: {**rotors, **spring} for key in bare.motors} | {key: {"damping": 0.3} for key in passive},
        ),
    ):
        chain = stp.with_joint_physics(bare, physics)
        kernels = stp.compile_kernels(chain)
        assert kernels.by_legs, kernels.report.why_tree
        first = stp.platform_motion(chain, pin.XYZQUATToSE3(pose[0]), twist[0], acceleration[0])
        for verb, third in (
            ("inverse_dynamics", acceleration),
            ("forward_dynamics", np.zeros((N, chain.nu))),
        ):
            call = getattr(kernels, verb)
            if verb == "inverse_dynamics":
                expected = stp.inverse_dynamics(first).tau_motor
                apart = np.abs(call(pose, twist, third)[0] - expected).max()
                assert apart < 1e-10 * np.abs(expected).max()
            calls[verb, title] = lambda call=call, third=third: call(pose, twist, third, out=out)
            counts[verb, title] = count_operations(kernels.casadi(verb))
    times: dict[tuple[str, str], list[float]] = {key: [] for key in calls}
    for _ in range(options.rounds):
        for key, call in calls.items():
            call()  # what the one before has left in the caches does not count
            start = time.perf_counter()
            call()
            times[key].append((time.perf_counter() - start) / N)
    print(f"{'':52s} {'operations':>10} {'median [ns]':>12} {'best [ns]':>10} {'ratio':>7} {'of best':>8}")
    for (verb, title), values in times.items():
        base = times[verb, "nothing"]
        ratio = median(x / b for b, x in zip(base, values, strict=True))
        print(
            f"{verb + ', ' + title:52s} {counts[verb, title]:>10d} {1e9 * median(values):>12.1f} "
            f"{1e9 * min(values):>10.1f} {ratio:>7.3f} {min(values) / min(base):>8.3f}"
        )


if __name__ == "__main__":
    main()
