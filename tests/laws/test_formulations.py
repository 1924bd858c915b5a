"""Law 5: formulations that share no formula give the same forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from tests.closed_states import close, random_motion, robot
from tests.laws.conftest import Case, round_off_of_accelerations, round_off_of_efforts

AGREEMENT = (
    1e-10  # relative; measured 1e-13 at generic poses, 1e-11 where the smallest singular value is 1e-3
)


def test_constraint_matrix_equals_pinocchio(held: Case, rng: np.random.Generator) -> None:
    chain = held.chain
    for _ in range(3):
        v, a = random_motion(chain, rng, held.q)
        one = stp.inverse_dynamics(chain, held.q, v, a)
        two = stp.inverse_dynamics(chain, held.q, v, a, method="constraint_matrix")
        tolerance = round_off_of_efforts(replace(held, v=v), AGREEMENT, one)
        close(two.tau_motor, one.tau_motor, tolerance)
        close(
            two.a / chain.tangent_scale,
            one.a / chain.tangent_scale,
            round_off_of_accelerations(held, AGREEMENT, one),
        )
        assert (two.unique, two.reactions_unique) == (one.unique, one.reactions_unique)
        if chain.nc:
            # The least of many reactions also sees the round-off of the null space, which a near singularity turns.
            tolerance = tolerance if one.reactions_unique else 10 * tolerance
            if chain.generic.rank:
                close(two.lambda_c, one.lambda_c, tolerance)
            else:  # rows that repeat what the joints hold: the least reactions are none
                assert np.abs(two.lambda_c - one.lambda_c).max() <= tolerance * np.abs(one.tau_motor).max()


def leg_parts(chain: stp.ClosedChain) -> tuple[stp.Hexapod, stp.hexapods.HexapodBodies] | None:
    """Geometry and bodies of a chain that is a six-legged platform with the usual names, otherwise None."""
    names = [f"leg{i}_{part}" for part in ("lower", "upper") for i in range(1, 7)]
    links = {link.name: link.inertia for link in chain.mechanism.links}
    try:
        hexapod = stp.Hexapod.from_chain(chain)
    except (UnsupportedError, ValueError):
        return None
    if any(links.get(name) is None for name in names):
        return None
    bodies = [
        stp.hexapods.RigidBody(y.mass, y.lever, y.inertia)
        for y in (links[n] for n in (chain.platform, *names))
    ]
    kind = "spherical" if len(stp.mobility(chain).idle) == 6 else "universal"
    return hexapod, stp.hexapods.HexapodBodies(bodies[0], tuple(bodies[1:7]), tuple(bodies[7:]), kind)


def test_closed_form_equals_pinocchio(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    parts = leg_parts(chain)
    if parts is None:
        pytest.skip("no six-legged platform of the closed form's kind")
    for _ in range(5):
        pose, twist, acceleration = platform_state(chain, rng)
        # From home, where the legs of spherical joints are unspun, as the closed form takes them to be.
        state = stp.platform_motion(chain, pose, twist, acceleration, limits=False)
        effort = stp.inverse_dynamics(chain, state.q, state.v, state.a)
        forces = stp.hexapods.hexapod_inverse_dynamics(
            *parts, pose.translation, pose.rotation, twist, acceleration, gravity=chain.gravity
        )
        close(effort.tau_motor, forces.actuator, AGREEMENT)


def platform_state(
    chain: stp.ClosedChain, rng: np.random.Generator
) -> tuple[pin.SE3, np.ndarray, np.ndarray]:
    """Pose within 0.2 m and 20° of home (larger robots: in proportion), with a twist and an acceleration."""
    home, size = stp.platform_pose(chain, chain.q_home), max(1.0, chain.length_scale)
    turn = Rotation.from_euler("xyz", rng.uniform(-20, 20, 3), degrees=True).as_matrix()
    pose = pin.SE3(turn @ home.rotation, home.translation + 0.2 * size * rng.uniform(-1, 1, 3))
    unit = np.array([size, size, size, 1, 1, 1])
    return pose, unit * rng.normal(size=6), unit * rng.normal(size=6)


def test_massless_legs_equal_the_point_mass(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    if leg_parts(chain) is None:
        pytest.skip("no six-legged platform")
    assert worst_difference_from_point_mass(chain, rng, 20) <= AGREEMENT


@pytest.mark.slow  # 15 s each on an idle core
@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_massless_legs_equal_the_point_mass_over_1000_states(name: str, rng: np.random.Generator) -> None:
    assert worst_difference_from_point_mass(robot(name), rng, 1000) <= AGREEMENT


def worst_difference_from_point_mass(chain: stp.ClosedChain, rng: np.random.Generator, n: int) -> float:
    """Largest relative difference over n random states, both methods in turn."""
    light, hexapod = stp.massless_legs(chain, point_platform=True), stp.Hexapod.from_chain(chain)
    mass = chain.mechanism.link(chain.platform).inertia.mass
    worst = 0.0
    for k in range(n):
        pose, twist, acceleration = platform_state(chain, rng)
        state = stp.platform_motion(light, pose, twist, acceleration, limits=False)
        method = ("pinocchio", "constraint_matrix")[k % 2]
        tau_motor = stp.inverse_dynamics(light, state.q, state.v, state.a, method=method).tau_motor
        forces = stp.point_mass_forces(
            hexapod, pose.translation, pose.rotation, acceleration[:3], mass=mass, gravity=chain.gravity
        )
        worst = max(worst, float(np.abs(tau_motor - forces).max() / np.abs(forces).max()))
    return worst
