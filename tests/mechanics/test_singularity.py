"""Singularities of textbook mechanisms, each where geometry says it is and of the kind that geometry says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import fsolve

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from tests.closed_states import NAMES, close, configuration, random_configuration, robot
from tests.mechanisms import five_bar, four_bar, rotary_hexapod
from tests.rewritten import in_other_unit
from tests.singular_robots import at_angles, at_pin, moved, three_upu, tilted


def triangle(a: float, b: float, opposite: float) -> float:
    """Angle between two sides of a triangle, by the law of cosines."""
    return float(np.arccos((a**2 + b**2 - opposite**2) / (2 * a * b)))


@pytest.mark.parametrize("fold", [1, -1])
def test_four_bar_crank_in_line_with_coupler(fold: int) -> None:
    """The rocker is at the end of its swing: type I, and the rocker's torque does not reach the crank."""
    chain = replace(four_bar(), platform="rocker")
    crank = triangle(0.9, 0.8 + fold * 0.3, 0.6) + (0 if fold == 1 else np.pi)
    tip = (0.8 + fold * 0.3) * np.array([np.cos(crank), np.sin(crank)]) * fold
    q = at_angles(
        chain,
        crank_motor=crank,
        elbow=0 if fold == 1 else np.pi,
        rocker_hinge=np.arctan2(tip[1], tip[0] - 0.9),
    )
    found = stp.singularities.classify_singularity(chain, q)
    assert found.kinds == ("platform",) and found.zlatanov == ("RI", "IO")
    assert found.measures["platform"] < 1e-12 < found.measures["motor"]
    assert found.count.platform == 0 and found.condition_number == np.inf
    close(found.lost_twist.values, np.array([0, 0, 0, 0, 0, 1.0]), 1e-6)
    # Its coordinate is gone as well, whatever round-off is left of it.
    with pytest.raises(UnsupportedError, match="cannot move here"):
        stp.dynamics.motion_map(chain, q, coordinates="platform")
    assert (
        str(found.carried_wrench) == "mz +0.45 N m"
    )  # of unit size once moments are divided by the robot's 0.45 m, half its longest link


def test_four_bar_coupler_in_line_with_rocker() -> None:
    """The crank cannot hold the rocker: type II."""
    chain = replace(four_bar(lengths=(0.6, 0.3, 0.8)), platform="rocker")
    crank = triangle(0.6, 0.9, 1.1)
    elbow = 0.6 * np.array([np.cos(crank), np.sin(crank)])
    rocker = np.arctan2(elbow[1], elbow[0] - 0.9)
    q = at_angles(chain, crank_motor=crank, elbow=rocker + np.pi - crank, rocker_hinge=rocker)
    found = stp.singularities.classify_singularity(chain, q)
    assert found.kinds == ("motor",) and found.zlatanov == ("RO", "II")
    assert str(found.worst_twist) == "wz +1 rad/s"
    assert str(found) == "locked motors leave the platform free (type II, parallel) [RO, II]"
    # The motion that goes on by itself: the rocker turns, the crank rests.
    motion = found.motions["motor"]
    assert np.abs(stp.loop_jacobian(chain, q) @ motion).max() < 1e-9
    assert abs(motion[0]) < 1e-9 < abs(motion[2])


def test_flat_parallelogram_gains_a_freedom() -> None:
    """All links in line: parallelogram and antiparallelogram meet, the loops leave two freedoms for a moment."""
    chain = replace(four_bar(lengths=(0.3, 0.9, 0.3)), platform="rocker")
    q = chain.q_home * 0.0
    found = stp.singularities.classify_singularity(chain, q)
    assert found.count.dof == 2 and found.generic.dof == 1
    assert set(found.kinds) >= {"loop", "motor"} and "IIM" in found.zlatanov
    assert found.measures["loop"] < 1e-12
    # The crank alone, or the rocker alone: each rests while the other moves.
    assert found.count.uncontrolled == 1


