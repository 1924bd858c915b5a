"""Damped vibrations, compliance, answers to shaking: textbook oscillators, whole mass matrices, small loads."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from tests.closed_states import random_configuration, robot
from tests.mechanisms import Z, at
from tests.small_urdf import MOTOR, ROD, joint, link
from tests.small_urdf import robot as robot_text

m, k, c = 3.0, 1200.0, 7.0


def cart(**physics: object) -> stp.ClosedChain:
    """Build 3 kg on a vertical slide."""
    links = (Link("ground"), Link("cart", pin.Inertia(m, np.zeros(3), 0.1 * np.eye(3))))
    joint = Joint("slide", JointKind.PRISMATIC, "ground", "cart", at(), Z, independent=True)
    chain = build_chain(Mechanism("cart", links, (joint,), platform="cart"))
    return stp.with_joint_physics(chain, {"slide": physics}) if physics else chain


def test_a_damped_oscillator_is_that_of_the_textbook() -> None:
    rate, ratio = np.sqrt(k / m), c / (2 * np.sqrt(k * m))
    by_joint = stp.natural_frequencies(cart(stiffness=k, damping=c, friction=5.0), [0.0], motor_stiffness=0.0)
    by_motor = stp.natural_frequencies(cart(), [0.0], motor_stiffness=k, motor_damping=c)
    for found in (by_joint, by_motor):
        np.testing.assert_allclose(found.frequency, [rate / (2 * np.pi)], rtol=1e-12)
        np.testing.assert_allclose(found.damping_ratio, [ratio], rtol=1e-12)
        np.testing.assert_allclose(
            found.damped_frequency, [rate * np.sqrt(1 - ratio**2) / (2 * np.pi)], rtol=1e-12
        )
    slow = stp.natural_frequencies(cart(stiffness=k, damping=200.0), [0.0], motor_stiffness=0.0)
    np.testing.assert_allclose(np.sort(-slow.poles.real), np.sort(np.roots([m, -200.0, k]).real), rtol=1e-9)
    assert not slow.damped_frequency.any() and (slow.damping_ratio == 1.0).all()
    rotor = stp.natural_frequencies(cart(stiffness=k, armature=1.0), [0.0], motor_stiffness=0.0)
    np.testing.assert_allclose(rotor.frequency, [np.sqrt(k / (m + 1.0)) / (2 * np.pi)], rtol=1e-12)
    system = stp.linearise(cart(stiffness=k, damping=c, friction=5.0), [0.0])
    np.testing.assert_allclose(system.A, [[0, 1], [-k / m, -c / m]], rtol=1e-12)


def test_springs_count_without_preload_and_their_bending_with_it() -> None:
    for preload in (False, True):
        found = stp.natural_frequencies(
            cart(stiffness=(k, 50.0, 4e3), rest=0.1), [0.3], motor_stiffness=0.0, preload=preload
        )
        slope = k + 2 * 50.0 * 0.2 + 3 * 4e3 * 0.2**2
        np.testing.assert_allclose(found.stiffness, [[slope]], rtol=1e-12)


@pytest.mark.parametrize("source", ["base", "motor_position", "motor_effort"])
def test_a_cart_answers_shaking_as_the_textbook_says(source: Any) -> None:
    f = np.array([0.0, 1.0, 3.1, 20.0])
    s = 2j * np.pi * f
    found = stp.dynamics.frequency_response(
        cart(damping=2.0), [0.0], frequency=f, source=source, motor_stiffness=k, motor_damping=c
    )
    dynamic = m * s**2 + (c + 2.0) * s + k
    expected = {
        "base": (k + (c + 2.0) * s) / dynamic,  # the damper of the joint stands on the ground as well
        "motor_position": (k + c * s) / dynamic,
        "motor_effort": 1 / dynamic,
    }[source]
    column = found.inputs.index("z" if source == "base" else "slide")
    np.testing.assert_allclose(found.values[:, 2, column], expected, rtol=1e-12)
    if source == "base":  # what the slide does not let go comes along, to the sides and turning
        np.testing.assert_allclose(found.values[:, 0, 0], 1.0, rtol=1e-12)


@pytest.mark.parametrize("name", ["stewart", "delta", "five_bar"])
def test_a_shaken_ground_moves_the_platform_as_a_floating_base_does(
    name: str, rng: np.random.Generator
) -> None:
    """M_b is a block of the mass matrix of the chain on a floating base; a tilt turns gravity."""
    chain = robot(name)
    q = random_configuration(chain, rng, 0.1)
    stiffness, damping, f = 1e6, 3e2, 4.0
    found = stp.dynamics.frequency_response(
        chain, q, frequency=[f], source="base", motor_stiffness=stiffness, motor_damping=damping
    )
    vibration = stp.natural_frequencies(chain, q, motor_stiffness=stiffness, motor_damping=damping)
    T, s = vibration.motions, 2j * np.pi * f
    floating = stp.on_floating_base(chain, base_inertia=pin.Inertia(1.0, np.zeros(3), np.eye(3)))
    whole = np.zeros(floating.nq)
    whole[6], whole[7:] = 1.0, q
    M = pin.crba(floating.model, floating.model.createData(), whole)
    M = np.triu(M) + np.triu(M, 1).T
    assert floating.tangent_names[6:] == chain.tangent_names
    share = T[chain.motor_index]
    step = 1e-6
    tilt = np.zeros((chain.nv, 6))
    for axis in range(3):  # weight as those see it who stand on the tilted ground
        ends = []
        for sign in (1, -1):
            model = chain.model.copy()
            turned = pin.exp3(-sign * step * np.eye(3)[axis]) @ chain.gravity
            model.gravity = pin.Motion(turned, np.zeros(3))
            ends.append(pin.computeGeneralizedGravity(model, model.createData(), q))
        tilt[:, 3 + axis] = (ends[0] - ends[1]) / (2 * step)
    dynamic = vibration.stiffness + s * damping * share.T @ share + s**2 * vibration.inertia
    relative = -np.linalg.solve(dynamic, T.T @ (s**2 * M[6:, :6] + tilt))
    p = stp.platform_pose(chain, q).translation
    carried = np.block([[np.eye(3), -pin.skew(p)], [np.zeros((3, 3)), np.eye(3)]])
    expected = carried + chain.at(q).P @ T @ relative
    np.testing.assert_allclose(found.values[0], expected, atol=1e-8 * np.abs(expected).max())


def test_compliance_is_what_a_load_does_and_the_inverse_of_stiffness(rng: np.random.Generator) -> None:
    for name, freedoms in (("stewart", 6), ("delta", 3), ("five_bar", 2)):
        chain = robot(name)
        q = random_configuration(chain, rng, 0.1)
        soft, stiff = (
            verb(chain, q, motor_stiffness=1e5)
            for verb in (stp.dynamics.platform_compliance, stp.dynamics.platform_stiffness)
        )
        size = chain.twist_sizes
        natural = soft * np.outer(1 / size, 1 / size)
        values = np.linalg.eigvalsh(natural)
        assert np.count_nonzero(values > 1e-9 * values.max()) == freedoms
        np.testing.assert_allclose(soft @ stiff @ soft, soft, atol=1e-9 * np.abs(soft).max())
        if freedoms == 6:
            np.testing.assert_allclose(soft @ stiff, np.eye(6), atol=1e-9)
        # Equilibrium under a small load, motors at k (x0 - x): displacement by Newton on the efforts.
        load = 1e-3 * (soft @ rng.normal(size=6)) / np.abs(soft).max()
        hold = stp.inverse_dynamics(chain, q, chain.rest, chain.rest).tau_motor
        vibration = stp.natural_frequencies(chain, q, motor_stiffness=1e5)
        move = vibration.motions[:, : chain.nu] @ np.linalg.solve(
            vibration.stiffness[: chain.nu, : chain.nu],
            vibration.motions[:, : chain.nu].T @ chain.at(q).P.T @ load,
        )
        there = stp.close_loops(chain, pin.integrate(chain.model, q, move)).q
        needed = stp.inverse_dynamics(
            chain, there, chain.rest, chain.rest, wrenches={chain.platform_link: load}
        ).tau_motor
        sprung = hold - 1e5 * (there - q)[chain.motor_q_index]
        assert np.abs(needed - sprung).max() < 1e-4 * max(
            np.abs(1e5 * (there - q)[chain.motor_q_index]).max(), 1e-9
        )


def test_what_has_no_answer_is_refused() -> None:
    natural = np.sqrt(k / m) / (2 * np.pi)
    ask = stp.dynamics.frequency_response
    with pytest.raises(SingularityError, match=r"at 3\.18\d* Hz a motion is in resonance without damping"):
        ask(cart(), [0.0], frequency=[natural], source="base", motor_stiffness=k)
    with pytest.raises(InputError, match="source must be one of motor_position"):
        ask(cart(), [0.0], frequency=[1.0], source=cast(Any, "floor"), motor_stiffness=k)
    for wrong in (-1.0, 1e200):
        with pytest.raises(InputError, match="frequency must hold"):
            ask(cart(), [0.0], frequency=[wrong], motor_stiffness=k)
    with pytest.raises(SingularityError, match="nothing holds a motion of the platform"):
        stp.dynamics.platform_compliance(cart(), [0.0], motor_stiffness=0.0)


def row_of_slides(folder: Path, first: str = "near") -> stp.ClosedChain:
    """Two masses in a row, each on a motor that slides along x; one of them alone leaves the platform a freedom."""
    slide = partial(joint, kind="prismatic", axis='<axis xyz="1 0 0"/>', attributes=MOTOR)
    file = folder / "row.urdf"
    file.write_text(
        robot_text(
            *(link(name) for name in ("base", "mass", "platform")),
            slide(first, "base", "mass"),
            slide("far", "mass", "platform"),
        )
    )
    return stp.load(file)


@pytest.mark.parametrize("springs", [(500.0, 800.0), (1e9, 1e-3), (1e-9, 1e9)])
@pytest.mark.parametrize("first", ["near", "idle 1"])
def test_springs_in_a_row_share_what_moves_the_platform(
    springs: tuple[float, float], first: str, tmp_path: Path
) -> None:
    chain = row_of_slides(tmp_path, first)
    series = sum(1 / x for x in springs)
    soft = stp.dynamics.platform_compliance(chain, chain.q_home, motor_stiffness=springs)
    stiff = stp.dynamics.platform_stiffness(chain, chain.q_home, motor_stiffness=springs)
    assert soft[0, 0] == pytest.approx(series, rel=1e-12)
    assert stiff[0, 0] == pytest.approx(1 / series, rel=1e-12)
    # A motor without stiffness gives way.
    assert stp.dynamics.platform_stiffness(chain, chain.q_home, motor_stiffness=[0.0, 5.0])[0, 0] < 1e-12


def test_slow_poles_keep_their_digits_beside_fast_ones(tmp_path: Path) -> None:
    for damping in (1e2, 1e4, 1e6, 1e8):  # m = k = 1
        slow = -2 / (damping + np.sqrt(damping**2 - 4))
        found = stp.natural_frequencies(cart(), [0.0], motor_stiffness=m, motor_damping=damping * m)
        np.testing.assert_allclose(found.poles, [slow, 1 / slow], rtol=1e-12)
        np.testing.assert_allclose(found.damping_ratio, 1.0)
    # Two masses of 1 kg, nothing holds them: their damper to the ground is slow, the one between them fast.
    chain = row_of_slides(tmp_path)
    found = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=0.0, motor_damping=[1e-9, 1.0])
    np.testing.assert_allclose(found.poles, [0, 0, -5e-10, -2], rtol=1e-6, atol=1e-16)
    found = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=[0.0, 1.0], motor_damping=[0.0, 0.1])
    np.testing.assert_allclose(found.poles, [0, 0, -0.1 + 1j * np.sqrt(1.99)], atol=1e-12)


def test_what_does_not_stay_has_no_vibrations(tmp_path: Path) -> None:
    """A rod that hangs from a cart, held aside, falls back: nothing swings about there."""
    file = tmp_path / "crane.urdf"
    file.write_text(
        robot_text(
            *(link(name) for name in ("base", "platform")),
            link("rod", ROD),
            joint("slide", "base", "platform", "prismatic", axis='<axis xyz="1 0 0"/>', attributes=MOTOR),
            joint("hinge", "platform", "rod", axis='<axis xyz="0 1 0"/>'),
        )
    )
    chain = stp.load(file)
    verbs = stp.natural_frequencies, stp.dynamics.platform_compliance, stp.dynamics.platform_stiffness
    for verb in (*verbs, partial(stp.dynamics.frequency_response, frequency=[1.0])):
        verb(chain, [0.0, np.pi / 2], motor_stiffness=1e3)
        with pytest.raises(InputError, match="no equilibrium under these efforts: 'hinge' accelerates"):
            verb(chain, [0.0, 1.0], motor_stiffness=1e3)
        verb(chain, [0.0, 1.0], motor_stiffness=1e3, preload=False)


def test_idle_rods_take_no_part_in_what_holds_the_platform() -> None:
    """Each spins freely: what round-off leaves of its stiffness neither holds it nor couples it to stiff motors."""
    for name in ("delta", "hexapod_rss", "stewart_sps"):
        chain = robot(name)
        springs = 1e4 * np.arange(1, chain.nu + 1)
        found = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=springs)
        idle = np.array([name.startswith("idle") for name in found.names])
        assert idle.any() and not found.stiffness[idle].any()
        soft = stp.dynamics.platform_compliance(chain, chain.q_home, motor_stiffness=springs)
        stiff = stp.dynamics.platform_stiffness(chain, chain.q_home, motor_stiffness=springs)
        np.testing.assert_allclose(soft @ stiff @ soft, soft, atol=1e-9 * np.abs(soft).max())
        still = stp.dynamics.frequency_response(
            chain, chain.q_home, frequency=[0.0], source="base", motor_stiffness=springs
        )
        np.testing.assert_allclose(still.values[0, :3, :3], np.eye(3), atol=1e-9)
