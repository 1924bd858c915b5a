"""Freedoms counted, named, and told apart."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind
from tests.closed_states import robot
from tests.mechanisms import arm, five_bar, four_bar, rotary_hexapod, two_bodies
from tests.rewritten import in_other_unit


@pytest.mark.parametrize("name", ["stewart", "stewart_cad", "stewart_s1"])
def test_universal_hexapods(name: str) -> None:
    found = stp.mobility(robot(name))
    assert (found.dof, found.idle, found.redundant_rows, found.motors_sufficient) == (6, (), 0, True)
    assert found.lost == 0 and not found.home_singular


def test_spherical_hexapod() -> None:
    found = stp.mobility(robot("stewart_sps"))
    assert found.dof == 12 and found.motors_sufficient and found.redundant_rows == 0
    assert found.idle == tuple(f"leg {k}: spin about its axis" for k in range(1, 7))


@pytest.mark.parametrize(
    ("kind", "redundant"),
    [(JointKind.SPHERICAL, 1), (JointKind.REVOLUTE, 3), (JointKind.UNIVERSAL, 2), (JointKind.CYLINDRICAL, 2)],
)
def test_planar_four_bar_counts_redundant_rows(kind: JointKind, redundant: int) -> None:
    """Count what Grübler's formula cannot: rows out of the plane are always met."""
    found = stp.mobility(four_bar(kind))
    assert (found.dof, found.redundant_rows, found.motors_sufficient) == (1, redundant, True)
    assert len(found.redundant) == redundant and all(name.startswith("pin row") for name in found.redundant)


def test_too_few_and_too_many_motors() -> None:
    one = stp.mobility(five_bar(("left_hip",)))
    assert (one.dof, one.lost, one.motors_sufficient, one.idle) == (2, 1, False, ())
    assert stp.mobility(five_bar(("left_hip", "right_hip", "left_knee"))).motors_sufficient


def test_serial_arms_have_no_loops(rng: np.random.Generator) -> None:
    for joints in (3, 7):
        found = stp.mobility(arm(rng, joints))
        assert (found.dof, found.idle, found.redundant_rows, found.motors_sufficient) == (joints, (), 0, True)


def test_a_flat_home_is_told_from_a_generic_one() -> None:
    """A parallelogram folded flat has a second freedom there, and only there."""
    chain = four_bar(lengths=(0.3, 0.9, 0.3), ground=0.9)
    q = np.zeros(3)
    assert np.abs(stp.loop_gap(chain, q)).max() <= 1e-15
    flat = stp.ClosedChain(chain.mechanism, chain.model, chain.motors, chain.platform, q)
    found = stp.mobility(flat)
    assert found.dof == 1 and found.home_singular and found.redundant_rows == 1
    assert not stp.mobility(chain).home_singular


def test_a_home_with_lost_freedoms() -> None:
    """Count at a generic configuration also when home is where the legs lose the platform."""
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(pin.exp3(np.array([0, 0, np.pi / 2])) @ home.rotation, home.translation)
    q = stp.inverse_kinematics(chain, pose, limits=False).q
    found = stp.mobility(stp.ClosedChain(chain.mechanism, chain.model, chain.motors, chain.platform, q))
    assert found.home_singular and found.motors_sufficient and found.dof == 6


def test_rods_with_balls_at_both_ends_may_spin() -> None:
    """Six idle freedoms that no motor's joint takes part in: the passive joints are more than the equations."""
    found = stp.mobility(rotary_hexapod())
    assert found.dof == 12 and found.motors_sufficient and found.redundant_rows == 0
    assert found.idle == tuple(f"rod{k}: spin about its axis" for k in range(6))


def test_names_do_not_depend_on_the_unit_of_length(rng: np.random.Generator) -> None:
    for kind in (JointKind.CYLINDRICAL, JointKind.PLANAR, JointKind.DISTANCE):
        chain = two_bodies(kind, rng)
        assert stp.mobility(in_other_unit(chain, 1e3)) == stp.mobility(chain)