@pytest.mark.parametrize("side", ["left", "right"])
def test_five_bar_leg_in_line(side: str) -> None:
    """Hip, knee and tip in line: the tip cannot leave the circle that the stretched leg allows."""
    chain = five_bar(motors=("left_hip", "right_hip"))
    # The other leg reaches from its hip to the tip by a triangle of sides 0.4.
    start, other = (np.array([0.0, 0]), np.array([0.5, 0]))[:: 1 if side == "left" else -1]
    direction = np.deg2rad(70.0 if side == "left" else 110.0)
    tip = start + 0.8 * np.array([np.cos(direction), np.sin(direction)])
    reach = np.linalg.norm(tip - other)
    assert reach < 0.8
    bend = triangle(0.4, reach, 0.4) * (1 if side == "right" else -1)
    hip = np.arctan2(*(tip - other)[::-1]) + bend
    names = ("left", "right") if side == "left" else ("right", "left")
    q = at_angles(
        chain,
        **{
            f"{names[0]}_hip": direction,
            f"{names[0]}_knee": 0.0,
            f"{names[1]}_hip": hip,
            f"{names[1]}_knee": -2 * bend,
        },
    )
    found = stp.singularities.classify_singularity(at_pin(chain), q, axes=("vx", "vy"))
    assert found.kinds == ("platform",) and found.zlatanov == ("RI", "IO")
    # What is lost is the motion along the leg.
    along = np.array([np.cos(direction), np.sin(direction)])
    lost = found.lost_twist.values[:2] / np.linalg.norm(found.lost_twist.values[:2])
    assert abs(lost @ along) == pytest.approx(1.0, abs=1e-9)
    assert found.lost_twist.values[2:] == pytest.approx(0.0, abs=1e-9)


def test_five_bar_distal_links_in_line() -> None:
    """Both distal links on one line: the tip moves across it while the hips stand."""
    chain = robot("five_bar")
    hip = np.arccos((0.18 - 0.118) / 2 / 0.09)  # knees 0.18 m apart
    q = at_angles(chain, left_hip=np.pi - hip, left_knee=hip - np.pi, right_hip=hip, right_knee=np.pi - hip)
    found = stp.singularities.classify_singularity(chain, q, axes=("vx", "vy"))
    assert found.kinds == ("motor",) and found.zlatanov == ("RO", "II")
    close(found.worst_twist.values / found.length, np.array([0, 1.0, 0, 0, 0, 0]), 1e-6)
    close(found.worst_wrench.values, np.array([0, 1.0, 0, 0, 0, 0]), 1e-6)


def test_planar_platform_whose_leg_lines_meet() -> None:
    """3-RPR: it turns about the point where the lines of the legs meet."""
    chain = robot("rpr_planar")
    anchors = np.array([[0, 0], [5, 0], [0, 6.0]])
    corners = np.array([[0, 0], [3, 0], [3, 3.0]])
    # The platform may stand anywhere such that corner k lies on the line from anchor k to the meeting point.
    meeting = np.array([2.5, 3.5])

    # Unknown: place of the platform, shares of the ways from anchors to the meeting point, and the angle.
    def off(x: np.ndarray) -> np.ndarray:
        turn = pin.exp3(np.array([0, 0, x[5]]))[:2, :2]
        points = x[:2] + corners @ turn.T
        return (points - anchors - x[2:5, None] * (meeting - anchors)).ravel()

    x = fsolve(off, np.array([2.0, 2.0, 0.6, 0.6, 0.6, 0.4]), xtol=1e-13)
    assert np.abs(off(x)).max() < 1e-11
    pose = pin.SE3(pin.exp3(np.array([0, 0, x[5]])), np.array([x[0], x[1], 0]))
    q = stp.inverse_kinematics(chain, pose, limits=False).q
    found = stp.singularities.classify_singularity(chain, q)
    assert found.kinds == ("motor",) and found.zlatanov == ("RO", "II")
    twist = found.worst_twist.values
    centre = x[:2] + np.array([-twist[1], twist[0]]) / twist[5]
    assert centre == pytest.approx(meeting, abs=1e-6)


def test_planar_platform_with_a_leg_without_length() -> None:
    """The leg turns as it likes, and its corner can leave the anchor one way only: passive and type I, but held."""
    chain = robot("rpr_planar")
    pose = pin.SE3(pin.exp3(np.array([0, 0, 0.3])), np.zeros(3))
    q = stp.inverse_kinematics(chain, pose, limits=False).q
    found = stp.singularities.classify_singularity(chain, q)
    assert stp.motor_positions(chain, q)[0] == pytest.approx(0.0, abs=1e-9)
    assert found.kinds == ("platform", "passive") and found.zlatanov == ("II", "IO", "RPM")
    spin = found.motions["passive"]
    assert abs(spin[chain.tangent_names.index("leg1_hinge")]) == pytest.approx(np.abs(spin).max())
    # Across the leg is lost.
    hinge = q[chain.model.joints[chain.model.getJointId("leg1_hinge")].idx_q]
    lost = found.lost_twist.values
    assert abs(lost[:2] @ [np.cos(hinge), np.sin(hinge)]) < 1e-3 * np.linalg.norm(lost[:2])


