"""Freedoms counted, named, and told apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.mechanics.mobility import _left_out, _rank
from stewart_pin.model.description import JointKind
from stewart_pin.state.newton import _least_norm_step, polish
from stewart_pin.tolerances import SINGULAR
from tests.closed_states import NAMES, robot
from tests.large_mechanisms import joined, scissors
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


def test_configurations_are_counted() -> None:
    found = stp.mobility(robot("delta"))
    assert (found.dof_home, found.dof_samples) == (9, (9,) * 5)
    # A parallelogram folded flat: two motions at home, one wherever else it closes.
    chain = four_bar(lengths=(0.3, 0.9, 0.3), ground=0.9)
    flat = replace(chain, q_home=np.zeros(3))
    found = stp.mobility(flat)
    assert (found.dof, found.dof_home, found.home_singular) == (1, 2, True)
    assert len(found.dof_samples) >= 2 and set(found.dof_samples) == {1}


def test_where_nothing_else_closes_home_is_all_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def open_loops(chain, q, **options):
        return replace(polish(chain, q, **options), success=False)

    monkeypatch.setattr("stewart_pin.state.newton.polish", open_loops)
    chain = replace(robot("stewart"))  # a copy, whose ranks are not known yet
    found = stp.mobility(chain)
    assert (found.dof, found.dof_samples, found.home_singular) == (6, (6,), False)
    assert np.array_equal(chain.generic.samples, [chain.q_home])


def with_motors(name: str, *motors: str) -> stp.ClosedChain:
    return replace(robot(name), motors=motors)


LEGS = tuple(f"leg{k}" for k in range(1, 7))
CRANKS = tuple(f"motor{k}" for k in range(1, 7))


@pytest.mark.parametrize(
    ("name", "motors", "verdict", "suggestion"),
    [
        ("five_bar", ("left_hip", "right_hip"), "sufficient", ("left_hip", "right_hip")),
        ("five_bar", ("left_hip",), "too few", ("left_hip", "right_hip")),
        ("five_bar", ("right_knee",), "too few", ("right_knee", "left_knee")),
        ("four_bar", (), "too few", ("crank_pin",)),
        ("rpr_planar", ("leg1", "leg1_hinge", "leg3"), "sufficient", ("leg1", "leg1_hinge", "leg3")),
        ("stewart", LEGS[:4], "too few", LEGS),
        ("stewart", LEGS[3:], "too few", (*LEGS[3:], *LEGS[:3])),
        ("delta", ("rod1a_spin", "motor1", "motor3"), "wrongly chosen", ("motor1", "motor3", "motor2")),
        ("hexapod_rss", ("rod2_spin", *CRANKS[:5]), "wrongly chosen", CRANKS),
        ("arm_7r", ("joint3",), "too few", tuple(f"joint{k}" for k in (3, 1, 2, 4, 5, 6, 7))),
    ],
)
def test_motors_that_fail_and_ones_that_do(
    name: str, motors: tuple[str, ...], verdict: str, suggestion: tuple[str, ...]
) -> None:
    found = stp.mobility(with_motors(name, *motors))
    assert (found.verdict, found.motors_sufficient) == (verdict, verdict == "sufficient")
    assert found.suggestion == suggestion
    assert stp.mobility(with_motors(name, *found.suggestion)).verdict == "sufficient"


@pytest.mark.parametrize("name", NAMES)
def test_any_part_of_the_motors_leads_to_motors_that_hold(name: str, rng: np.random.Generator) -> None:
    """Whatever joints are chosen, the suggestion holds the robot, without a motor to spare."""
    candidates = [joint.name for joint in robot(name).mechanism.joints if joint.has_axis]
    for size in (0, 1, robot(name).nu):
        motors = tuple(str(motor) for motor in rng.choice(candidates, size, replace=False))
        found = stp.mobility(with_motors(name, *motors))
        assert stp.mobility(with_motors(name, *found.suggestion)).motors_sufficient
        if not found.motors_sufficient:
            shorter = [found.suggestion[:k] + found.suggestion[k + 1 :] for k in range(len(found.suggestion))]
            assert not any(stp.mobility(with_motors(name, *fewer)).motors_sufficient for fewer in shorter)


def test_joints_left_free_are_those_that_move() -> None:
    """Lock one hip of a five-bar: its knee and the other arm still move, the hip does not."""
    assert stp.mobility(with_motors("five_bar", "left_hip")).free_joints == (
        "left_knee",
        "right_hip",
        "right_knee",
    )
    # With crank 3 unlocked the Delta moves along one line, all its rods but no crank other than the third.
    free = stp.mobility(with_motors("delta", "motor1", "motor2")).free_joints
    assert "motor3" in free and not {"motor1", "motor2"} & set(free)
    assert "platform_pose" in free and not any(name.endswith("_spin") for name in free)
    assert stp.mobility(robot("delta")).free_joints == ()


def test_spare_motors_come_in_sets() -> None:
    found = stp.mobility(with_motors("five_bar", "left_hip", "right_hip", "left_knee", "right_knee"))
    assert (found.verdict, found.surplus_motors) == ("redundant", 2)
    hips_and_knees = ("left_hip", "right_hip", "left_knee", "right_knee")
    assert found.spare_motors == tuple(combinations(hips_and_knees, 2))
    # Leg 1 and a swing of leg 2 fight through the platform; the spin of a rod fights nobody.
    found = stp.mobility(with_motors("delta", "motor1", "motor2", "motor3", "rod1a_spin", "rod3b_x"))
    assert found.surplus_motors == 1
    assert all("rod1a_spin" not in motors for motors in found.spare_motors)
    assert {motor for motors in found.spare_motors for motor in motors} == {
        "motor1",
        "motor2",
        "motor3",
        "rod3b_x",
    }
    # 2.7 million combinations: not all are tried, but what is listed can be left out.
    crowd = [joint.name for joint in robot("stewart_sps").mechanism.joints if joint.has_axis]
    found = stp.mobility(with_motors("stewart_sps", *crowd))
    assert (len(crowd), found.surplus_motors) == (24, 12) and len(found.spare_motors) > 1
    for out in found.spare_motors[:3]:
        assert len(out) == 12
        rest = stp.mobility(with_motors("stewart_sps", *(name for name in crowd if name not in out)))
        assert (rest.surplus_motors, rest.lost, rest.idle) == (0, 0, ())
    many = stp.mobility(with_motors("arm_7r", *[f"joint{k}" for k in range(1, 8)]))
    assert (many.surplus_motors, many.spare_motors) == (0, ())


def test_a_free_body_without_joints_has_no_motors_that_hold_it(rng: np.random.Generator) -> None:
    chain = replace(two_bodies(JointKind.DISTANCE, rng), platform="free")
    found = stp.mobility(chain)
    assert (found.suggestion, found.verdict, found.motors_sufficient) == ((), "too few", False)


def test_a_long_chain_of_loops_is_sampled_in_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random displacements of all its joints leave loops open by many robot sizes; those along its motion close."""
    chain, steps = scissors(26), []
    monkeypatch.setattr(
        "stewart_pin.state.newton._least_norm_step",
        lambda *given: steps.append(1) or _least_norm_step(*given),
    )
    found = stp.mobility(chain)
    assert len(steps) < 100
    assert (found.dof, found.dof_samples, found.redundant_rows, found.home_singular) == (
        1,
        (1,) * 5,
        26,
        False,
    )
    drive = {round(float(q[chain.motor_q_index[0]]), 6) for q in (*chain.generic.samples, chain.q_home)}
    assert len(drive) == 6


