"""What joints do by themselves is written and read back: rotors, damping, friction, springs, constant forces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import JointKind, Mechanism, Outcome, physics_coordinates
from stewart_pin.model.joint_physics import JointPhysics
from tests.building.test_what_survives import FORMATS
from tests.closed_states import KINDS, robot

ROBOTS = ("stewart", "five_bar", "four_bar", "delta")


def draw(rng: np.random.Generator, powers: int = 3) -> JointPhysics:
    """Draw everything that a coordinate may do."""
    armature, damping, friction, rest, force = rng.uniform(0.1, 1, 5)
    return JointPhysics(
        armature, damping, friction, tuple(rng.uniform(1, 9, powers)), rest - 0.5, force - 0.5
    )


def drawn(mechanism: Mechanism, rng: np.random.Generator, *, loops: bool = True) -> Mechanism:
    """Give all joints and loops of a mechanism all that they may do."""

    def of_joint(kind: JointKind) -> JointPhysics:
        whole = draw(rng)
        if kind is JointKind.FIXED:
            return JointPhysics()
        if kind is JointKind.SPHERICAL:
            return replace(whole, stiffness=whole.stiffness[:1], rest=0.0, force=0.0)
        return replace(whole, stiffness=(), rest=0.0, force=0.0) if kind is JointKind.FLOATING else whole

    def of_loop(kind: JointKind) -> tuple[JointPhysics, ...]:
        whole = tuple(replace(draw(rng), armature=0.0) for _ in physics_coordinates(kind))
        ball = kind is JointKind.SPHERICAL
        return tuple(
            JointPhysics(damping=each.damping, stiffness=each.stiffness[:1]) if ball else each
            for each in whole
        )

    return replace(
        mechanism,
        joints=tuple(replace(joint, physics=of_joint(joint.kind)) for joint in mechanism.joints),
        loops=tuple(replace(loop, physics=of_loop(loop.kind) if loops else ()) for loop in mechanism.loops),
    )


def physics(mechanism: Mechanism) -> dict[str, tuple[JointPhysics, ...]]:
    told = {joint.name: (joint.physics,) for joint in mechanism.joints if joint.physics}
    return told | {loop.name: loop.physics for loop in mechanism.loops if any(loop.physics)}


def close(mine: Mechanism, theirs: Mechanism) -> None:
    """Compare what all joints do; rests are counted from other zeros in some files."""
    one, two = physics(mine), physics(theirs)
    assert one.keys() == two.keys()
    for name in one:
        for here, there in zip(one[name], two[name], strict=True):
            assert replace(here, rest=0.0) == replace(there, rest=0.0), name
            assert abs(here.rest - there.rest) < 1e-14 * max(1.0, abs(here.rest)), name


def exact(format: str, name: str) -> bool:
    return format == "urdf+" or (
        format == "sdf" and name not in ("cylindrical", "planar", "point_on_line", "distance", "cable")
    )


@pytest.mark.parametrize(
    ("format", "name"),
    [
        (f, n)
        for f in ("urdf+", "sdf")
        for n in (*ROBOTS, *KINDS)
        if exact(f, n) and (f, n) != ("sdf", "gear_train")
    ],
)
def test_everything_comes_back(format: str, name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    chain = build_chain(drawn(robot(name).described(), rng))
    path = tmp_path / f"a.{FORMATS[format]}"
    stp.export(chain, path, format=format)
    close(chain.described(), stp.load(path).described())


@pytest.mark.parametrize("format", ["drake", "isaac", "gepetto"])
@pytest.mark.parametrize("name", ["stewart", "delta", "spherical"])
def test_dialects_keep_joints_and_tell_what_loops_lose(
    format: str, name: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    chain = build_chain(drawn(robot(name).described(), rng))
    report = stp.export(chain, tmp_path / "a.urdf", format=format)
    again = stp.load(tmp_path / "a.urdf")
    close(replace(chain.described(), loops=()), again.described())
    for loop in chain.loops:
        own = [note.text for note in report.notes if note.subject == f"loop '{loop.name}'"]
        (told,) = (text for text in own if "of its turn left out" in text)
        assert all(f"{value:g}" in told for value in (loop.physics[0].damping, *loop.physics[0].stiffness))
    # Others hear damping; of springs only we do, and the report says so with their numbers.
    sprung = [joint for joint in chain.described().joints if joint.physics.stiffness]
    kept = {note.subject: note.text for note in report.notes if note.outcome is Outcome.KEPT}
    assert sprung and all(f"{j.physics.stiffness[0]:g}" in kept[f"joint '{j.name}'"] for j in sprung)
