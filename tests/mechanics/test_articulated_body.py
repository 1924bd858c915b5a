"""The three passes against Pinocchio's algorithm and against laws (S2.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.geometry.rotations import rotation_from_rpy
from tests.closed_states import NAMES
from tests.mechanics.joint_zoo import joint_zoo


def _random_state(chain: stp.ClosedChain, rng: np.random.Generator):
    q = pin.integrate(chain.model, chain.q_home, rng.normal(size=chain.nv))
    return q, rng.normal(size=chain.nv), rng.normal(0, 30, chain.nv)


def _worst(chain: stp.ClosedChain, rng: np.random.Generator) -> float:
    """Largest difference from Pinocchio's algorithm over random states, relative."""
    data, worst = pin.Data(chain.model), 0.0
    for _ in range(20):
        q, v, tau = _random_state(chain, rng)
        reference = pin.aba(chain.model, data, q, v, tau)
        ours = stp.articulated_body_acceleration(chain, q, v, tau)
        worst = max(worst, np.abs(ours - reference).max() / np.abs(reference).max())
    return worst


@pytest.mark.parametrize("name", NAMES)
def test_equals_pinocchio_on_every_robots_tree(name: str, rng: np.random.Generator) -> None:
    assert _worst(stp.load(name), rng) <= 1e-12


@pytest.mark.parametrize("gravity", [(0, 0, 0), (3, -2, -9)])
def test_equals_pinocchio_for_every_kind_of_joint(gravity, rng: np.random.Generator) -> None:
    mechanism = joint_zoo(rng)
    assert {joint.kind for joint in mechanism.joints} >= {
        "revolute", "prismatic", "spherical", "floating", "fixed"
    }  # fmt: skip
    assert _worst(build_chain(mechanism, gravity=gravity), rng) <= 1e-12


@pytest.mark.parametrize("name", NAMES)
def test_equals_pinocchio_on_a_free_base(name: str, rng: np.random.Generator) -> None:
    bus = pin.Inertia(50.0, np.array([0.1, 0.0, 0.05]), np.diag([3.0, 4.0, 5.0]))
    assert _worst(stp.on_floating_base(stp.load(name), bus), rng) <= 1e-12


def test_a_carried_base_is_a_free_base_whose_motion_is_known(rng: np.random.Generator) -> None:
    # Rows of the free chain's equation of motion below the base, with the base's acceleration put in.
    for name in ("arm_7r", "arm_3r_spatial"):
        chain = stp.load(name)
        bus = pin.Inertia(1.0, np.zeros(3), np.eye(3))
        free = stp.on_floating_base(chain, bus)
        data = pin.Data(free.model)
        q = pin.integrate(free.model, free.q_home, rng.normal(size=free.nv))
        v, tau, acceleration = rng.normal(size=free.nv), rng.normal(size=chain.nv), rng.normal(size=6)
        rotation = pin.XYZQUATToSE3(q[:7]).rotation
        twist = np.concatenate([rotation @ v[:3], rotation @ v[3:6]])
        base = stp.dynamics.BaseMotion(rotation, twist, acceleration)
        ours = stp.articulated_body_acceleration(chain, q[7:], v[6:], tau, base_motion=base)
        inertia = pin.crba(free.model, data, q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        bias = pin.nonLinearEffects(free.model, data, q, v)
        # Free-flyer acceleration: body components, d(body velocity)/dt = Rᵀ a - ω × v.
        known = np.concatenate(
            [rotation.T @ acceleration[:3] - np.cross(v[3:6], v[:3]), rotation.T @ acceleration[3:]]
        )
        wanted = np.linalg.solve(inertia[6:, 6:], tau - bias[6:] - inertia[6:, :6] @ known)
        np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


def test_only_acceleration_and_turning_of_the_base_matter(rng: np.random.Generator) -> None:
    chain = stp.load("arm_7r")
    q, v, tau = _random_state(chain, rng)
    still = stp.articulated_body_acceleration(chain, q, v, tau)
    sailing = stp.dynamics.BaseMotion(twist=np.array([12.0, -3.0, 1.0, 0, 0, 0]))
    moved = stp.articulated_body_acceleration(chain, q, v, tau, base_motion=sailing)
    np.testing.assert_allclose(moved, still, rtol=0, atol=1e-11 * np.abs(still).max())
    # A base that falls freely is one without gravity (equivalence); a tilted base has tilted gravity.
    falling = stp.dynamics.BaseMotion(acceleration=np.concatenate([chain.gravity, np.zeros(3)]))
    weightless = stp.load("arm_7r", gravity=(0, 0, 0))
    np.testing.assert_allclose(
        stp.articulated_body_acceleration(chain, q, v, tau, base_motion=falling),
        stp.articulated_body_acceleration(weightless, q, v, tau),
        rtol=0,
        atol=1e-11 * np.abs(still).max(),
    )
    tilt = rotation_from_rpy(0.3, -0.2, 0.1)
    tilted = stp.load("arm_7r", gravity=tilt.T @ chain.gravity)
    np.testing.assert_allclose(
        stp.articulated_body_acceleration(chain, q, v, tau, base_motion=stp.dynamics.BaseMotion(tilt)),
        stp.articulated_body_acceleration(tilted, q, v, tau),
        rtol=0,
        atol=1e-11 * np.abs(still).max(),
    )


def test_a_joint_without_inertia_is_named() -> None:
    chain = stp.massless_legs(stp.load("stewart"))
    zero = np.zeros(chain.nv)
    with pytest.raises(SingularityError, match=r"joint 'leg6.*moves nothing that has inertia") as caught:
        stp.articulated_body_acceleration(chain, chain.q_home, zero, zero)
    assert caught.value.smallest_singular_value == 0.0
    # A link without inertia is harmless as long as something heavy hangs on it.
    arm = stp.load("arm_3r_planar")
    links = [replace(x, inertia=None) if x.name == "link1" else x for x in arm.mechanism.links]
    light = build_chain(replace(arm.mechanism, links=tuple(links)))
    assert np.isfinite(
        stp.articulated_body_acceleration(light, [0.1, 0.5, 0.2], np.ones(3), np.ones(3))
    ).all()


@pytest.mark.parametrize(
    ("q", "v", "tau", "words"),
    [
        (np.zeros(2), np.zeros(3), np.zeros(3), "q must have shape"),
        (np.zeros(3), np.zeros((1, 3)), np.zeros(3), "v must have shape"),
        (np.zeros(3), np.zeros(3), [0, np.inf, 0], "tau must be finite"),
    ],
)
def test_bad_states_are_named(q, v, tau, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.articulated_body_acceleration(stp.load("arm_3r_planar"), q, v, tau)


def test_bad_base_motions_are_named() -> None:
    with pytest.raises(InputError, match="twist must have shape"):
        stp.dynamics.BaseMotion(twist=np.zeros(3))
    with pytest.raises(InputError, match="rotation must hold rotation matrices"):
        stp.dynamics.BaseMotion(2 * np.eye(3))
