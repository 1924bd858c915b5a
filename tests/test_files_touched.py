"""Short questions stay short: in how many files of the package code runs while one is answered."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np
import pinocchio as pin

import stewart_pin as stp

PACKAGE = str(Path(stp.__file__).parent)


def files_touched(call: Callable[[], object]) -> set[str]:
    """List the files of the package in which a frame runs during a call; what an import runs does not count."""
    touched: set[str] = set()
    importing: list[FrameType] = []

    def look(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_name == "<module>":
            importing.append(frame)
        elif event == "return" and importing and frame is importing[-1]:
            importing.pop()
        elif event == "call" and not importing:
            touched.add(frame.f_code.co_filename)

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(before)
    return {name for name in touched if name.startswith(PACKAGE)}


def test_inverse_dynamics_of_one_state() -> None:
    chain = stp.load("stewart")
    turned = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.1, 0.0), np.array([0.05, 0.0, 1.0]))
    moving = stp.platform_motion(chain, turned, 0.1 * np.ones(6), np.ones(6))
    q, v, a = moving.q, moving.v, moving.a
    stp.inverse_dynamics(chain, q, v, a)  # finds the ranks of the chain
    touched = files_touched(lambda: stp.inverse_dynamics(chain, q, v, a))
    assert len(touched) <= 4, sorted(touched)


def test_first_call_of_a_kernel() -> None:
    # A weight of its own, lest another test has made the program already.
    kernels = stp.compile_kernels(stp.load("stewart", gravity=(0.0, 0.0, -9.8125)))
    pose, rest = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 6))
    touched = files_touched(lambda: kernels.inverse_dynamics(pose, rest, rest))
    assert len(touched) <= 25, sorted(touched)


def test_loading() -> None:
    stp.load("stewart")  # finds the dialects of loops
    touched = files_touched(lambda: stp.load("stewart"))
    assert len(touched) <= 25, sorted(touched)
