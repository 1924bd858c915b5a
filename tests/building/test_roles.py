"""The same mechanism with other motors, another platform, or a payload."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MechanismError
from tests.building.test_round_trip import assert_same
from tests.closed_states import NAMES, close, random_configuration, random_motion, robot

PLACED = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.05, -0.1, 0.2]))
BOX = pin.Inertia(3.0, np.array([0.02, 0.01, -0.03]), np.diag([0.03, 0.04, 0.05]))


def test_other_motors_do_the_same_work(rng: np.random.Generator) -> None:
    """Whatever joints drive it, the same motion takes the same power."""
    chain = robot("five_bar")
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    powers = []
    for motors in (["left_hip", "right_hip"], ["right_knee", "left_hip"], ["left_hip", "left_knee"]):
        driven = stp.with_motors(chain, motors)
        assert driven.motors == tuple(motors) and driven.platform == chain.platform
        np.testing.assert_array_equal(driven.q_home, chain.q_home)
        powers.append(stp.inverse_dynamics(driven, q, v, a).tau_motor @ v[driven.motor_index])
    close(np.array(powers[1:]), np.full(2, powers[0]), 1e-11)


def test_bad_motors_are_named() -> None:
    with pytest.raises(
        MechanismError, match=r"motors name the joint 'hip', .* candidates are: left_hip, left_knee"
    ):
        stp.with_motors(robot("five_bar"), ["hip"])
    with pytest.raises(MechanismError, match="'platform_pose', which is missing or has not one freedom"):
        stp.with_motors(robot("stewart"), ["platform_pose"])
    with pytest.raises(InputError, match="twice"):
        stp.with_motors(robot("five_bar"), ["left_hip", "left_hip"])


@pytest.mark.parametrize("name", NAMES)
def test_a_frame_on_the_platform(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    moved = stp.with_platform(chain, chain.platform, placement=PLACED, name="tool")
    assert (moved.platform, moved.motors, moved.nv, moved.nc) == ("tool", chain.motors, chain.nv, chain.nc)
    q = random_configuration(chain, rng)
    pose = stp.platform_pose(chain, q)
    np.testing.assert_allclose(
        stp.platform_pose(moved, q).homogeneous, (pose * PLACED).homogeneous, atol=1e-14 * 30
    )
    # The same efforts: the platform decides what is idle, not what is heavy.
    v, a = random_motion(chain, rng, q)
    for method in ("pinocchio", "constraint_matrix"):
        one, two = (stp.inverse_dynamics(x, q, v, a, method=method).tau_motor for x in (chain, moved))
        close(two, one, 1e-11)


def test_motor_jacobian_of_a_moved_frame(rng: np.random.Generator) -> None:
    """Motor rates do not change; the twist at the new origin is v + ω × r."""
    chain = robot("stewart")
    moved = stp.with_platform(chain, "platform", placement=PLACED)
    assert moved.platform == "platform_frame"
    q = random_configuration(chain, rng)
    arm = stp.platform_pose(chain, q).rotation @ PLACED.translation
    twist = rng.normal(size=6)
    there = np.concatenate([twist[:3] + np.cross(twist[3:], arm), twist[3:]])
    close(stp.motor_jacobian(moved, q) @ there, stp.motor_jacobian(chain, q) @ twist, 1e-12)


def test_another_link_as_platform(rng: np.random.Generator) -> None:
    chain = stp.with_platform(robot("stewart"), "leg2_upper")
    q = random_configuration(chain, rng)
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    expected = data.oMf[chain.model.getFrameId("leg2_upper", pin.FrameType.BODY)]
    np.testing.assert_array_equal(stp.platform_pose(chain, q).homogeneous, expected.homogeneous)
    assert stp.mobility(chain).motors_sufficient


def test_bad_platforms_are_named() -> None:
    chain = robot("stewart")
    with pytest.raises(
        InputError, match="link 'hand' is no link of stewart; the links are: base, platform, leg1_cross"
    ):
        stp.with_platform(chain, "hand")
    with pytest.raises(MechanismError, match="there is no moving link 'base'"):
        stp.with_platform(chain, "base")
    with pytest.raises(InputError, match="name 'leg1_upper' is taken in stewart"):
        stp.with_platform(chain, "platform", placement=PLACED, name="leg1_upper")
    with pytest.raises(InputError, match="name 'tool' needs a placement="):
        stp.with_platform(chain, "platform", name="tool")
    with pytest.raises(InputError, match=r"placement must be a pinocchio\.SE3"):
        stp.with_platform(chain, "platform", placement=np.eye(3))


@pytest.mark.parametrize(
    ("name", "link", "carrier"),
    [
        ("stewart", None, "platform"),
        ("stewart", "leg4_upper", "leg4_upper"),
        ("delta", None, "platform"),
        ("arm_7r", "link5", "link5"),
        ("rpr_planar", "leg1_lower", "leg1_lower"),
    ],
)
def test_a_payload_is_inertia_added_by_hand(name: str, link, carrier: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    loaded = stp.attach_payload(chain, BOX, link=link, placement=PLACED)
    sum_of_both = chain.mechanism.link(carrier).inertia + PLACED.act(BOX)
    by_hand = stp.build.replace_inertias(chain, {carrier: sum_of_both})
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    for method in ("pinocchio", "constraint_matrix"):
        one, two = (stp.inverse_dynamics(x, q, v, a, method=method).tau_motor for x in (by_hand, loaded))
        close(two, one, 1e-10)
    tau = rng.normal(size=chain.nu)
    close(stp.forward_dynamics(loaded, q, v, tau).a, stp.forward_dynamics(by_hand, q, v, tau).a, 1e-10)
    assert pin.computeTotalMass(loaded.model) == pytest.approx(
        pin.computeTotalMass(chain.model) + 3.0, rel=1e-14
    )


def test_a_payload_on_a_link_without_inertia(rng: np.random.Generator) -> None:
    """The tool frame of the four-bar sits on the coupler, half-way along it."""
    chain = robot("four_bar")
    loaded = stp.attach_payload(chain, BOX, placement=PLACED)
    at = pin.SE3(np.eye(3), np.array([0.06, 0, 0])) * PLACED
    by_hand = stp.build.replace_inertias(
        chain, {"coupler": chain.mechanism.link("coupler").inertia + at.act(BOX)}
    )
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    one, two = (stp.inverse_dynamics(x, q, v, a).tau_motor for x in (by_hand, loaded))
    close(two, one, 1e-12)


def test_a_payload_stays_when_the_legs_lose_their_mass() -> None:
    light = stp.massless_legs(stp.attach_payload(robot("stewart"), BOX))
    assert pin.computeTotalMass(light.model) == pytest.approx(20.0 + 3.0, rel=1e-15)


def test_payloads_add_up() -> None:
    twice = stp.attach_payload(stp.attach_payload(robot("stewart"), BOX), BOX, name="second")
    assert pin.computeTotalMass(twice.model) == pytest.approx(
        pin.computeTotalMass(robot("stewart").model) + 6.0
    )


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"inertia": 3.0}, InputError, r"inertia must be a pinocchio\.Inertia, got float"),
        (
            {"inertia": pin.Inertia(-1.0, np.zeros(3), np.eye(3))},
            MechanismError,
            "'payload' has the negative mass -1",
        ),
        ({"inertia": BOX, "link": "hand"}, InputError, "link 'hand' is no link of stewart"),
        ({"inertia": BOX, "name": "platform"}, InputError, "name 'platform' is taken"),
        ({"inertia": BOX, "name": ""}, InputError, "name '' is empty"),
        ({"inertia": BOX, "placement": 1}, InputError, r"placement must be a pinocchio\.SE3"),
    ],
)
def test_bad_payloads_are_named(arguments: dict, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        stp.attach_payload(robot("stewart"), **arguments)


@pytest.mark.parametrize(
    "variant",
    [
        lambda chain: stp.with_motors(chain, ["leg2", "leg1", "leg6", "leg5", "leg4", "leg3"]),
        lambda chain: stp.with_platform(chain, "leg2_upper"),
        lambda chain: stp.with_platform(chain, "platform", placement=PLACED, name="tool"),
        lambda chain: stp.attach_payload(chain, BOX, placement=PLACED),
        lambda chain: stp.attach_payload(stp.lock_joints(chain, ["leg1", "leg2_x"]), BOX, link="leg3_lower"),
    ],
)
def test_files_keep_the_variant(variant, tmp_path: Path) -> None:
    chain = variant(robot("stewart"))
    stp.write_urdf(chain, tmp_path / "variant.urdf")
    assert_same(chain, stp.load(tmp_path / "variant.urdf"))
