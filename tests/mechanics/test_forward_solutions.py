"""Many starts find what closed forms say there is, and never claim to have found all."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.kernels.everywhere import Mechanism
from tests.mechanisms import four_bar


def test_four_bar_closes_in_two_ways() -> None:
    # A crank angle leaves two triangles: the coupler pin is where two circles meet, on either side of their line.
    chain = four_bar()
    crank = stp.motor_positions(chain, chain.q_home)
    found = stp.forward_kinematics(chain, crank, all=True)
    assert isinstance(found, stp.loops.ForwardSolutions) and not found.complete
    assert len(found.closures) == 2 and sum(found.hits) <= found.starts
    assert found.missed_share == 0.0
    for closure in found.closures:
        assert np.abs(stp.loop_gap(chain, closure.q)).max() < 1e-12
        np.testing.assert_allclose(stp.motor_positions(chain, closure.q), crank, atol=1e-12)
    apart = found.poses[0].translation - found.poses[1].translation
    turned = np.abs(found.poses[0].rotation - found.poses[1].rotation).max()
    assert np.linalg.norm(apart) + turned > 1e-3


def test_platform_is_found_at_home_and_elsewhere() -> None:
    chain = stp.load("stewart_cad")
    lengths = stp.motor_positions(chain, chain.q_home)
    found = stp.loops.all_forward_kinematics(chain, lengths, starts=12)
    home = stp.platform_pose(chain, chain.q_home)
    assert any(pose.isApprox(home, 1e-9) for pose in found.poses)
    hexapod = stp.Hexapod.from_chain(chain)
    modes = stp.assembly_modes(hexapod, lengths)
    for pose in found.poses:
        # Each is one of the complete set that the homotopy finds.
        distance = np.abs(modes.position - pose.translation).max(axis=1)
        turn = np.abs(modes.rotation - pose.rotation).max(axis=(1, 2))
        assert np.min(distance + turn) < 1e-8


def test_without_a_start_there_is_an_error() -> None:
    with pytest.raises(InputError, match="starts must be 1 or more"):
        stp.loops.all_forward_kinematics(four_bar(), [0.0], starts=0)


@pytest.mark.parametrize(
    ("name", "asked"), [("delta", [1.0, 2.0, 1.2]), ("planetary_gear", [10.0]), ("screw_jack", [1.0])]
)
def test_motors_stand_where_they_were_asked_to(name: str, asked: list[float]) -> None:
    """Beyond their limits and a half turn too; gears and threads stay closed, whose whole turns count."""
    chain = Mechanism(name).chain
    found = stp.loops.all_forward_kinematics(chain, asked, starts=20, limits=False)
    assert found.closures
    for closure in found.closures:
        np.testing.assert_allclose(stp.motor_positions(chain, closure.q), asked, rtol=0, atol=1e-12)
        assert np.abs(stp.loop_gap(chain, closure.q)).max() < 1e-12


def test_motors_that_stand_many_turns_away_are_met() -> None:
    chain = Mechanism("five_bar_5r").chain
    few, many = (
        stp.loops.all_forward_kinematics(chain, [x, 0.0], limits=False, starts=20)
        for x in (0.1, 0.1 + 14 * np.pi)
    )
    assert len(few.poses) == len(many.poses) == 2
    for pose in many.poses:
        assert min(np.abs(pose.homogeneous - other.homogeneous).max() for other in few.poses) < 1e-9
