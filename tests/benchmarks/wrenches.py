"""Kernels of a six-legged platform with wrenches from outside beside those without. Run by hand; half a minute.

``OMP_NUM_THREADS=1 python -m tests.benchmarks.wrenches`` calls all in turn in one process, round after round; medians,
and the ratio to the verb without a wrench in the same round. Each is first checked against the verb of one state.
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
    chain, rng = stp.load(options.robot), np.random.default_rng(1)
    pose, twist, acceleration = sample_states(rng, N)
    first = stp.platform_motion(chain, pin.XYZQUATToSE3(pose[0]), twist[0], acceleration[0])
    links = tuple(link.name for link in chain.mechanism.links)
    out, calls, counts = np.empty((N, chain.nu)), {}, {}
    for title, names in (
        ("no wrench", ()),
        ("one on the platform", (chain.platform,)),
        ("one on a leg", links[-1:]),
        ("seven, on platform and legs", (chain.platform, *links[-1 : -3 * chain.nu : -3])),
    ):
        kernels = stp.compile_kernels(chain, wrenches=names)
        loads = (rng.normal(size=(N, 6 * len(names))),) if names else ()
        outside = {name: loads[0][0, 6 * k : 6 * k + 6] for k, name in enumerate(names)}
        for verb, third in (
            ("inverse_dynamics", acceleration),
            ("forward_dynamics", np.zeros((N, chain.nu))),
        ):
            call = getattr(kernels, verb)
            if verb == "inverse_dynamics":
                expected = stp.inverse_dynamics(first, wrenches=outside).tau_motor
                assert (
                    np.abs(call(pose, twist, third, *loads)[0] - expected).max()
                    < 1e-10 * np.abs(expected).max()
                )
            calls[verb, title] = lambda call=call, third=third, loads=loads: call(
                pose, twist, third, *loads, out=out
            )
            counts[verb, title] = count_operations(kernels.casadi(verb))
    times: dict[tuple[str, str], list[float]] = {key: [] for key in calls}
    for _ in range(options.rounds):
        for key, call in calls.items():
            call()  # what the one before has left in the caches does not count
            start = time.perf_counter()
            call()
            times[key].append((time.perf_counter() - start) / N)
    print(f"{'':40s} {'operations':>10} {'median [ns]':>12} {'best [ns]':>10} {'ratio':>7} {'of best':>8}")
    for (verb, title), values in times.items():
        base = times[verb, "no wrench"]
        ratio = median(x / b for b, x in zip(base, values, strict=True))
        print(
            f"{verb + ', ' + title:40s} {counts[verb, title]:>10d} {1e9 * median(values):>12.1f} "
            f"{1e9 * min(values):>10.1f} {ratio:>7.3f} {min(values) / min(base):>8.3f}"
        )


if __name__ == "__main__":
    main()