def test_robots_side_by_side_are_each_what_they_are_alone() -> None:
    """Loops that share no joints know nothing of each other."""
    parts = ("five_bar", "delta", "scissor_lift", "stewart_sps")
    chain = replace(joined(parts), platform=None)
    found = stp.mobility(chain)
    alone = [stp.mobility(replace(robot(name), platform=None)) for name in parts]
    assert (found.dof, found.dof_home) == (sum(one.dof for one in alone), sum(one.dof_home for one in alone))
    assert found.redundant_rows == sum(one.redundant_rows for one in alone)
    assert found.dof_samples == tuple(np.sum([one.dof_samples for one in alone], axis=0))
    assert found.lost == sum(one.lost for one in alone)
    assert found.free_joints == tuple(
        f"{k}_{name}" for k, one in enumerate(alone) for name in one.free_joints
    )
    assert set(found.suggestion) == {f"{k}_{name}" for k, one in enumerate(alone) for name in one.suggestion}
    assert set(found.redundant) == {f"{k}_{name}" for k, one in enumerate(alone) for name in one.redundant}


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-7, 2e-6, 1e-3])
def test_motors_to_spare_are_those_of_one_rank_after_another(apart: float, rng: np.random.Generator) -> None:
    """Rows taken off at once lead to the sets that a singular value decomposition of each choice does."""
    for _ in range(20):
        share = rng.normal(size=(9, 4)) @ rng.normal(size=(4, 6)) / 10
        share += apart * rng.normal(size=share.shape)
        share[rng.integers(9)] = 0.0
        for first in range(len(share)):
            kept: list[int] = []
            for k in np.roll(np.arange(len(share)), -first):
                values = np.linalg.svd(share[[*kept, k]], compute_uv=False)
                if np.count_nonzero(values >= SINGULAR) > len(kept):
                    kept.append(int(k))
            assert _left_out(share, first) == tuple(k for k in range(len(share)) if k not in kept)


def test_many_spare_motors_are_found_by_few_decompositions(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = joined(["four_bar"] * 8)
    chain = replace(chain, motors=tuple(joint.name for joint in chain.mechanism.joints if joint.has_axis))
    stp.mobility(chain)
    calls = []
    monkeypatch.setattr("stewart_pin.mechanics.mobility._rank", lambda share: calls.append(1) or _rank(share))
    found = stp.mobility(chain)
    assert (found.surplus_motors, found.verdict) == (16, "redundant")
    assert len(calls) <= 2 * chain.nu
