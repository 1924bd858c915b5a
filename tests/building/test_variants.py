"""The same mechanism with other masses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MechanismError, UnsupportedError
from tests.small_urdf import ARM, joint, link, robot, write


def masses(chain: stp.ClosedChain) -> dict[str, float]:
    return {link.name: link.inertia.mass for link in chain.mechanism.links if link.inertia is not None}


def test_massless_legs_keep_ground_and_platform() -> None:
    chain = stp.load("stewart")
    light = stp.massless_legs(chain)
    assert {name for name, mass in masses(light).items() if mass} == {"base", "platform"}
    assert masses(light).keys() == masses(chain).keys()
    assert masses(chain)["leg1_lower"] == 2.0  # the first chain is as it was
    assert chain.model.inertias[chain.model.getJointId("leg1")].mass == 1.5
    assert light.model.inertias[light.model.getJointId("leg1")].mass == 0.0
    np.testing.assert_array_equal(light.q_home, chain.q_home)
    assert (light.motors, light.platform, light.nc) == (chain.motors, chain.platform, chain.nc)
    np.testing.assert_array_equal(light.gravity, chain.gravity)


def test_a_point_platform_is_a_point_at_the_platform_frame() -> None:
    chain = stp.load("stewart_s1")  # whose platform has its centre of mass elsewhere
    point = stp.massless_legs(chain, point_platform=True).mechanism.link("platform").inertia
    assert point.mass == 2000.0 and not point.lever.any() and not point.inertia.any()


PARTS = (
    link("plate", ""),
    link("neck", ""),
    link("payload"),
    link("foot"),
    joint("bolt", "arm", "neck", "fixed", origin='xyz="0 0 1" rpy="0 0.5 0"', axis=""),
    joint("nut", "neck", "plate", "fixed", origin='xyz="0.5 0 1" rpy="0.7 0 0.1"', axis=""),
    joint("strap", "neck", "payload", "fixed", origin='xyz="1 2 3" rpy="0.3 0 0"', axis=""),
    joint("anchor", "base", "foot", "fixed", axis=""),
)


def test_what_is_fixed_to_ground_and_platform_keeps_its_mass(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM, *PARTS)), platform="plate")
    light = stp.massless_legs(chain)
    # The plate itself has no inertia; arm and payload are bolted to it, the foot to the ground.
    assert {name for name, mass in masses(light).items() if mass} == {"base", "foot", "arm", "payload"}


def test_a_point_platform_gathers_what_is_fixed_to_it(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM, *PARTS)), platform="plate")
    light = stp.massless_legs(chain, point_platform=True)
    carrier = light.model.frames[light.platform_id].parentJoint
    assert light.model.inertias[carrier].mass == 2.0
    # The whole joint carries one point: at the origin of the platform frame.
    data = light.model.createData()
    pin.framesForwardKinematics(light.model, data, light.q_home)
    at = data.oMi[carrier].act(light.model.inertias[carrier].lever)
    np.testing.assert_allclose(at, data.oMf[light.platform_id].translation, atol=1e-15)
    np.testing.assert_allclose(light.model.inertias[carrier].inertia, 0.0, atol=1e-15)


def test_a_platform_without_mass_cannot_be_a_point(tmp_path: Path) -> None:
    bare = (link("tip", ""), joint("wrist", "platform", "tip"))
    chain = stp.load(write(tmp_path, robot(*ARM, *bare)), platform="tip")
    with pytest.raises(UnsupportedError, match="platform 'tip' has no <inertial>"):
        stp.massless_legs(chain, point_platform=True)


def test_replaced_inertias_reach_the_model() -> None:
    heavy = pin.Inertia(7.0, np.array([0.1, 0, 0]), np.eye(3))
    chain = stp.build.replace_inertias(stp.load("stewart"), {"leg2_lower": heavy})
    assert chain.mechanism.link("leg2_lower").inertia.mass == 7.0
    assert pin.computeTotalMass(chain.model) == pytest.approx(20 + 6 * 3.5 + 5, rel=1e-15)


@pytest.mark.parametrize(
    ("inertias", "error", "words"),
    [
        ({"leg9": pin.Inertia.Zero()}, InputError, "'leg9' is no body; the bodies are: base, platform, leg1_lower"),
        ({"leg1_cross": pin.Inertia.Zero()}, InputError, "'leg1_cross' is no body"),
        ({"platform": 3.0}, InputError, r"inertias\['platform'\] must be a pinocchio.Inertia, got float"),
        ({"platform": pin.Inertia(-1.0, np.zeros(3), np.eye(3))}, MechanismError, "negative mass -1 kg"),
    ],
)  # fmt: skip
def test_bad_inertias_are_named(inertias: dict, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        stp.build.replace_inertias(stp.load("stewart"), inertias)
