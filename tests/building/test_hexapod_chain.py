"""Six-legged platforms built from twelve points: where they stand at home, and what is refused."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MechanismError

BODIES = {
    "platform": pin.Inertia(20.0, np.zeros(3), np.diag([1.5, 1.5, 2.8])),
    "lower": pin.Inertia(2.0, np.array([0, 0, 0.2]), np.diag([0.03, 0.03, 0.002])),
    "upper": pin.Inertia(1.5, np.array([0, 0, -0.2]), np.diag([0.02, 0.02, 0.001])),
}


@pytest.mark.parametrize(("lower_joint", "per_leg"), [("universal", 3), ("spherical", 4)])
def test_joints_of_a_leg(lower_joint: str, per_leg: int, report_ideal: stp.Hexapod) -> None:
    chain = stp.hexapod_chain(report_ideal, **BODIES, lower_joint=lower_joint)
    assert (chain.nv, chain.nu, chain.nc) == (6 + 6 * per_leg, 6, 18)
    assert chain.motors == tuple(f"leg{k}" for k in range(1, 7))
    assert str(chain.report) == "nothing was ignored"


@pytest.mark.parametrize("lower_joint", ["universal", "spherical"])
def test_motor_coordinates_are_leg_lengths(lower_joint: str, rng: np.random.Generator) -> None:
    for _ in range(5):
        hexapod = stp.Hexapod(*(rng.uniform(-1, 1, (2, 6, 3)) * [1, 1, 0.1]))
        home = pin.SE3(pin.exp3(rng.uniform(-0.3, 0.3, 3)), rng.uniform(-0.3, 0.3, 3) + [0, 0, 2.5])
        chain = stp.hexapod_chain(hexapod, **BODIES, lower_joint=lower_joint, home=home)
        np.testing.assert_allclose(
            stp.platform_pose(chain, chain.q_home).homogeneous, home.homogeneous, atol=1e-14
        )
        np.testing.assert_allclose(
            stp.motor_positions(chain, chain.q_home),
            stp.leg_lengths(hexapod, home.translation, home.rotation),
            rtol=1e-14,
        )
        again = stp.Hexapod.from_chain(chain)
        np.testing.assert_array_equal(again.base_points, hexapod.base_points)
        np.testing.assert_array_equal(again.platform_points, hexapod.platform_points)


def test_home_stands_in_the_middle_of_the_stroke(report_ideal: stp.Hexapod, report_cad: stp.Hexapod) -> None:
    for hexapod, stroke in ((report_ideal, (0.5, 1.8)), (report_cad, (2.20147, 2.70147))):
        chain = stp.hexapod_chain(hexapod, **BODIES, stroke=stroke)
        lengths = stp.motor_positions(chain, chain.q_home)
        assert lengths.mean() == pytest.approx(sum(stroke) / 2, rel=0.02)
        assert stp.platform_pose(chain, chain.q_home).translation[2] > 0


def test_home_without_a_stroke_is_above_the_base(report_ideal: stp.Hexapod) -> None:
    chain = stp.hexapod_chain(report_ideal, **BODIES)
    assert 0.5 < stp.platform_pose(chain, chain.q_home).translation[2] < 3
    assert chain.mechanism.joint("leg1").upper == np.inf


def test_a_hanging_platform_is_within_the_swing_of_its_legs(report_ideal: stp.Hexapod) -> None:
    hanging = pin.SE3(np.eye(3), np.array([0.1, -0.1, -1.0]))
    chain = stp.hexapod_chain(report_ideal, **BODIES, home=hanging)
    np.testing.assert_allclose(
        stp.platform_pose(chain, chain.q_home).homogeneous, hanging.homogeneous, atol=1e-14
    )
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    assert (chain.q_home >= lower).all() and (chain.q_home <= upper).all()
    assert (stp.motor_positions(chain, chain.q_home) > 0).all()


def test_a_home_beyond_the_stroke_is_an_error(report_ideal: stp.Hexapod) -> None:
    high = pin.SE3(np.eye(3), np.array([0, 0, 3.0]))
    with pytest.raises(
        MechanismError, match=r"joint 'leg1' would stand at 3.*beyond its limits 0\.5 to 1\.8"
    ):
        stp.hexapod_chain(report_ideal, **BODIES, stroke=(0.5, 1.8), home=high)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lower_joint": "ball"}, "'universal' or 'spherical', got 'ball'"),
        ({"stroke": (1.0, 1.0)}, "least < greatest"),
        ({"stroke": (-1.0, 1.0)}, "0 <= least"),
        ({"stroke": (0.5, float("nan"))}, "stroke must be"),
        ({"stroke": 5.0}, "stroke must be"),
        ({"stroke": ("a", "b")}, "stroke must be"),
        ({"stroke": (1, 2, 3)}, "stroke must be"),
        ({"home": np.eye(3)}, "home must be a pinocchio.SE3"),
        ({"home": pin.SE3(np.diag([1.0, 1, 2]), np.zeros(3))}, "rotation"),
        ({"platform": 20.0}, "platform must be a pinocchio.Inertia, got float"),
        ({"lower": None}, "lower must be a pinocchio.Inertia"),
        ({"base": 3}, "base must be a pinocchio.Inertia"),
        ({"gravity": 9.81}, "gravity must have shape"),
    ],
)
def test_bad_arguments_are_named(report_ideal: stp.Hexapod, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.hexapod_chain(report_ideal, **BODIES | options)


@pytest.mark.parametrize("option", ["effort", "velocity"])
@pytest.mark.parametrize("value", [-1.0, float("nan")])
def test_bad_limits_are_named(report_ideal: stp.Hexapod, option: str, value: float) -> None:
    with pytest.raises(MechanismError, match=f"joint 'leg1' has the {option} limit"):
        stp.hexapod_chain(report_ideal, **BODIES, **{option: value})


def test_a_leg_without_length_is_an_error(report_ideal: stp.Hexapod) -> None:
    flat = stp.Hexapod(report_ideal.base_points, report_ideal.base_points)
    with pytest.raises(InputError, match="leg1 has no length at home"):
        stp.hexapod_chain(flat, **BODIES, home=pin.SE3.Identity())
    with pytest.raises(InputError, match="leg1 has no length at home"):
        stp.hexapod_chain(stp.Hexapod(np.zeros((6, 3)), np.zeros((6, 3))), **BODIES)
