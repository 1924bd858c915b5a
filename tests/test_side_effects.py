"""A call leaves the process as it found it: warnings, logging, settings, threads, signals, folder, environment."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import logging, os, random, signal, sys, tempfile, warnings
import numpy as np
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import casadi, llvmlite, mujoco, numba, pinocchio, proxsuite, scipy.linalg, scipy.optimize, yourdfpy
from threadpoolctl import threadpool_info

def settings():
    return {
        "errors of numpy": np.geterr(),
        "printing of numpy": np.get_printoptions(),
        "random numbers of numpy": hash(np.random.get_state()[1].tobytes()),
        "random numbers": hash(random.getstate()),
        "warnings": [repr(f) for f in warnings.filters],
        "loggers": {n: (l.level, len(l.handlers)) for n, l in logging.root.manager.loggerDict.items()
                    if isinstance(l, logging.Logger) and (l.level or l.handlers)},
        "root logger": (logging.root.level, len(logging.root.handlers)),
        "folder": os.getcwd(),
        "environment": dict(os.environ),
        "signals": {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)},
        "threads of BLAS": sorted((i["filepath"], i["num_threads"]) for i in threadpool_info()),
        "style of plots": {k: v for k, v in matplotlib.rcParams.items() if k != "backend"},
        "hooks": (sys.excepthook, sys.displayhook, sys.getrecursionlimit()),
        "figures": plt.get_fignums(),
    }

before = settings()
import stewart_pin as stp
chain = stp.load("stewart")
folder = tempfile.mkdtemp()
home, rest, ramp = stp.platform_pose(chain, chain.q_home), np.zeros(6), np.ones(6)
pose = np.array([[0, 0, 1.0, 0, 0, 0, 1]])

def steps():
    yield "states", lambda: stp.inverse_dynamics(stp.platform_motion(chain, home, rest, ramp))
    yield "singularities", lambda: stp.singularities.classify_singularity(chain, chain.q_home)
    yield "forward kinematics", lambda: stp.forward_kinematics(chain, stp.motor_positions(chain, chain.q_home))
    yield "polytopes", lambda: stp.polytopes.wrench_polytope(chain, chain.q_home)
    yield "modes", lambda: stp.assembly_modes(chain, stp.motor_positions(chain, chain.q_home))
    yield "kernels", lambda: stp.compile_kernels(chain).inverse_kinematics(pose, threads=2)
    yield "simulation", lambda: stp.simulate(chain, chain.q_home, chain.rest, duration=0.02, method="BDF")
    yield "sweep", lambda: stp.sweep(lambda x: x * x, {"x": [1.0, 2.0]})
    yield "files", lambda: [stp.export(chain, f"{folder}/a.xml", format="mjcf"), stp.load(f"{folder}/a.xml")]
    yield "pictures", lambda: plt.close(stp.viz.plot_chain(chain, chain.q_home).figure)
    yield "scenes", lambda: stp.viz.build_scene(chain, chain.q_home)
    def refused():
        try:
            stp.load("no such robot")
        except stp.errors.StewartPinError:
            pass
    yield "refusals", refused

for name, step in steps():
    step()
    after = settings()
    for what in before:
        if before[what] != after[what]:
            print(f"{name} changed {what}: {before[what]!r:.300} -> {after[what]!r:.300}")
    before = after
print("done")
"""


def test_nothing_is_left_changed(tmp_path: Path) -> None:
    answer = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=300, cwd=tmp_path
    )
    assert answer.stdout.splitlines() == ["done"], answer.stdout + answer.stderr
    assert list(tmp_path.iterdir()) == []
