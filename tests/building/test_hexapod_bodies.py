"""The closed form's bodies, read off the chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.hexapod_bodies import hexapod_bodies
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Link


def test_bodies_are_those_of_the_file() -> None:
    bodies = hexapod_bodies(stp.load("stewart"))
    assert bodies.lower_joint == "universal" and bodies.platform.mass == 20.0
    np.testing.assert_array_equal(bodies.lower[3].com, [0, 0, 0.2])
    np.testing.assert_array_equal(bodies.upper[5].inertia, np.diag([0.02, 0.02, 0.001]))
    assert hexapod_bodies(stp.load("stewart_sps")).lower_joint == "spherical"


def test_further_bodies_are_refused() -> None:
    chain = stp.load("stewart")
    heavy = pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))
    links = [Link(x.name, heavy) if x.name == "leg2_cross" else x for x in chain.mechanism.links]
    with pytest.raises(UnsupportedError, match="no place for the bodies leg2_cross"):
        hexapod_bodies(build_chain(replace(chain.mechanism, links=tuple(links))))


def test_bodies_stand_where_the_leg_has_them_whatever_their_frames() -> None:
    chain = stp.load("stewart")
    aside = pin.SE3(np.eye(3), np.array([0.01, 0.0, 0.0]))
    joints = [replace(j, placement=aside) if j.name == "leg3" else j for j in chain.mechanism.joints]
    loops = [
        replace(x, placement2=x.placement2 * aside.inverse()) if x.name == "leg3_ball" else x
        for x in chain.mechanism.loops
    ]
    moved = build_chain(replace(chain.mechanism, joints=tuple(joints), loops=tuple(loops)))
    body = hexapod_bodies(moved).upper[2]
    np.testing.assert_allclose(
        body.com, chain.mechanism.link("leg3_upper").inertia.lever + [0.01, 0, 0], atol=1e-15
    )
    # A rod beside the axis of its leg: methods that share no formula agree to round-off.
    samples = stp.motions.sinusoidal_motion(
        np.linspace(0, 1, 3),
        home=stp.platform_pose(moved, moved.q_home),
        amplitude=(0.1, 0, 0.05),
        frequency=(1, 1, 1),
    )
    compared = stp.compare_methods(moved, samples, kernels=False)
    assert "closed_form" in compared.forces and compared.agreement["agreement"] < 1e-9


def test_a_cross_that_is_turned_is_refused() -> None:
    chain = stp.load("stewart")
    turned = pin.SE3(pin.exp3(np.array([0, 0, 0.5])), np.zeros(3))
    first = next(j for j in chain.mechanism.joints if j.child == "leg3_cross")
    second = next(j for j in chain.mechanism.joints if j.parent == "leg3_cross")
    told = {
        first.name: replace(first, placement=first.placement * turned),
        second.name: replace(second, placement=turned.inverse() * second.placement),
    }
    moved = build_chain(
        replace(chain.mechanism, joints=tuple(told.get(j.name, j) for j in chain.mechanism.joints), home={})
    )
    with pytest.raises(UnsupportedError, match="lower joints with the axes x, y or x, y, z"):
        hexapod_bodies(moved)
