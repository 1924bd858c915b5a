"""Masses that a body can have, and the errors for those it cannot."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError

EVEN = stp.hexapods.RigidBody(1.0, [0, 0, 0.2], np.diag([0.02, 0.02, 0.001]))


@pytest.mark.parametrize(
    ("mass", "com", "inertia", "words"),
    [
        (-1.0, np.zeros(3), np.eye(3), "mass must not be negative, got -1 kg"),
        (np.nan, np.zeros(3), np.eye(3), "mass must be finite"),
        ("heavy", np.zeros(3), np.eye(3), "mass must be an array of real numbers"),
        (1.0, np.zeros(2), np.eye(3), "com must have shape"),
        (1.0, [0, np.inf, 0], np.eye(3), "com must be finite"),
        (1.0, np.zeros(3), np.ones(3), "inertia must have shape"),
        (1.0, np.zeros(3), np.eye(3) + np.eye(3, k=1), "inertia must be symmetric"),
        (1.0, np.zeros(3), np.diag([1.0, 1.0, -0.1]), "positive semidefinite, got a principal moment -0.1"),
        (1.0, np.zeros(3), np.diag([1.0, 1.0, 2.1]), "principal moment 2.1 kg m² exceeds 1 \\+ 1"),
    ],
)
def test_impossible_bodies_are_named(mass, com, inertia, words) -> None:
    with pytest.raises(InputError, match=words):
        stp.hexapods.RigidBody(mass, com, inertia)


def test_extreme_bodies_are_allowed(rng: np.random.Generator) -> None:
    stp.hexapods.RigidBody(0.0, np.zeros(3), np.zeros((3, 3)))
    stp.hexapods.RigidBody(1.0, np.zeros(3), np.diag([1.0, 1.0, 0.0]))  # a thin rod
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    stp.hexapods.RigidBody(
        1.0, np.zeros(3), turn @ np.diag([1.0, 2.0, 3.0]) @ turn.T
    )  # a plate, with round-off


def test_a_body_keeps_a_copy_that_cannot_change() -> None:
    com = np.zeros(3)
    body = stp.hexapods.RigidBody(1.0, com, np.eye(3))
    com[0] = 1.0
    assert body.com[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        body.inertia[0, 0] = 2.0


@pytest.mark.parametrize(
    ("com", "inertia", "expected"),
    [
        ([0, 0, 0.2], np.diag([0.02, 0.02, 0.001]), True),
        ([0, 0, 0], np.zeros((3, 3)), True),
        ([1e-6, 0, 0.2], np.diag([0.02, 0.02, 0.001]), False),
        ([0, 0, 0.2], np.diag([0.02, 0.021, 0.002]), False),
        ([0, 0, 0.2], [[0.02, 1e-4, 0], [1e-4, 0.02, 0], [0, 0, 0.001]], False),
        ([0, 0, 0.2], [[0.02, 0, 0], [0, 0.02, 1e-4], [0, 1e-4, 0.001]], False),
    ],
)
def test_axial_symmetry_is_recognised(com, inertia, expected: bool) -> None:
    assert stp.hexapods.RigidBody(1.0, com, inertia).is_axisymmetric() is expected


def test_one_leg_stands_for_six() -> None:
    bodies = stp.hexapods.HexapodBodies(EVEN, EVEN, [EVEN] * 6)
    assert bodies.lower == bodies.upper == (EVEN,) * 6


@pytest.mark.parametrize(
    ("platform", "lower", "upper", "joint", "words"),
    [
        (20.0, EVEN, EVEN, "universal", "platform must be a RigidBody, got float"),
        (EVEN, (EVEN,) * 5, EVEN, "universal", "lower must be one RigidBody or six, got 5"),
        (EVEN, EVEN, 1.5, "universal", "upper must be one RigidBody or six, got float"),
        (EVEN, EVEN, (EVEN,) * 5 + (1.5,), "universal", "upper must be one RigidBody or six"),
        (EVEN, EVEN, EVEN, "ball", "lower_joint must be 'universal' or 'spherical', got 'ball'"),
    ],
)
def test_impossible_platforms_are_named(platform, lower, upper, joint, words) -> None:
    with pytest.raises(InputError, match=words):
        stp.hexapods.HexapodBodies(platform, lower, upper, joint)
