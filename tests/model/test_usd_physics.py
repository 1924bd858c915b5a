"""What joints do by themselves, in OpenUSD: exact by our own words, and as Newton, MuJoCo and PhysX have it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import JointKind, Mechanism, physics_coordinates
from stewart_pin.model.joint_physics import JointPhysics
from tests.closed_states import KINDS, robot
from tests.small_usd import as_others_see_it, bar, ends, joint, stage, write

pytest.importorskip("pxr", reason="needs OpenUSD: pip install 'stewart_pin[usd]'")

AXIS = '        uniform token physics:axis = "Z"\n'
DEGREE = np.pi / 180


def draw(kind: JointKind, rng: np.random.Generator, *, closing: bool) -> JointPhysics:
    """Draw all that a coordinate may have."""
    armature, damping, friction, force = rng.uniform(0.1, 3, 4)
    if kind is JointKind.FLOATING:
        return JointPhysics(armature, damping, friction)
    if kind is JointKind.SPHERICAL:
        ball = JointPhysics(damping=damping, stiffness=(rng.uniform(),))
        return ball if closing else replace(ball, armature=armature, friction=friction)
    stiffness = tuple(rng.uniform(1, 3, rng.integers(1, 5)))
    return JointPhysics(0.0 if closing else armature, damping, friction, stiffness, rng.uniform(-1, 1), force)


def drawn(mechanism: Mechanism, rng: np.random.Generator) -> Mechanism:
    joints = tuple(
        each if each.kind is JointKind.FIXED else replace(each, physics=draw(each.kind, rng, closing=False))
        for each in mechanism.joints
    )
    loops = tuple(
        replace(
            each, physics=tuple(draw(each.kind, rng, closing=True) for _ in physics_coordinates(each.kind))
        )
        for each in mechanism.loops
    )
    return replace(mechanism, joints=joints, loops=loops)


def told(mechanism: Mechanism) -> Mapping[str, object]:
    each = {one.name: one.physics for one in mechanism.joints}
    return each | {loop.name: loop.physics for loop in mechanism.loops}


@pytest.mark.parametrize(
    "name", ["stewart", "five_bar", *(each for each in KINDS if each not in ("gear_train", "cable"))]
)
def test_everything_comes_back(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    chain = build_chain(drawn(robot(name).described(), rng))
    report = stp.export(chain, tmp_path / "a.usda", format="usd")
    again = stp.load(tmp_path / "a.usda")
    assert told(again.mechanism) == told(chain.mechanism)
    # What others do not know of it is told with its numbers.
    alone = {note.subject: note.text for note in report.notes if "own alone" in note.text}
    sprung = [each for each in chain.mechanism.joints if each.physics.pushes]
    assert all(f"{each.physics.rest:g}" in alone[f"joint '{each.name}'"] for each in sprung)


def test_others_read_rotors_damping_and_friction(rng: np.random.Generator, tmp_path: Path) -> None:
    chain = build_chain(drawn(robot("five_bar").described(), rng))
    stp.export(chain, tmp_path / "a.usda", format="usd")
    again = stp.load(as_others_see_it(tmp_path / "a.usda")).mechanism
    for own in (each for each in chain.mechanism.joints if each.has_axis):
        found = again.joint(own.name).physics
        for word in ("armature", "damping", "friction"):
            np.testing.assert_allclose(getattr(found, word), getattr(own.physics, word), rtol=1e-6)
        assert not found.pushes


def test_numbers_changed_by_others_are_believed(rng: np.random.Generator, tmp_path: Path) -> None:
    chain = stp.with_joint_physics(robot("five_bar"), {"left_knee": {"damping": 1.7, "stiffness": 4.0}})
    stp.export(chain, tmp_path / "a.usda", format="usd")
    text = (tmp_path / "a.usda").read_text()
    changed, count = re.subn(r"newton:damping = \S+", "newton:damping = 0.5", text)
    assert count == 1
    again = stp.load(write(tmp_path, changed))
    assert again.mechanism.joint("left_knee").physics == JointPhysics(damping=0.5 / DEGREE, stiffness=(4.0,))
    assert "its damping: changed since words of our own were written" in str(again.report)


@pytest.mark.parametrize("numbers", ["[1, 2]", "[]"])
def test_words_of_our_own_have_a_number_per_coordinate(numbers: str, tmp_path: Path) -> None:
    chain = stp.with_joint_physics(robot("five_bar"), {"left_knee": {"force": 1.7}})
    stp.export(chain, tmp_path / "a.usda", format="usd")
    text = (
        (tmp_path / "a.usda")
        .read_text()
        .replace("stewart_pin:force = [1.7]", f"stewart_pin:force = {numbers}")
    )
    with pytest.raises(FileFormatError, match="numbers of its force, and 1 coordinates"):
        stp.load(write(tmp_path, text))


def arm(words: str, kind: str = "PhysicsRevoluteJoint", *, scene: str = "", turn: float = 0.0) -> str:
    """Hang a bar in centimetres and kilograms, turned by degrees from the zero of its joint."""
    return stage(bar("arm", turn=turn), joint("j", AXIS + ends("", "arm") + words, kind), scene)


def physics(folder: Path, text: str) -> JointPhysics:
    return stp.load(write(folder, text)).mechanism.joint("j").physics


ALIKE = {
    # Damping per degree, torques in kg cm²/s².
    "newton": ("newton:armature = 20", "newton:damping = 30", "newton:friction = 40"),
    "mjc": ("mjc:armature = 20", f"mjc:damping = {30 / DEGREE!r}", "mjc:frictionloss = 40"),
}


@pytest.mark.parametrize("name", ALIKE)
def test_units_of_turns(name: str, tmp_path: Path) -> None:
    words = "".join(f"        {'float' if name == 'newton' else 'double'} {word}\n" for word in ALIKE[name])
    found = physics(tmp_path, arm(words))
    np.testing.assert_allclose((found.armature, found.damping, found.friction), (2e-3, 3e-3 / DEGREE, 4e-3))
    ball = physics(tmp_path, arm(words, "PhysicsSphericalJoint"))
    np.testing.assert_allclose((ball.armature, ball.damping, ball.friction), (2e-3, 3e-3 / DEGREE, 4e-3))


def test_units_of_slides(tmp_path: Path) -> None:
    words = "".join(f"        float {word}\n" for word in ALIKE["newton"])
    words += "        double mjc:stiffness = 7\n        double mjc:springref = 50\n"
    found = physics(tmp_path, arm(words, "PhysicsPrismaticJoint"))
    assert found == JointPhysics(20.0, 30.0, 0.4, (7.0,), 0.5)


RADIANS = '    def PhysicsScene "s" {\n        uniform token mjc:compiler:angle = "radian"\n    }\n'


@pytest.mark.parametrize(("scene", "unit"), [("", DEGREE), (RADIANS, 1.0)], ids=["degree", "radian"])
def test_springs_of_mujoco_rest_from_where_the_stage_draws(scene: str, unit: float, tmp_path: Path) -> None:
    """In MuJoCo the coordinate is `ref` where the bodies are drawn."""
    words = "        double mjc:stiffness = 70\n        double mjc:springref = 0.5\n        double mjc:ref = 0.2\n"
    found = physics(tmp_path, arm(words, scene=scene, turn=40.0))
    assert found.stiffness == (7e-3,)
    np.testing.assert_allclose(found.rest, 40 * DEGREE + 0.3 * unit)


SAID = {
    "two that differ": (
        "float newton:armature = 2\n        float physxJoint:armature = 3",
        "physxJoint:armature 3 is another armature than newton:armature 2, which is taken",
    ),
    "a share of the load": ("float physxJoint:jointFriction = 0.1", "a share of the load on the joint"),
    "springs by their decay": ("double[] mjc:springdamper = [0.1, 1]", "a spring by how fast it swings"),
    "PhysX per axis": (
        "float physxJointAxis:angular:armature = 0.1",
        "words of PhysX for one axis are left out",
    ),
}


@pytest.mark.parametrize("name", SAID)
def test_what_is_not_taken_is_told(name: str, tmp_path: Path) -> None:
    words, said = SAID[name]
    assert said in str(stp.load(write(tmp_path, arm(f"        {words}\n"))).report)


def test_alike_in_two_words_is_told_once(tmp_path: Path) -> None:
    """Damping per degree and per radian are the same."""
    words = f"        float newton:damping = 30\n        double mjc:damping = {30 / DEGREE!r}\n"
    assert "is another" not in str(stp.load(write(tmp_path, arm(words))).report)


def test_gains_of_drives_are_no_springs(tmp_path: Path) -> None:
    drive = '"PhysicsDriveAPI:angular"'
    text = AXIS + ends("", "arm") + "        float drive:angular:physics:stiffness = 3\n"
    chain = stp.load(write(tmp_path, stage(bar("arm"), joint("j", text, schemas=drive))))
    assert chain.motors == ("j",) and not chain.mechanism.joint("j").physics
    assert "gains 3, 0 of its drive: a servo's" in str(chain.report)


def test_a_joint_with_a_rotor_stays_in_the_tree(tmp_path: Path) -> None:
    """Though the file keeps it out of its articulation."""
    aside = "        uniform bool physics:excludeFromArticulation = 1\n        float newton:armature = 2\n"
    bars = (bar("left", turn=90), bar("right", "(10, 0, 0)", 90), bar("top", "(0, 10, 0)"))
    hinges = (
        joint("a", AXIS + ends("", "left")),
        joint("b", AXIS + ends("left", "top", "(10, 0, 0)")),
        joint("c", AXIS + ends("top", "right", "(10, 0, 0)", "(10, 0, 0)") + aside),
        joint("d", AXIS + ends("", "right", "(10, 0, 0)")),
    )
    chain = stp.load(write(tmp_path, stage(*bars, *hinges)))
    assert chain.mechanism.joint("c").physics.armature == 2e-4
    assert len(chain.loops) == 1
