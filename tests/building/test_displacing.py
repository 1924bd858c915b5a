"""Joints and loops attached elsewhere: the parameters by name, and the chain they give."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import ClosureError, InputError, MechanismError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from tests.closed_states import robot
from tests.mechanisms import ONE, F, P, R, Z, at, body, turned, two_bodies


def named(chain: stp.ClosedChain, text: str) -> stp.build.GeometryParameter:
    return next(p for p in stp.build.geometry_parameters(chain) if str(p) == text)


def test_every_attachment_has_its_parameters() -> None:
    chain = robot("stewart")
    parameters = stp.build.geometry_parameters(chain)
    # Six legs of two hinges and a slide, each closed by one loop: three shifts and three turns of 3 + 2 frames.
    assert len(parameters) == len(set(parameters)) == 6 * (3 + 2) * 6
    assert not any(p.owner == "platform_pose" for p in parameters)
    assert {p.unit for p in parameters if str(p).endswith("shift x in 'base'")} == {"m"}
    assert {p.unit for p in parameters if "turn" in str(p)} == {"rad"}


def test_rods_have_a_length(rng: np.random.Generator) -> None:
    chain = two_bodies(JointKind.DISTANCE, rng)
    rod = named(chain, "loop 'loop': length")
    longer = stp.build.displace_geometry(chain, {rod: 0.01})
    data = pin.Data(longer.model)
    pin.framesForwardKinematics(longer.model, data, longer.q_home)
    loop = chain.loops[0]
    ends = [
        (data.oMf[longer.model.getFrameId(link, pin.FrameType.BODY)] * placement).translation
        for link, placement in ((loop.link1, loop.placement1), (loop.link2, loop.placement2))
    ]
    # Printed lengths, and loops closed to 1e-12.
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(0.41, abs=1e-11)


def test_feet_and_heads_of_a_hexapod_move_along_their_own_axes(rng: np.random.Generator) -> None:
    """The parameters by name against the points that the closed form reads off the chain."""
    chain = robot("stewart")
    before = stp.Hexapod.from_chain(chain)
    loop, joint = chain.loops[1].name, "leg3_x"
    shift, head = rng.uniform(-0.02, 0.02, (2, 3))
    moves = {named(chain, f"joint '{joint}': shift {'xyz'[k]} in 'base'"): shift[k] for k in range(3)}
    frame = 1 if chain.loops[1].link1 == "platform" else 2
    moves |= {
        named(chain, f"loop '{loop}', frame {frame}: shift {'xyz'[k]} in 'platform'"): head[k]
        for k in range(3)
    }
    moved = stp.build.displace_geometry(chain, moves)
    after = stp.Hexapod.from_chain(moved)
    feet, heads = np.zeros((2, 6, 3))
    feet[2], heads[1] = shift, head
    np.testing.assert_allclose(after.base_points - before.base_points, feet, atol=1e-15)
    np.testing.assert_allclose(after.platform_points - before.platform_points, heads, atol=1e-15)
    assert np.abs(stp.loop_gap(moved, moved.q_home)).max() < 1e-12
    assert chain.q_home is robot("stewart").q_home  # nothing has happened to the old one


def test_a_turn_tilts_the_axis_about_the_frame(rng: np.random.Generator) -> None:
    chain = robot("arm_3r_spatial")
    turn = rng.uniform(-0.3, 0.3, 3)
    joint = chain.mechanism.joint("joint2")
    moves = {named(chain, f"joint 'joint2': turn {'xyz'[k]} in '{joint.parent}'"): turn[k] for k in range(3)}
    old, new = (x.model.jointPlacements[2] for x in (chain, stp.build.displace_geometry(chain, moves)))
    np.testing.assert_array_equal(new.translation, old.translation)
    np.testing.assert_allclose(new.rotation @ old.rotation.T, pin.exp3(turn), atol=1e-15)


def test_axes_are_those_of_the_link_that_a_fixed_joint_turns(rng: np.random.Generator) -> None:
    bracket = turned(rng)
    links = (Link("ground"), Link("arm", body(rng)), Link("bracket"), Link("tip", body(rng)))
    joints = (
        Joint("shoulder", R, "ground", "arm", ONE, Z, independent=True),
        Joint("bolt", F, "arm", "bracket", bracket),
        Joint("slide", P, "bracket", "tip", at(0.1), Z, independent=True),
    )
    chain = build_chain(Mechanism("bracketed", links, joints, platform="tip"))
    moved = stp.build.displace_geometry(chain, {named(chain, "joint 'slide': shift y in 'bracket'"): 0.05})
    by = moved.model.jointPlacements[2].translation - chain.model.jointPlacements[2].translation
    np.testing.assert_allclose(by, bracket.rotation @ [0, 0.05, 0], atol=1e-15)
    assert not any(p.owner == "bolt" for p in stp.build.geometry_parameters(chain))


def test_what_locks_or_does_not_exist_is_refused() -> None:
    chain = robot("five_bar")
    out_of_plane = named(chain, "joint 'left_hip': shift z in 'base'")
    with pytest.raises(ClosureError):
        stp.build.displace_geometry(chain, {out_of_plane: 1e-3})
    with pytest.raises(InputError, match="finite"):
        stp.build.displace_geometry(chain, {out_of_plane: float("nan")})
    other = stp.build.geometry_parameters(robot("stewart"))[0]
    with pytest.raises(InputError, match="is no parameter of five_bar"):
        stp.build.displace_geometry(chain, {other: 1e-3})


def test_a_rod_without_length_is_no_mechanism(rng: np.random.Generator) -> None:
    chain = two_bodies(JointKind.DISTANCE, rng)
    with pytest.raises(MechanismError, match="length"):
        stp.build.displace_geometry(chain, {named(chain, "loop 'loop': length"): -0.4})
