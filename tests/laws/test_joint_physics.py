"""Laws 3 to 6 with springs, damping, dry friction and constant forces on every joint of the tree and of the loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.mechanics.constraint_matrix.system import assemble, tree_accelerations
from tests.closed_states import (
    KINDS,
    along,
    close,
    derivative,
    random_configuration,
    random_motion,
    robot,
    slow_but_for_few,
)
from tests.joint_physics import physical
from tests.mechanics.linearisation import test_dynamics_derivatives
from tests.rewritten import (
    carry_over,
    configuration_in_other_unit,
    effort_unit,
    in_other_unit,
    recut,
    tangent_unit,
)
from tests.zoo.table import ROBOTS, ZOO

AGREE = 1e-10
"""Relative; as law 5 without physics of joints."""
ROUND_TRIP = 1e-8
"""Relative; round-off times the spread of the inertias, as without physics of joints."""


@pytest.fixture(params=[*ROBOTS, *KINDS, *(pytest.param(row.name, marks=pytest.mark.slow) for row in ZOO)])
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return each bundled robot, each kind of closure and each mechanism of the zoo, with physics on every joint."""
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
    # Where friction holds everything, relative to what moves without it.
    free = stp.forward_dynamics(physical(chain.name, friction=False), q, v, tau).a / chain.tangent_scale
    size = max(np.abs(one.a / chain.tangent_scale).max(), 1e-3 * np.abs(free).max())
    assert np.abs((two.a - one.a) / chain.tangent_scale).max() <= 1e-9 * size
    if not chain.nc:
        three = stp.articulated_body_acceleration(chain, q, v, chain.motor_rows.T @ tau)
        assert np.abs((three - one.a) / chain.tangent_scale).max() <= 1e-9 * size


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


def test_power_is_the_rate_of_energy_and_heat(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    held(chain)
    model, data = chain.model, pin.Data(chain.model)
    q, v, a = state_of(chain, rng)
    effort = stp.inverse_dynamics(chain, q, v, a)
    curve = along(chain, q, v, effort.a)

    def energy(t: float) -> float:
        moved = curve(t)
        rates = v + effort.a * t
        # Not Pinocchio's kinetic energy, which forgets the rotors of hinges along no coordinate axis.
        kinetic = rates @ chain.at(moved).M @ rates / 2
        springs = stp.dynamics.joint_efforts(chain, moved).energy
        return kinetic + pin.computePotentialEnergy(model, data, moved) + springs

    heat = stp.dynamics.joint_efforts(chain, q, v).dissipation
    assert heat > 0
    motors = effort.tau_motor * v[chain.motor_index]
    # Differences see the energy's round-off divided by h, 1e-12; springs bend motions in some hundredths of a second.
    size = max(np.abs(motors).sum(), abs(energy(0.0)), heat)
    assert abs(motors.sum() - heat - derivative(energy, 1e-4)) <= 1e-8 * size


@pytest.mark.parametrize("name", slow_but_for_few([*ROBOTS, *KINDS], ["five_bar", "stewart", "planar"]))
def test_derivatives_are_those_of_efforts_and_accelerations(
    name: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = physical(name)
    held(chain)
    monkeypatch.setattr(test_dynamics_derivatives, "STEP", 3e-5)  # springs of third order bend what is asked
    test_dynamics_derivatives.require_slopes(chain, rng, None)


def test_friction_at_rest_has_no_derivative() -> None:
    chain = physical("five_bar")
    for ask in (
        lambda: stp.dynamics.inverse_dynamics_derivatives(chain, chain.q_home, chain.rest, chain.rest),
        lambda: stp.dynamics.forward_dynamics_derivatives(chain, chain.q_home, chain.rest, np.zeros(2)),
    ):
        with pytest.raises(UnsupportedError, match="at rest has no derivative: the motion left_hip"):
            ask()
    # Of motions about an equilibrium there is no other way: `linearise` says that it leaves friction out.
    assert np.isfinite(stp.linearise(chain, chain.q_home).A).all()


@pytest.mark.parametrize("name", slow_but_for_few(ROBOTS, ["five_bar", "stewart", "delta"]))
def test_another_cut_moves_the_same(name: str, rng: np.random.Generator) -> None:
    """What the cut joint does, it does in the tree here, and as a loop there."""
    chain = physical(name, anywhere=True)
    held(chain)
    other = recut(chain)
    if other is None:
        pytest.skip("no loop that could be cut elsewhere")
    q, v, a = state_of(chain, rng)
    told = carry_over(chain, other, q, v, a)
    one = stp.inverse_dynamics(chain, q, v, a)
    for method in ("pinocchio", "constraint_matrix"):
        close(stp.inverse_dynamics(other, *told, method=method).tau_motor, one.tau_motor, 1e-9)
    tau = one.tau_motor * rng.uniform(0.5, 1.5, chain.nu)
    moved = chain.at(q, v).P @ stp.forward_dynamics(chain, q, v, tau).a + chain.at(q, v).platform_bias
    there = other.at(*told[:2])
    again = there.P @ stp.forward_dynamics(other, *told[:2], tau).a + there.platform_bias
    close(again, moved, 1e-8)
    energies = [stp.dynamics.joint_efforts(x, y).energy for x, y in ((chain, q), (other, told[0]))]
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)


@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("name", ROBOTS)
def test_the_unit_of_length_changes_nothing(name: str, rng: np.random.Generator, *, rest: bool) -> None:
    chain, k = physical(name, anywhere=True), 1e3
    held(chain)
    other, tangent, unit = in_other_unit(chain, k), tangent_unit(chain, k), effort_unit(chain, k)
    q, v, a = state_of(chain, rng, rest=rest)
    told = stp.close_loops(other, configuration_in_other_unit(chain, q, k)).q
    one = stp.inverse_dynamics(chain, q, v, a)
    for method in ("pinocchio", "constraint_matrix"):
        two = stp.inverse_dynamics(other, told, v * tangent, a * tangent, method=method)
        close(two.tau_motor / unit, one.tau_motor, 1e-9)
    tau = one.tau_motor * rng.uniform(0.5, 1.5, chain.nu)
    moved = stp.forward_dynamics(chain, q, v, tau).a
    again = stp.forward_dynamics(other, told, v * tangent, tau * unit).a
    close(again / tangent / chain.tangent_scale, moved / chain.tangent_scale, 1e-8)
