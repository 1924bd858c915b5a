"""Cassie: five descriptions of one robot with closed legs, whose digits decide how many freedoms it has."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building import printed_digits
from stewart_pin.errors import ActuationError
from stewart_pin.model.description import JointKind
from tests.building import cassie
from tests.closed_states import random_configuration, random_motion

pytestmark = pytest.mark.skipif(cassie.folder() is None, reason="needs the package example-robot-data")

S, R, P = JointKind.SPHERICAL, JointKind.REVOLUTE, JointKind.PRISMATIC
PLANAR_FEET = ("cassie_v2", "cassie_wo_gearbox_spring")
"""Files in which the rod to the foot moves in the plane of its hinges, at least where the file places it."""
PLANTAR, ACHILLES = "plantar-foot-joint", "achilles-spring-joint"


@pytest.fixture(scope="module", params=cassie.FILES)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def chain(name: str, tmp_path_factory: pytest.TempPathFactory) -> stp.ClosedChain:
    return cassie.load(name, tmp_path_factory.mktemp("cassie"))


def test_every_file_closes_where_it_places_its_links(chain: stp.ClosedChain, name: str) -> None:
    """Also with the loops of gears and rods: at zero, and at the home that was found."""
    zero = pin.neutral(chain.model)
    moved = "close only to the digits" in str(chain.report)
    assert moved == (name == "cassie_v2")
    # A tilt of 7e-8 rad, see below, times the few millimetres by which its rod is off the line of its hinges.
    assert np.abs(stp.loop_gap(chain, zero)).max() <= (1e-9 if moved else 1e-12)
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() <= 1e-12
    assert chain.nu == 10 and chain.platform == "pelvis"


# Tangent of the base, joints and loops of one leg, dof, and how many loop rows follow from others.
EXPECTED = {
    # Rotors behind gears; a hinge, and a slide on top of it, hold the knee's spring: no spring moves.
    "cassie": (6, 19, {"shin-spring-joint": P, ACHILLES: R, PLANTAR: S}, 16, 8),
    # Rods to the feet yawed by 0.1 rad: the linkage of a foot is spatial, and rigid.
    "cassie_reduced": (1, 11, {"pitch-rod-joint": S, PLANTAR: S}, 11, 0),
    "cassie_simple": (1, 13, {ACHILLES: R, PLANTAR: S}, 11, 0),
    # Five motors, and one spring: the hinge of the Achilles rod takes the other.
    "cassie_v2": (6, 11, {"pitch-rod-joint": S, PLANTAR: S}, 18, 2),
    "cassie_wo_gearbox_spring": (1, 13, {ACHILLES: R, PLANTAR: S}, 13, 2),
}


def test_loops_and_freedoms(chain: stp.ClosedChain, name: str) -> None:
    base, leg, loops, dof, redundant = EXPECTED[name]
    assert chain.nv == base + 2 * leg
    assert {loop.name: loop.kind for loop in chain.loops} == {
        f"{side}-{loop}": kind for side in cassie.SIDES for loop, kind in loops.items()
    }
    assert len(chain.mechanism.couplings) == (10 if name == "cassie" else 0)
    counted = stp.mobility(chain)
    assert (counted.dof, counted.redundant_rows) == (dof, redundant)
    assert counted.lost == base  # the motors do not hold the base


@pytest.mark.parametrize("name", ["cassie_v2", "cassie_wo_gearbox_spring"], scope="module")
def test_with_balls_at_its_rods_cassie_has_the_freedoms_of_the_robot(name: str, tmp_path) -> None:
    """Six of the pelvis, five motors and two springs per leg: 20; and every rod between two balls may spin.

    Y. Gong, J. Grizzle, "Angular Momentum about the Contact Point for Control of Bipedal Locomotion", 2020, abstract:
    20 degrees of freedom.
    """
    content = cassie.text(name)
    for side in cassie.SIDES:
        content = content.replace(f'"{side}-{ACHILLES}" type="revolute"', f'"{side}-{ACHILLES}" type="ball"')
    counted = stp.mobility(cassie.load(name, tmp_path, content))
    rods = 2
    assert counted.dof == EXPECTED[name][0] + 2 * (5 + 2) + rods
    assert sum("achilles-rod: spin" in idle for idle in counted.idle) == rods


def test_the_pose_that_its_authors_recorded_closes(tmp_path) -> None:
    """The SRDF was recorded with another reader and another engine, with eight digits: ours closes to as many."""
    chain = cassie.load("cassie_wo_gearbox_spring", tmp_path)
    q = cassie.standing(chain)
    assert 1e-10 < np.abs(stp.loop_gap(chain, q)).max() < 2e-8
    closure = stp.close_loops(chain, q)
    assert closure.gap <= 1e-12
    assert np.abs(pin.difference(chain.model, q, closure.q)).max() < 1e-6
    # Standing, the limits hold, which exclude the pose of the file.
    limits = stp.close_loops(chain, chain.q_home).q
    for number, joint in enumerate(chain.model.joints[1:], start=1):
        if joint.nq == 1:
            lower = chain.model.lowerPositionLimit[joint.idx_q]
            upper = chain.model.upperPositionLimit[joint.idx_q]
            for pose in (closure.q, limits):
                assert lower - 1e-3 <= pose[joint.idx_q] <= upper + 1e-3, chain.model.names[number]


@pytest.mark.parametrize("forgiven", [None, 1e-12])
def test_a_tilt_of_rounding_holds_no_foot_of_v2(forgiven: float | None, tmp_path) -> None:
    """1.5708 for a right angle, and a rod pitched by 1.364 among links at 1.3439: hinges 7e-8 rad from parallel.

    By its numbers the left foot, bent, closes to round-off; the right one keeps a gap of that tilt times its rod of
    half a metre. By its digits both bend.
    """
    path = tmp_path / "cassie_v2.sdf"
    path.write_text(cassie.text("cassie_v2"))
    chain = stp.load(path, motors=cassie.motors("cassie_v2"), platform="pelvis", closure_tolerance=forgiven)
    sizes = {}
    for side in cassie.SIDES:
        q = pin.neutral(chain.model)
        for joint, value in (("tarsus-crank-joint", -1.0), ("crank-rod-joint", 1.0), ("foot-op", -1.0)):
            q[chain.model.joints[chain.model.getJointId(f"{side}-{joint}")].idx_q] = value
        closure = stp.close_loops(chain, q, throw=False)
        foot = closure.q[chain.model.joints[chain.model.getJointId(f"{side}-foot-op")].idx_q]
        sizes[side] = (closure.gap, foot)
    assert sizes["left"][0] < 1e-12 and sizes["left"][1] < -0.5
    if forgiven is None:
        assert sizes["right"][0] < 1e-12 and sizes["right"][1] < -0.5
        assert "turned by 6.4e-08 rad" in str(chain.report)
    else:
        assert sizes["right"][0] > 1e-11 or sizes["right"][1] > -0.5


def test_gears_and_springs_that_only_seem_to_move_are_given_up_at_once(
    tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their rows depend on each other to 1e-6, but no mechanism within the digits moves: none is searched for."""

    def searched(*_: object) -> None:
        raise AssertionError("linear equations tell that there is none")

    monkeypatch.setattr(printed_digits, "closed_everywhere", searched)
    chain = cassie.load("cassie", tmp_path)
    assert str(chain.report).count("its numbers were taken as they stand") == len(cassie.SIDES)