@pytest.mark.parametrize("yaw", [90.0, -90.0])
@pytest.mark.parametrize("place", [(0.0, 0.0, 1.0), (0.1, -0.2, 0.9)])
def test_hexapod_turned_by_a_right_angle(yaw: float, place: tuple[float, float, float]) -> None:
    """Fichter 1986: semi-regular hexagons in parallel planes are singular at yaw ±90°, wherever the platform is."""
    chain = robot("stewart")
    turn = pin.rpy.rpyToMatrix(0, 0, np.deg2rad(yaw))
    q = stp.inverse_kinematics(chain, pin.SE3(turn, np.array(place)), limits=False).q
    found = stp.singularities.classify_singularity(chain, q)
    assert found.kinds == ("motor",) and found.zlatanov == ("RO", "II")
    assert found.condition_number == np.inf
    # The closed form knows nothing of the chain.
    jacobian = stp.leg_jacobian(stp.Hexapod.from_chain(chain), np.array(place), turn)
    assert np.abs(jacobian @ found.worst_twist.values).max() < 1e-12
    assert np.linalg.matrix_rank(np.vstack([jacobian, found.worst_wrench.values]), tol=1e-9) == 6


@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_the_gained_motion_has_no_idle_spin_in_it(name: str) -> None:
    chain = robot(name)
    pose = pin.SE3(pin.rpy.rpyToMatrix(0, 0, np.pi / 2), np.array([0, 0, 1.0]))
    q = stp.inverse_kinematics(chain, pose, limits=False).q
    found = stp.singularities.classify_singularity(chain, q)
    motion, idle = found.motions["motor"], chain.at(q).freedom.idle
    assert np.abs(motion[chain.motor_index]).max() < 1e-9
    twist = chain.at(q).P @ motion
    assert np.linalg.norm(twist) > 0.1
    close(np.outer(twist, found.worst_twist.values), np.outer(found.worst_twist.values, twist), 1e-6)
    scale = chain.tangent_scale
    assert np.abs((idle / scale[:, None]).T @ (motion / scale)).max(initial=0.0) < 1e-9


def test_delta_with_straight_arms() -> None:
    """All cranks in line with their rods: the platform is at its lowest and cannot move at all."""
    chain = robot("delta")
    crank, bar, offset = 0.112, 0.232, (0.4573 - 0.115) / (2 * np.sqrt(3))
    depth = np.sqrt((crank + bar) ** 2 - offset**2)
    angle = np.arctan2(depth, -offset)
    q = chain.q_home.copy()
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        # A rod at zero stands at right angles to its crank.
        if name.startswith("motor") or name.endswith("_y"):
            q[joint.idx_q] = angle if name.startswith("motor") else np.pi / 2
    q[chain.model.joints[chain.model.getJointId("platform_pose")].idx_q + 2] = -depth
    assert np.abs(stp.loop_gap(chain, q)).max() < 1e-9
    found = stp.singularities.classify_singularity(chain, q)
    assert found.kinds == ("platform",)
    assert found.count.platform == 0 and found.count.inner == 3 and found.count.idle == 6
    assert found.zlatanov == ("RI", "IO")


def test_translational_platform_that_begins_to_turn() -> None:
    """3-UPU: its legs' couples depend on each other at 2 (R - r) from the axis (Di Gregorio, Parenti-Castelli)."""
    chain = three_upu(0.5, 0.3)
    usual = stp.loops.generic_freedom(chain)
    assert (usual.dof, usual.motor, usual.platform) == (3, 3, 3)
    for direction in (0.2, 1.5, 4.0):
        way = np.array([np.cos(direction), np.sin(direction)])
        q = moved(chain, *(0.4 * way), 1.0)
        found = stp.singularities.classify_singularity(chain, q)
        assert found.kinds == ("loop", "motor") and found.zlatanov == ("RO", "IIM")
        assert found.count.dof == 4 and found.count.uncontrolled == 1
        beside = stp.singularities.classify_singularity(chain, moved(chain, *(0.38 * way), 1.0))
        assert beside.kinds == () and beside.measures["loop"] > 1e-3


def test_platform_and_base_alike_gain_two_turns() -> None:
    """The 3-UPU with R = r: all couples are vertical at home, so that it wobbles about both other axes."""
    chain = three_upu(0.3, 0.3)
    found = stp.singularities.classify_singularity(chain, chain.q_home)
    assert found.kinds == ("loop", "motor")
    assert found.count.dof == found.generic.dof + 2


