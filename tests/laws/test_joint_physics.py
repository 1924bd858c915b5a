"""Laws 3 to 6 with springs, damping, dry friction and constant forces on every joint of the tree and of the loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.mechanics.constraint_matrix.system import assemble, tree_accelerations
from tests.closed_states import KINDS, close, random_configuration, random_motion, robot
from tests.joint_physics import physical
from tests.zoo.table import ROBOTS

AGREE = 1e-10
"""Relative; as law 5 without physics of joints."""
ROUND_TRIP = 1e-8
"""Relative; round-off times the spread of the inertias, as without physics of joints."""


@pytest.fixture(params=[*ROBOTS, *KINDS])
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return each bundled robot and each kind of closure, with physics on every joint."""
    return physical(request.param)


def state_of(
    chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a closed configuration with a motion, or with one that is about to start."""
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    if rest:
        motions = chain.at(q).freedom.motions
        v, a = chain.rest, motions @ rng.normal(size=motions.shape[1])
    return q, v, a


def held(chain: stp.ClosedChain) -> None:
    if not stp.mobility(chain).motors_sufficient:
        pytest.skip(f"the motors of {chain.name} do not hold it")


@pytest.mark.parametrize("rest", [False, True])
def test_methods_agree(chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool) -> None:
    held(chain)
    q, v, a = state_of(chain, rng, rest=rest)
    one = stp.inverse_dynamics(chain, q, v, a)
    two = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix")
    close(two.tau_motor, one.tau_motor, AGREE)
    close(two.a / chain.tangent_scale, one.a / chain.tangent_scale, AGREE)
    if one.reactions_unique:
        close(two.lambda_c * chain.row_sizes, one.lambda_c * chain.row_sizes, AGREE)


def test_methods_agree_on_what_is_held(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    held(chain)
    q = random_configuration(chain, rng)
    one = stp.inverse_dynamics(chain, q, chain.rest, chain.rest)
    two = stp.inverse_dynamics(chain, q, chain.rest, chain.rest, method="constraint_matrix")
    close(two.tau_motor, one.tau_motor, AGREE)
    assert one.a / chain.tangent_scale == pytest.approx(two.a / chain.tangent_scale, abs=AGREE, rel=AGREE)
    assert one.band is not None and two.band is not None
    close(two.band, one.band, AGREE)


@pytest.mark.parametrize("rest", [False, True])
def test_forward_and_inverse_undo_each_other(
    chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool
) -> None:
    held(chain)
    q, v, a = state_of(chain, rng, rest=rest)
    effort = stp.inverse_dynamics(chain, q, v, a)
    back = stp.forward_dynamics(chain, q, v, effort.tau_motor)
    close(back.a / chain.tangent_scale, effort.a / chain.tangent_scale, ROUND_TRIP)
    tau = effort.tau_motor + 0.1 * rng.normal(size=chain.nu) * np.abs(effort.tau_motor).max()
    again = stp.inverse_dynamics(chain, q, v, stp.forward_dynamics(chain, q, v, tau).a)
    slack = ROUND_TRIP * np.abs(tau).max()
    least, most = (again.tau_motor,) * 2 if again.band is None else again.band.T
    assert (tau >= least - slack).all() and (tau <= most + slack).all()


@pytest.mark.parametrize("name", KINDS)
def test_friction_holds_the_motor_within_its_band(name: str, rng: np.random.Generator) -> None:
    # All but the motor is idle there: some of it slips, the rest is held, and holds the motor.
    chain = physical(name)
    if chain.nu > 1:
        pytest.skip("bands of several motors hang together")
    q = random_configuration(chain, rng)
    effort = stp.inverse_dynamics(chain, q, chain.rest, chain.rest)
    assert effort.band is not None
    least, most = effort.band[0]
    for share, moves in ((-0.01, -1), (0.01, 0), (0.99, 0), (1.01, 1)):
        a = stp.forward_dynamics(chain, q, chain.rest, [least + share * (most - least)]).a
        own = a[chain.motor_index[0]] / chain.tangent_scale[chain.motor_index[0]]
        assert np.sign(own) * (abs(own) > 1e-9) == moves


@pytest.mark.parametrize("rest", [False, True])
def test_articulated_bodies_agree(chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool) -> None:
    q, v, _ = state_of(chain, rng, rest=rest)
    tau = rng.normal(size=chain.nu) * float(np.abs(chain.at(q).nle).max())
    one = stp.forward_dynamics(chain, q, v, tau)
    two = stp.dynamics.closed_chain_articulated_body(chain, q, v, tau)
    close(two.a / chain.tangent_scale, one.a / chain.tangent_scale, 1e-9)
    if not chain.nc:
        three = stp.articulated_body_acceleration(chain, q, v, chain.motor_rows.T @ tau)
        close(three, one.a, 1e-9)


@pytest.mark.parametrize("rest", [False, True])
def test_reactions_accelerate_every_body(
    chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool
) -> None:
    # Newton and Euler in the world, by the bodies of the constraint matrix without what joints do.
    held(chain)
    q, v, a = state_of(chain, rng, rest=rest)
    effort = stp.inverse_dynamics(chain, q, v, a)
    reactions = stp.joint_reactions(chain, q, v, effort)
    bare = robot(chain.name)
    assembled = assemble(bare, q, v, effort.a)
    system, layout = assembled.system, assembled.topology
    bodies = tree_accelerations(layout, assembled.freedoms, effort.a)
    needed = dict(zip(system.bodies, (system.f_p + system.I @ bodies).reshape(-1, 6), strict=True))
    found = {link.name: np.zeros(6) for link in chain.mechanism.links}
    for each in reactions:
        wrench = np.concatenate([each.force, each.moment + np.cross(each.point, each.force)])
        found[each.target] += wrench
        found[each.source] -= wrench
    size = max(np.abs(wrench).max() for wrench in found.values())
    carried = {joint.child: joint.parent for joint in chain.mechanism.joints if joint.kind == "fixed"}
    for link in chain.mechanism.links:
        bearer = link.name
        while bearer in carried and bearer not in needed:
            bearer = carried[bearer]
        if bearer != link.name:
            found[bearer] += found.pop(link.name)
    for name, wrench in found.items():
        if name != chain.mechanism.root:
            assert wrench == pytest.approx(needed.get(name, np.zeros(6)), abs=1e-9 * size)


def test_motors_may_leave_reactions_to_friction(rng: np.random.Generator) -> None:
    chain = physical("stewart")
    q = random_configuration(chain, rng)
    effort = stp.inverse_dynamics(chain, q, chain.rest, chain.rest)
    pushed = replace(effort, tau_motor=effort.tau_motor + 0.1)  # friction of the legs takes it
    one, two = (stp.joint_reactions(chain, q, chain.rest, each) for each in (effort, pushed))
    for a, b in zip(one, two, strict=True):
        assert a.force == pytest.approx(b.force, rel=1e-9, abs=1e-9)
    with pytest.raises(InputError, match="does not belong to this state"):
        beyond = replace(effort, tau_motor=effort.tau_motor + 1e6)
        stp.joint_reactions(chain, q, chain.rest, beyond)