def test_the_unphysical_rotor_is_named() -> None:
    """The file as it is shipped: its rotor is kept, as simulators keep it, and the report says what is odd about it."""
    root = cassie.folder()
    assert root is not None
    chain = stp.load(root / "robots" / "cassie.sdf", motors=cassie.motors("cassie"), platform="pelvis")
    assert "link 'left-foot-reference'" in str(chain.report) and "triangle inequality" in str(chain.report)
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12


def test_a_free_base_is_held_by_no_motor(tmp_path) -> None:
    chain = cassie.load("cassie_v2", tmp_path)
    rest = np.zeros(chain.nv)
    with pytest.raises(ActuationError, match="pelvis_floating"):
        stp.inverse_dynamics(chain, chain.q_home, rest, rest)


def test_forward_and_inverse_dynamics_undo_each_other(
    chain: stp.ClosedChain, name: str, rng: np.random.Generator
) -> None:
    """On the free base, or its vertical slide: efforts where they are unique, the motion in any case."""
    for q in (chain.q_home, random_configuration(chain, rng, 0.03)):
        v, _ = random_motion(chain, rng, q)
        tau = rng.normal(0, 10, chain.nu)
        motion = stp.forward_dynamics(chain, q, v, tau)
        effort = stp.inverse_dynamics(chain, q, v, motion.a, throw=False)
        assert effort.unique == (name not in ("cassie_reduced", "cassie_simple"))
        if effort.unique:
            assert np.abs(effort.tau_motor - tau).max() <= 1e-8 * np.abs(tau).max()
        again = stp.forward_dynamics(chain, q, v, effort.tau_motor)
        # Behind its gears, loops hold by singular values of 3e-7 of the largest: round-off over that is 7e-10.
        tolerance = 1e-8 if name == "cassie" else 1e-9
        assert np.abs(again.a - motion.a).max() <= tolerance * np.abs(motion.a).max()


@pytest.mark.parametrize("name", PLANAR_FEET, indirect=True)
def test_three_formulations_agree_with_the_pelvis_held(
    chain: stp.ClosedChain, name: str, rng: np.random.Generator
) -> None:
    fixed = cassie.held(chain)
    for q in (fixed.q_home, random_configuration(fixed, rng, 0.03)):
        v, _ = random_motion(fixed, rng, q)
        tau = rng.normal(0, 10, fixed.nu)
        motion = stp.forward_dynamics(fixed, q, v, tau)
        passes = stp.dynamics.closed_chain_articulated_body(fixed, q, v, tau)
        # Rows of the Achilles rods are 1e-3 from dependent, which the passes square.
        assert np.abs(passes.a - motion.a).max() <= 1e-9 * np.abs(motion.a).max()
        for method in ("pinocchio", "constraint_matrix"):
            effort = stp.inverse_dynamics(fixed, q, v, motion.a, method=method, throw=False)
            assert np.abs(effort.tau_motor - tau).max() <= 1e-8 * np.abs(tau).max(), method


@pytest.mark.parametrize("name", ["cassie_reduced"], indirect=True)
def test_pinocchios_own_constraints_agree(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    """The only file whose loops are points and whose rows are independent."""
    q = chain.q_home
    v, _ = random_motion(chain, rng, q)
    tau = rng.normal(0, 10, chain.nu)
    ours = stp.forward_dynamics(chain, q, v, tau)
    theirs = stp.forward_dynamics(chain, q, v, tau, method="constraint_dynamics")
    assert np.abs(theirs.a - ours.a).max() <= 1e-9 * np.abs(ours.a).max()
