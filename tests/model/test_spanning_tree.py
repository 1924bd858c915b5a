"""Joints that give a link a second parent are cut: which ones, and into which loops."""

from __future__ import annotations

import numpy as np
import pytest

from stewart_pin.errors import MechanismError
from stewart_pin.model.description import Joint, JointKind, Outcome
from stewart_pin.model.unfolding import cut_second_parents
from tests.mechanisms import at

R = JointKind.REVOLUTE


def joint(name: str, parent: str, child: str, **rest) -> Joint:
    return Joint(name, rest.pop("kind", R), parent, child, at(1.0), **rest)


RING = [
    joint("a", "ground", "left"),
    joint("b", "left", "top"),
    joint("c", "ground", "right"),
    joint("d", "right", "top", axis=np.array([0.0, 1.0, 0.0])),
]


def test_the_later_joint_closes_the_loop() -> None:
    tree, loops, notes = cut_second_parents(RING)
    assert [x.name for x in tree] == ["a", "b", "c"]
    (loop,) = loops
    assert (loop.name, loop.kind, loop.link1, loop.link2) == ("d", R, "right", "top")
    np.testing.assert_array_equal(loop.axis, [0, 1, 0])
    np.testing.assert_array_equal(loop.placement1.translation, [1, 0, 0])
    assert loop.placement2.isIdentity()
    assert notes[0].outcome is Outcome.CHANGED and "'left'" in notes[0].text


def test_a_motor_stays_in_the_tree() -> None:
    driven = [*RING[:3], joint("d", "right", "top", independent=True)]
    tree, loops, _ = cut_second_parents(driven)
    assert [x.name for x in tree] == ["a", "c", "d"] and [x.name for x in loops] == ["b"]


def test_two_motors_on_one_link_are_refused() -> None:
    both = [RING[0], joint("b", "left", "top", independent=True), RING[2]]
    with pytest.raises(MechanismError, match="'d' is a motor"):
        cut_second_parents([*both, joint("d", "right", "top", independent=True)])


def test_the_tree_grows_from_the_ground() -> None:
    """The joint that stands first may close the circle: only `b` leads from the ground to it."""
    circle = [joint("back", "tip", "top"), joint("a", "ground", "left"), joint("b", "left", "top")]
    tree, loops, _ = cut_second_parents([*circle, joint("c", "top", "tip")])
    assert [x.name for x in tree] == ["a", "b", "c"] and [x.name for x in loops] == ["back"]


def test_a_floating_second_parent_holds_nothing() -> None:
    with pytest.raises(MechanismError, match="holds nothing"):
        cut_second_parents([*RING[:3], joint("d", "right", "top", kind=JointKind.FLOATING)])
