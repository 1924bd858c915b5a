"""A motor that counts down, or from another zero, tells the same demand in its own coordinate."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.studies.comparison import spread
from tests.rewritten import rebuild


def plain_and_told(zero):
    chain = stp.load("stewart")
    old = chain.described()

    def told(joint):
        if joint.name not in chain.motors:
            return joint
        ahead = pin.SE3(np.eye(3), zero * joint.axis)
        return replace(
            joint, placement=joint.placement * ahead, axis=-joint.axis,
            lower=zero - joint.upper, upper=zero - joint.lower,
        )  # fmt: skip

    home = {name: zero - q if name in chain.motors else q for name, q in old.home.items()}
    return chain, rebuild(chain, replace(old, joints=tuple(map(told, old.joints)), home=home))


def sway(chain, times):
    pose = stp.platform_pose(chain, chain.q_home)
    return stp.motions.sinusoidal_motion(times, home=pose, amplitude=(0.01, 0, 0.02), frequency=(1, 1, 1))


@pytest.mark.parametrize("zero", [0.0, 0.15])
def test_demand_of_reversed_and_shifted_motors(zero):
    chain, other = plain_and_told(zero)
    samples = sway(chain, np.linspace(0, 1, 9))
    plain, got = (stp.motor_demand(c, samples, kernels=False) for c in (chain, other))
    # Round-off of the same formulas: 1e-9 of 100 N and 1 m.
    np.testing.assert_allclose(got.positions, zero - plain.positions, atol=1e-11)
    np.testing.assert_allclose(got.rates, -plain.rates, atol=1e-11)
    np.testing.assert_allclose(got.efforts, -plain.efforts, atol=1e-7)


@pytest.mark.parametrize("zero", [0.0, 0.15])
@pytest.mark.parametrize(
    ("make", "options"),
    [
        (stp.control.Feedforward, {}),
        (stp.control.Feedforward, {"model": "point_mass"}),
        (stp.control.ComputedTorque, {"model": "point_mass"}),
        (stp.control.LegPID, {}),
    ],
)
def test_control_of_reversed_and_shifted_motors(zero, make, options):
    chain, other = plain_and_told(zero)
    efforts = []
    for told in (chain, other):
        controller = make(told, lambda t: sway(chain, t), **options)
        q, v = told.q_home, np.zeros(told.nv)
        part = (controller.initial_state(),) if hasattr(controller, "initial_state") else ()
        efforts.append(controller(0.1, q, v, *part))
    # Gains of 2e5 N/m on lengths of a metre that carry round-off.
    np.testing.assert_allclose(efforts[1], -efforts[0], atol=1e-6)


def test_methods_agree_on_reversed_motors():
    chain, other = plain_and_told(0.15)
    compared = stp.compare_methods(other, sway(chain, np.linspace(0, 1, 5)))
    # Independent formulations of the same forces: round-off only.
    assert spread(compared.forces) < 1e-9
    assert spread(compared.simplified) < 1e-9


def test_assembly_modes_take_what_motors_read() -> None:
    """A chain whose motors count down from a zero elsewhere has the modes of its geometry at the same lengths."""
    chain = stp.load("stewart")
    _, told = plain_and_told(0.15)
    lengths = stp.motor_positions(chain, chain.q_home)
    right = stp.assembly_modes(chain, lengths, engine="numpy")
    readings = stp.motor_positions(told, told.q_home)
    found = stp.assembly_modes(told, readings, engine="numpy")
    assert len(found) == len(right) > 0
    np.testing.assert_allclose(np.sort(found.position[:, 2]), np.sort(right.position[:, 2]), atol=1e-9)
    with pytest.raises(stp.errors.InputError, match=r"from_chain"):
        stp.leg_lengths(chain, np.array([0, 0, 1.0]), np.eye(3))  # pyright: ignore[reportArgumentType]
