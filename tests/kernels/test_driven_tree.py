"""The whole tree driven by its platform or its motors, where idle freedoms carry no momentum."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import null_space

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.driven_tree import (
    Coordinates,
    DrivenTree,
    drive_tree,
    driven_forward_dynamics,
    driven_inverse_dynamics,
)
from stewart_pin.kernels.graph.platform_kinematics import platform_columns
from stewart_pin.kernels.graph.whole_tree import close_tree
from stewart_pin.model.description import JointKind
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, random_configuration, robot
from tests.kernels.platforms import skew_rods
from tests.zoo.table import ZOO

ONE_FREEDOM = (JointKind.REVOLUTE, JointKind.PRISMATIC)


@cache
def driven(coordinates: Coordinates) -> DrivenTree:
    return drive_tree(close_tree(skew_rods()), coordinates)


def drive(chain: stp.ClosedChain, coordinates: Coordinates, q: np.ndarray) -> np.ndarray:
    return chain.at(q).P if coordinates == "platform" else np.eye(chain.nv)[chain.motor_index]


@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_idle_freedoms_carry_no_momentum(coordinates: Coordinates, rng: np.random.Generator) -> None:
    tree = driven(coordinates)
    chain = tree.closed.chain
    assert tree.idle.shape[1] == 6
    inverse, forward = driven_inverse_dynamics(tree), driven_forward_dynamics(tree)
    for _ in range(2):
        q = random_configuration(chain, rng, 0.1)
        rows = np.vstack([stp.loop_jacobian(chain, q), drive(chain, coordinates, q)])
        velocity, acceleration = rng.normal(size=(2, rows.shape[0] - chain.nc))
        v = np.linalg.lstsq(rows, np.concatenate([np.zeros(chain.nc), velocity]), rcond=1e-10)[0]
        idle, M = null_space(rows, rcond=1e-10), chain.at(q).M
        v = v - idle @ np.linalg.solve(idle.T @ M @ idle, idle.T @ M @ v)
        bias = chain.at(q, v).platform_bias if coordinates == "platform" else np.zeros(chain.nu)
        demand = np.concatenate([-stp.loop_bias(chain, q, v), acceleration - bias])
        a = np.linalg.lstsq(rows, demand, rcond=1e-10)[0]
        tau_motor, infeasible = inverse.call([ca.DM(x) for x in (q, velocity, acceleration)])
        expected = stp.inverse_dynamics(chain, q, v, a).tau_motor
        close(np.array(tau_motor).ravel(), expected, 1e-10)
        assert float(infeasible) == 0.0
        moved = stp.forward_dynamics(chain, q, v, expected).a
        found = forward.call([ca.DM(x) for x in (q, velocity, expected)])[0]
        close(np.array(found).ravel(), drive(chain, coordinates, q) @ moved + bias, 1e-10)


def test_platform_columns_are_its_jacobian(rng: np.random.Generator) -> None:
    tree = driven("platform")
    chain, closed = tree.closed.chain, tree.closed
    q = random_configuration(chain, rng, 0.1)
    columns = ca.Function("columns", [closed.q], [platform_columns(closed)])
    close(np.array(columns(q)).T, chain.at(q).P, 1e-12)


@pytest.mark.parametrize(
    "verb", ["inverse_dynamics", "reactions", "regressor", "forward_dynamics", "inverse_dynamics_derivatives"]
)
def test_what_spare_motors_cannot_do_together_is_refused(verb: str) -> None:
    """Two cranks of a parallelogram turn alike: whichever rows are solved for, the others are looked at."""
    chain = stp.with_motors(robot("parallelogram"), ["crank_turn", "rocker_turn"])
    kernels, status = stp.compile_kernels(chain, coordinates="motor"), np.empty(4, dtype=np.int8)
    position = np.tile(stp.motor_positions(chain, chain.q_home), (4, 1))
    rate, other = (
        np.array([[1.0, 1], [1, -1], [0, 0], [0, 50]]),
        np.array([[0.0, 0], [0, 0], [1, -1], [0, 0]]),
    )
    found = getattr(kernels, verb)(position, rate, other, status=status)
    possible = [True, False, verb == "forward_dynamics", False]  # efforts may differ
    assert (status == StateStatus.OK).tolist() == possible
    assert (status[~np.array(possible)] == StateStatus.OUT_OF_BOUNDS).all()
    first = found[0] if isinstance(found, tuple) else found
    assert np.isnan(first[~np.array(possible)]).all() and np.isfinite(first[possible]).all()


@pytest.mark.slow
def test_impossible_rates_of_spare_motors_are_refused_everywhere(rng: np.random.Generator) -> None:
    """One or two motors more than freedoms, on joints drawn at random."""
    seen = 0
    for row in ZOO:
        plain = robot(row.name)
        single = [joint.name for joint in plain.mechanism.joints if joint.kind in ONE_FREEDOM]
        dof = plain.generic.count.dof
        if plain.nv > 10 or plain.generic.count.idle or len(single) < dof + 1:
            continue
        chain = stp.with_motors(plain, list(rng.permutation(single)[: dof + 1 + seen % 2]))
        possible = chain.home_state().freedom.motions[chain.motor_index]
        if np.linalg.matrix_rank(possible, 1e-6) < dof:
            continue
        rate = rng.normal(size=chain.nu)
        if np.abs(rate - possible @ np.linalg.lstsq(possible, rate, rcond=None)[0]).max() < 1e-3:
            continue
        try:
            kernels = stp.compile_kernels(chain, coordinates="motor", engine="numpy")
        except UnsupportedError:
            continue
        seen += 1
        home, still = stp.motor_positions(chain, chain.q_home)[None], np.zeros((1, chain.nu))
        status = np.zeros(1, dtype=np.int8)
        for given in ((rate[None], still), (still, rate[None])):
            kernels.inverse_dynamics(home, *given, status=status)
            assert status[0] == StateStatus.OUT_OF_BOUNDS, row.name
    assert seen >= 20


RSSR = """<robot name="rssr"><link name="base"/>
<link name="crank"><inertial><mass value="1"/><inertia ixx=".02" ixy="0" ixz="0" iyy=".03" iyz="0" izz=".04"/>
</inertial></link><link name="rod"><inertial><origin xyz=".2 0 0"/><mass value="1"/>
<inertia ixx=".001" ixy="0" ixz="0" iyy=".02" iyz="0" izz=".02"/></inertial></link>
<link name="platform"><inertial><origin xyz="0 .2 .1"/><mass value="2"/>
<inertia ixx=".02" ixy="0" ixz="0" iyy=".03" iyz="0" izz=".04"/></inertial></link>
<joint name="crank_turn" type="continuous" independent="true"><parent link="base"/><child link="crank"/>
<axis xyz="0 0 1"/></joint>
<joint name="rod_ball" type="spherical"><parent link="crank"/><child link="rod"/><origin xyz=".1 .3 0"/></joint>
<joint name="rocker_turn" type="continuous"><parent link="base"/><child link="platform"/><origin xyz="1.1 .1 -.3"/>
<axis xyz="1 .2 .1"/></joint>
<loop name="loop1" type="spherical"><predecessor link="rod"><origin xyz=".8 0 0"/></predecessor>
<successor link="platform"><origin xyz="-.2 .2 .3"/></successor></loop></robot>"""


def test_reactions_in_axes_that_spin_idly_are_refused(tmp_path: Path) -> None:
    """Neither platform nor motors say where a rod between two balls has turned to; of the platform's axes they do."""
    path = tmp_path / "rssr.urdf"
    path.write_text(RSSR)
    chain, still = stp.load(path), np.zeros((1, 1))
    kernels = stp.compile_kernels(chain, coordinates="motor")
    with pytest.raises(UnsupportedError, match="'loop1' are told in axes of 'rod'"):
        kernels.reactions(still, still, still)
    q, rest = chain.q_home[None], np.zeros((1, chain.nv))
    by_tree = stp.compile_kernels(chain, coordinates="tree").reactions(q, rest, rest)
    close(by_tree[0], stp.inverse_dynamics(chain, q[0], rest[0], rest[0]).lambda_c, 1e-10)
    for told, other in (("predecessor", "@"), ("successor", "predecessor"), ("@", "successor")):
        path.write_text(path.read_text().replace(told, other))
    turned = stp.load(path)
    found = stp.compile_kernels(turned, coordinates="motor").reactions(still, still, still)
    close(found[0], stp.inverse_dynamics(turned, turned.q_home, rest[0], rest[0]).lambda_c, 1e-10)
