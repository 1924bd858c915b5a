"""The MJCF writer alone: what stands in the file, and what it refuses. MuJoCo's own reading is in the oracles."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Loop, Mechanism

J = JointKind
HERE = pin.SE3.Identity()
BALL = pin.Inertia.FromSphere(1.0, 0.1)
ABOVE = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))


def exported(chain: stp.ClosedChain, folder: Path) -> etree._Element:
    path = folder / "robot.xml"
    stp.export(chain, path, format="mjcf")
    return etree.parse(path).getroot()


def two_links(**changes) -> stp.ClosedChain:
    """Build a motor and a hand, with other links, joints and loops as given."""
    links = (Link("base"), Link("arm", BALL), Link("hand", BALL))
    joints = (
        Joint("motor", J.REVOLUTE, "base", "arm", HERE, independent=True),
        Joint("wrist", J.REVOLUTE, "arm", "hand", ABOVE),
    )
    return build_chain(replace(Mechanism("two", links, joints, platform="hand"), **changes))


def test_names_of_bodies_joints_loops_and_motors_are_kept(tmp_path: Path) -> None:
    chain = stp.load("stewart")
    root = exported(chain, tmp_path)
    bodies = {element.get("name") for element in root.iter("body")}
    assert bodies == {link.name for link in chain.mechanism.links if link.inertia is not None}
    joints = {element.get("name") for element in root.find("worldbody").iter("joint", "freejoint")}
    assert joints == set(chain.model.names[1:])
    assert [element.get("name") for element in root.find("equality")] == [loop.name for loop in chain.loops]
    assert [element.get("joint") for element in root.find("actuator")] == list(chain.motors)


def test_gravity_is_that_of_the_chain(tmp_path: Path) -> None:
    root = exported(stp.load("stewart", gravity=(0.1, 0.2, -1.62)), tmp_path)
    assert root.find("option").get("gravity") == "0.1 0.2 -1.62"


def test_a_ground_called_world_is_the_world(tmp_path: Path) -> None:
    links = (Link("world"), Link("arm", BALL), Link("hand", BALL))
    joints = (
        Joint("motor", J.REVOLUTE, "world", "arm", HERE, independent=True),
        Joint("wrist", J.REVOLUTE, "arm", "hand", ABOVE),
    )
    root = exported(two_links(links=links, joints=joints), tmp_path)
    assert [element.get("name") for element in root.find("worldbody")] == ["arm"]


def test_one_limit_leaves_the_other_side_free(tmp_path: Path) -> None:
    motor = Joint("motor", J.REVOLUTE, "base", "arm", HERE, lower=-0.5, independent=True)
    wrist = Joint("wrist", J.REVOLUTE, "arm", "hand", ABOVE)
    root = exported(two_links(joints=(motor, wrist)), tmp_path)
    first, second = root.iter("joint")
    assert first.get("range") == "-0.5 10000000000"
    assert second.get("range") is None


def test_couplings_are_joint_constraints(tmp_path: Path) -> None:
    gear = Coupling("gear", "wrist", "motor", (0.5, -2.0))
    (element,) = exported(two_links(couplings=(gear,)), tmp_path).find("equality")
    assert dict(element.attrib) == {
        "name": "gear", "joint1": "wrist", "joint2": "motor", "polycoef": "0.5 -2 0 0 0",
    }  # fmt: skip
    (element,) = exported(two_links(couplings=(Coupling("held", "wrist", None, (0.5,)),)), tmp_path).find(
        "equality"
    )
    assert element.get("joint2") is None and element.get("polycoef") == "0.5 0 0 0 0"


def test_efforts_of_passive_joints_are_kept(tmp_path: Path) -> None:
    chain = two_links()
    motor, wrist = chain.mechanism.joints
    joints = (replace(motor, effort=3.0), replace(wrist, effort=2.0))
    first, second = exported(two_links(joints=joints), tmp_path).iter("joint")
    assert (first.get("actuatorfrcrange"), second.get("actuatorfrcrange")) == (None, "-2 2")


def test_massless_legs_are_refused(tmp_path: Path) -> None:
    chain = stp.massless_legs(stp.load("stewart"))
    with pytest.raises(
        UnsupportedError, match=r"'leg1_upper' has no mass.*loop 'leg1_ball' ends on it.*give it"
    ):
        stp.export(chain, tmp_path / "robot.xml", format="mjcf")


def test_a_point_platform_is_refused(tmp_path: Path) -> None:
    chain = stp.load("stewart")
    point = stp.build.replace_inertias(chain, {"platform": pin.Inertia(20.0, np.zeros(3), np.zeros((3, 3)))})
    path = tmp_path / "robot.xml"
    with pytest.raises(UnsupportedError, match="'platform' has the principal moment 0 kg m²"):
        stp.export(point, path, format="mjcf")
    assert not path.exists()


def _cross(*joints: Joint, platform: str = "hand", loops: tuple[Loop, ...] = ()) -> stp.ClosedChain:
    names = {name for joint in joints for name in (joint.parent, joint.child)} - {"base", "arm", "hand"}
    links = (Link("base"), Link("arm", BALL), Link("hand", BALL), *(Link(name) for name in sorted(names)))
    motor = Joint("motor", J.REVOLUTE, "base", "arm", HERE, independent=True)
    return two_links(links=links, joints=(motor, *joints), platform=platform, loops=loops)


@cache
def _refusals() -> dict[str, tuple[stp.ClosedChain, str]]:
    turn = Joint("w1", J.REVOLUTE, "arm", "cross", ABOVE)
    on = Joint("w2", J.REVOLUTE, "cross", "hand", HERE)
    grip = Loop("grip", J.SPHERICAL, "base", "cross", ABOVE, HERE)
    rail = Loop("rail", J.PRISMATIC, "base", "hand", ABOVE, HERE)
    slides = [Joint(f"s{k}", J.PRISMATIC, f"c{k}", f"c{k + 1}", HERE) for k in range(6)]
    many = [replace(slides[0], parent="arm"), *slides[1:], Joint("s6", J.PRISMATIC, "c6", "hand", HERE)]
    plain = two_links()
    motor, wrist = plain.mechanism.joints
    worldly = (Link("base"), Link("arm", BALL), Link("world", BALL))
    pinned = Loop("platform", J.SPHERICAL, "base", "arm", HERE, HERE)
    quintic = Coupling("cam", "wrist", "motor", (0.0, 1.0, 0.0, 0.0, 0.0, 0.1))
    hinge = Loop("hinge", J.REVOLUTE, "arm", "hand", ABOVE, HERE)
    twin = Loop("hinge_axis", J.SPHERICAL, "arm", "hand", ABOVE, HERE)
    return {
        "leaf": (_cross(replace(on, parent="arm"), turn), "'cross' has no mass.*because no joint leaves it"),
        "branch": (
            _cross(turn, on, Joint("w3", J.FIXED, "cross", "lamp", HERE)),
            "'cross' has no mass.*2 joints leave it",
        ),
        "loop": (_cross(turn, on, loops=(grip,)), "'cross' has no mass.*loop 'grip' ends on it"),
        "platform": (_cross(turn, on, platform="cross"), "'cross' has no mass.*it is the platform"),
        "ball": (_cross(replace(turn, kind=J.SPHERICAL), on), "'cross' has no mass.*no rotation after the ball 'w1'"),
        "seven": (_cross(*many), "six freedoms"),
        "cam": (two_links(couplings=(quintic,)), "coupling 'cam' is of degree 5.*degree 4 at most"),
        "constraints": (two_links(loops=(hinge, twin)), "would be called 'hinge_axis"),
        "rail": (two_links(loops=(rail,)), "loop 'rail' is prismatic.*cut the loop at another joint"),
        "held": (
            two_links(joints=(replace(motor, lower=0.5, upper=0.5), wrist)),
            "'motor' has equal limits.*make it fixed",
        ),
        "weak": (two_links(joints=(replace(motor, effort=0.0), wrist)), "'motor' has the effort limit 0"),
        "float": (
            two_links(joints=(motor, replace(wrist, kind=J.FLOATING))),
            "'wrist' hangs on the moving link 'arm'",
        ),
        "world": (
            two_links(links=worldly, joints=(motor, replace(wrist, child="world")), platform="world"),
            "link 'world' moves.*rename",
        ),
        "sites": (
            two_links(
                links=(Link("base"), Link("arm", BALL), Link("platform_1", BALL)),
                joints=(motor, replace(wrist, child="platform_1")),
                platform="platform_1",
                loops=(pinned,),
            ),
            "two sites would be called 'platform_1'",
        ),
    }  # fmt: skip


@pytest.mark.parametrize("case", ["leaf", "branch", "loop", "platform", "ball", "seven", "rail", "held", "weak",
                                  "float", "world", "sites", "cam", "constraints"])  # fmt: skip
def test_what_mujoco_cannot_express_is_named(case: str, tmp_path: Path) -> None:
    chain, message = _refusals()[case]
    with pytest.raises(UnsupportedError, match=message):
        stp.export(chain, tmp_path / "robot.xml", format="mjcf")
    assert not (tmp_path / "robot.xml").exists()


def test_unknown_format_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"format must be one of .*mjcf.*'blend'"):
        stp.export(stp.load("stewart"), tmp_path / "robot", format="blend")
