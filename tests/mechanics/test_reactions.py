"""Wrenches of joints and loops: against the maximal-coordinate system, statics by hand, and the motors' efforts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.mechanics.constraint_matrix.system import assemble
from tests.closed_states import KINDS, random_configuration, random_motion, robot
from tests.mechanisms import four_bar


def at_origin(reaction: stp.dynamics.Reaction) -> np.ndarray:
    return np.concatenate([reaction.force, reaction.moment + np.cross(reaction.point, reaction.force)])


@pytest.mark.parametrize("name", ["stewart", "stewart_cad", "arm_7r", *KINDS])
def test_agrees_with_the_maximal_coordinate_system(name: str, rng: np.random.Generator) -> None:
    """Its columns, times their multipliers, are wrenches on the successor of each joint."""
    chain = robot(name)
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    effort = stp.inverse_dynamics(chain, q, v, a)
    found = {reaction.name: reaction for reaction in stp.joint_reactions(chain, q, v, effort)}
    assembled = assemble(chain, q, v, effort.a)
    system = assembled.system
    unknowns = np.linalg.lstsq(system.matrix.toarray(), system.right_hand_side, rcond=1e-12)[0]
    multipliers, matrix = unknowns[system.f_p.size :], system.C.toarray()
    expected: dict[str, np.ndarray] = {}
    for joint, columns in zip(system.joints, system.columns, strict=True):
        compounds = [
            c
            for c in assembled.topology.tree
            if joint == c.name or joint.removeprefix("motor ") in c.name.split("+")
        ]
        parts = [(p.name, c.successor) for c in compounds for p in c.parts]
        parts += [(x.name, x.successor) for x in assembled.topology.loops if x.name == joint]
        for part, body in parts:
            row = 6 * system.bodies.index(body)
            wrench = matrix[row : row + 6, columns] @ multipliers[columns]
            expected[part] = expected.get(part, np.zeros(6)) + wrench
    geared = {c.joint1 for c in chain.couplings} | {c.joint2 for c in chain.couplings}
    checked = 0
    for part, reaction in found.items():
        if part in geared or not reaction.unique or part not in expected:
            continue
        size = max(np.abs(x).max() for x in expected.values())
        np.testing.assert_allclose(at_origin(reaction), expected[part], atol=1e-9 * size)
        checked += 1
    # Columns of gears act on several bodies at once: what they add to one joint does not stand alone.
    assert checked >= (1 if geared else 2)


def test_a_motor_s_effort_is_along_its_axis(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    effort = stp.inverse_dynamics(chain, q, v, a)
    reactions = {x.name: x for x in stp.joint_reactions(chain, q, v, effort)}
    pose = stp.platform_pose(chain, q)
    base, platform = chain.leg_points()
    for motor, tau, foot, head in zip(chain.motors, effort.tau_motor, base, platform, strict=True):
        along = pose.act(head) - foot
        along /= np.linalg.norm(along)
        # Positive pushes the platform away.
        assert reactions[motor].force @ along == pytest.approx(tau, rel=1e-10)


def test_the_ground_carries_the_weight() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    effort = stp.inverse_dynamics(chain, chain.q_home, rest, rest)
    reactions = stp.joint_reactions(chain, chain.q_home, rest, effort)
    from_ground = sum(x.force for x in reactions if x.source == chain.mechanism.root)
    moving = sum(
        link.inertia.mass
        for link in chain.mechanism.links
        if link.inertia is not None and link.name != chain.mechanism.root
    )
    np.testing.assert_allclose(from_ground, [0, 0, 9.81 * moving], atol=1e-10)
    balls = [x for x in reactions if x.source == "platform"]
    assert len(balls) == 6
    np.testing.assert_allclose([x.moment for x in balls], 0, atol=1e-12)
    # The platform gives the legs its weight.
    np.testing.assert_allclose(sum(x.force for x in balls), [0, 0, -9.81 * 20.0], atol=1e-10)


def test_shared_loads_are_marked() -> None:
    """A planar four-bar closed by a hinge: what presses out of its plane, no rigid body decides."""
    chain = four_bar("revolute")
    rest = np.zeros(chain.nv)
    effort = stp.inverse_dynamics(chain, chain.q_home, rest, rest)
    reactions = stp.joint_reactions(chain, chain.q_home, rest, effort)
    assert not any(x.unique for x in reactions)
    assert all(np.isfinite(x.force).all() and np.isfinite(x.moment).all() for x in reactions)


def test_efforts_of_another_state_are_refused(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    effort = stp.inverse_dynamics(chain, chain.q_home, rest, rest)
    with pytest.raises(InputError, match="does not belong to this state"):
        stp.joint_reactions(chain, chain.q_home, rest, replace(effort, tau_motor=effort.tau_motor + 1.0))
