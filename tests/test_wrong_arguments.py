"""Arguments of the wrong kind end in an error that names them, not in one that fell through."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.closed_states import robot

Ask = Callable[[stp.ClosedChain], Any]
REST = np.zeros(3)


def still(times: int, poses: int) -> stp.motions.PlatformSamples:
    place = np.zeros((poses, 3)), np.tile(np.eye(3), (poses, 1, 1))
    return stp.motions.PlatformSamples(np.arange(float(times)), *place, *np.zeros((2, poses, 6)))


CALLS: tuple[tuple[Ask, str], ...] = (
    (lambda c: stp.close_loops(c, c.q_home, max_iterations="many"), "max_iterations must be a whole number"),  # pyright: ignore[reportArgumentType]
    (
        lambda c: stp.loops.all_forward_kinematics(c, [0.0], starts=None),
        "starts must be a whole number, 1 or more",
    ),  # pyright: ignore[reportArgumentType]
    (
        lambda c: stp.singularities.find_singularity(c, lambda t: c.q_home, interval=(0, 1), samples=2.5),  # pyright: ignore[reportArgumentType]
        "samples must be a whole number, 2 or more",
    ),
    (
        lambda c: stp.natural_frequencies(c, c.q_home, motor_stiffness=[]),
        r"motor_stiffness must be a number or have shape \(1,\), got \(0,\)",
    ),
    (
        lambda c: stp.natural_frequencies(c, c.q_home, motor_stiffness="stiff"),  # pyright: ignore[reportArgumentType]
        "motor_stiffness must be a number or have shape",
    ),
    (
        lambda c: stp.joint_reactions(c, c.q_home, REST, np.zeros(1)),  # pyright: ignore[reportArgumentType]
        "effort must be what inverse_dynamics answers, got ndarray",
    ),
    (
        lambda c: stp.build.replace_inertias(c, None),
        "inertias must give an inertia to each name, got NoneType",
    ),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.build.displace_geometry(c, [1.0]), "displacements must give an amount to each parameter"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.motor_demand(c, c.q_home), "samples must be PlatformSamples"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.compare_methods(c, None), "samples must be PlatformSamples"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.fit_to_limits(c, None), "motion must be a function of a scale, got NoneType"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.fit_to_limits(c, lambda k: k, margin="0.1"), "margin must be at least 0 and below 1"),  # pyright: ignore[reportArgumentType]
    (
        lambda c: stp.simulate(c, c.q_home, REST, duration=0.1, motors="strong"),  # pyright: ignore[reportArgumentType]
        "motors must be Motors, got str",
    ),
    (lambda c: stp.control.LegPID(c, lambda t: t, kp="high"), "kp must be a number or have shape"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.control.LegPID(c, lambda t: t, kd=-1.0), "kd must be 0 or more"),  # pyright: ignore[reportArgumentType]
    (
        lambda c: stp.control.LegPID(c, still(2, 2)),
        "reference must be a function of instants .*spline_motion",
    ),  # pyright: ignore[reportArgumentType]
    (
        lambda c: stp.control.Feedforward(c, still(2, 2)),
        "reference must be a function .* got PlatformSamples",
    ),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.control.ComputedTorque(c, still(2, 2)), "reference must be a function of instants"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.control.GravityCompensation("c"), "must be a ClosedChain .* got str"),  # pyright: ignore[reportArgumentType]
    (lambda c: stp.control.SampledController("c", None), "must be a ClosedChain .* got str"),  # pyright: ignore[reportArgumentType]
    (lambda c: still(3, 2), r"position must have shape \(3, 3\), one row for each of 3 times, got \(2, 3\)"),
)


@pytest.mark.parametrize(("ask", "message"), CALLS, ids=[message[:30] for _, message in CALLS])
def test_they_are_named(ask: Ask, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ask(robot("four_bar"))


def test_those_of_kernels_as_well() -> None:
    kernels = stp.compile_kernels(robot("four_bar"), coordinates="motor", engine="numpy")
    with pytest.raises(InputError, match="must be an array of numbers, got str"):
        kernels.inverse_dynamics("home", [0.0], [0.0])  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    "ask",
    [
        lambda c: stp.planar_assembly_modes(c, np.ones(3)),
        lambda c: stp.planar.planar_leg_lengths(c, np.zeros(2), 0.0),
        lambda c: stp.planar.planar_transition_lengths(c, np.ones(3), 0),
    ],
)
def test_closed_forms_of_planar_platforms_name_what_takes_a_chain(ask: Ask) -> None:
    chain = robot("rpr_planar")
    with pytest.raises(
        InputError, match=r"takes a PlanarRPR, got ClosedChain; .* use planar\.planar_rpr\(chain\)"
    ):
        ask(chain)
    assert isinstance(stp.planar.planar_rpr(chain), stp.PlanarRPR)