@pytest.mark.parametrize("name", ["arm_3r_planar", "arm_7r"])
def test_stretched_arms(name: str) -> None:
    chain = robot(name)
    found = stp.singularities.classify_singularity(chain, np.zeros(chain.nq))
    assert found.kinds == ("platform",) and found.zlatanov == ("RI", "IO")
    assert found.measures["loop"] == np.inf  # there are no loops to depend on each other
    # The wrench along the arm loads no joint.
    effort = chain.at(np.zeros(chain.nq)).P.T @ found.carried_wrench.values
    assert np.abs(effort).max() < 1e-12


def test_a_lost_twist_lies_in_the_plane_of_a_tilted_robot(rng: np.random.Generator) -> None:
    """What a planar robot never does, out of its plane, is not what it loses."""
    turn = pin.exp3(rng.normal(size=3))
    chain = tilted(robot("arm_3r_planar"), turn)
    found = stp.singularities.classify_singularity(chain, np.zeros(3))
    assert found.kinds == ("platform",)
    lost = found.lost_twist.values / np.linalg.norm(found.lost_twist.values)
    close(np.abs(turn.T @ lost[:3]), np.array([1.0, 0, 0]), 1e-3)  # a neighbour 1e-4 aside tells
    assert np.abs(lost[3:]).max() < 1e-3


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("pose", ["generic", "near_singular"])
def test_generic_configurations_are_regular(name: str, pose: str) -> None:
    chain = robot(name)
    found = stp.singularities.classify_singularity(chain, configuration(name, pose))
    assert found.kinds == () and found.zlatanov == ()
    assert found.count == found.generic
    assert str(found).startswith("regular, condition number")


@pytest.mark.parametrize("name", ["stewart", "stewart_cad", "hexapod_rss"])
def test_condition_number_is_that_of_the_motor_jacobian(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    q = random_configuration(chain, rng)
    for length in (0.3, 1.0):
        found = stp.singularities.classify_singularity(chain, q, length=length)
        jacobian = stp.motor_jacobian(chain, q) * np.repeat([length, 1.0], 3)
        _, s, vt = np.linalg.svd(jacobian)
        assert found.condition_number == pytest.approx(s[0] / s[-1], rel=1e-8)
        assert found.length == length
        scaled = found.worst_twist.values / np.repeat([length, 1.0], 3)
        assert abs(scaled @ vt[-1]) == pytest.approx(1.0, abs=1e-6)
        assert abs(found.lost_twist.values / np.repeat([length, 1.0], 3) @ vt[0]) == pytest.approx(
            1.0, abs=1e-6
        )
        # Worst to carry: efforts per wrench of unit size are largest, 1 / s[-1].
        effort = np.linalg.solve(stp.motor_jacobian(chain, q).T, found.worst_wrench.values)
        assert np.linalg.norm(effort) == pytest.approx(length / s[-1], rel=1e-6)


@pytest.mark.parametrize("build", [rotary_hexapod, lambda: robot("rpr_planar")])
def test_the_unit_of_length_decides_nothing(build) -> None:
    chain = build()
    other = in_other_unit(chain, 1e3)
    here, there = (stp.singularities.classify_singularity(x, x.q_home) for x in (chain, other))
    assert here.measures == pytest.approx(there.measures, rel=1e-9)
    assert here.condition_number == pytest.approx(there.condition_number, rel=1e-9)


def test_screws_spell_themselves_out() -> None:
    twist = stp.singularities.Screw("twist", np.array([0, 0.5, 0, 0, 1e-12, -2.0]))
    assert str(twist) == "vy +0.5 m/s, wz -2 rad/s"
    wrench = stp.singularities.Screw("wrench", np.array([0, 0.5, 0, 0, 0, -2.0]))
    assert str(wrench) == "fy +0.5 N, mz -2 N m"
    assert wrench.names[0] == "fx" and wrench.units[5] == "N m"


def test_bad_arguments_are_refused() -> None:
    chain = four_bar()
    with pytest.raises(InputError, match="length must be a finite number above zero"):
        stp.singularities.classify_singularity(chain, chain.q_home, length=-1.0)
    with pytest.raises(InputError, match="axes must be some of vx"):
        stp.singularities.classify_singularity(chain, chain.q_home, axes=("x",))
    with pytest.raises(InputError, match="are not those of generic"):
        stp.singularities.classify_singularity(
            chain, chain.q_home, axes=("vx",), generic=stp.loops.generic_freedom(chain)
        )
    with pytest.raises(InputError, match="q does not keep the loops closed"):
        stp.singularities.classify_singularity(chain, chain.q_home + 0.1)
