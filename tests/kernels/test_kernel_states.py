"""Kernels of the whole state, reactions, and derivatives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.graph.bodies import configuration_chart
from stewart_pin.kernels.kernels import Kernels, compile_kernels
from stewart_pin.kernels.planning.tree import tree_of
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.programs.status import StateStatus
from tests import mechanisms
from tests.closed_states import (
    close,
    derivative,
    random_configuration,
    random_motion,
    robot,
    slow_but_for_few,
)
from tests.kernels.test_compile import kernels, platform_states
from tests.singular_robots import in_line
from tests.zoo.table import zoo_chain

AGREE = 1e-10


def tree_states(chain: stp.ClosedChain, rng: np.random.Generator, count: int = 3) -> list[np.ndarray]:
    states = []
    for _ in range(count):
        q = random_configuration(chain, rng)
        states.append((q, *random_motion(chain, rng, q)))
    return [np.array(x) for x in zip(*states, strict=True)]


@pytest.mark.parametrize("name", slow_but_for_few(["stewart_sps", "four_bar", "arm_7r"], ["four_bar"]))
def test_states_of_the_whole_tree(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    many = compile_kernels(chain, coordinates="tree")
    q, v, a = tree_states(chain, rng)
    tau_motor = many.inverse_dynamics(q, v, a)
    moved = many.forward_dynamics(q, v, tau_motor) / chain.tangent_scale
    reactions = many.reactions(q, v, a)
    for k in range(3):
        effort = stp.inverse_dynamics(chain, q[k], v[k], a[k])
        close(tau_motor[k], effort.tau_motor, AGREE)
        close(reactions[k], effort.lambda_c, AGREE)
        close(moved[k], effort.a / chain.tangent_scale, 1e-9)  # a thin rod's spin is the least determined


def test_states_that_open_loops_have_a_code(rng: np.random.Generator) -> None:
    chain = robot("four_bar")
    many = compile_kernels(chain, coordinates="tree")
    q, v, a = tree_states(chain, rng, 4)
    q[1, 0] += 1e-3
    v[2, 0] += 1e-3
    a[3, 0] += 1e-3 * np.abs(a[3]).max()
    status = np.empty(4, dtype=np.int8)
    assert np.isnan(many.inverse_dynamics(q, v, a, status=status)[1:]).all()
    assert status.tolist() == [StateStatus.OK, *3 * [StateStatus.OUT_OF_BOUNDS]]
    many.forward_dynamics(q, v, np.zeros(chain.nu), status=status)
    assert status.tolist() == [StateStatus.OK, *2 * [StateStatus.OUT_OF_BOUNDS], StateStatus.OK]


@pytest.mark.parametrize("kind", [mechanisms.JointKind.CYLINDRICAL, mechanisms.JointKind.FIXED])
def test_loops_with_opposed_axes_have_a_code(kind, rng: np.random.Generator) -> None:
    chain = mechanisms.two_bodies(kind, rng)
    many = compile_kernels(chain, coordinates="tree")
    q = random_configuration(chain, rng)
    loop = chain.loops[0]
    # Turn the free body by half a turn about a line across the loop's axis, through the origin of frame 2.
    half = pin.SE3(pin.exp3(np.pi * orthonormal_triad(loop.axis)[1]), np.zeros(3))
    joint = chain.model.joints[chain.model.getJointId("float")]
    part = slice(joint.idx_q, joint.idx_q + 7)
    flipped = q.copy()
    turned = pin.XYZQUATToSE3(q[part]) * loop.placement2 * half * loop.placement2.inverse()
    flipped[part] = pin.SE3ToXYZQUAT(turned)
    assert np.abs(stp.loop_gap(chain, flipped)).max() < 1e-9
    status = np.empty(2, dtype=np.int8)
    many.inverse_dynamics(np.array([q, flipped]), np.zeros(chain.nv), np.zeros(chain.nv), status=status)
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS]


@pytest.mark.parametrize("name", ["stewart", "four_bar"])
def test_reactions_agree(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    whole, (pose, twist, acceleration, _) = platform_states(many, rng, 3)
    reactions = many.reactions(pose, twist, acceleration)
    for k, s in enumerate(whole):
        close(reactions[k], stp.inverse_dynamics(many.chain, s.q, s.v, s.a).lambda_c, AGREE)


def test_conditioning_falls_towards_a_singularity() -> None:
    many, chain = kernels("stewart"), robot("stewart")
    home = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    assert 0.3 < many.conditioning(home) < 3.0
    # Turned about the vertical, a hexapod of this kind loses its hold at 90°.
    angles = np.deg2rad([0.0, 60.0, 85.0, 89.9])
    poses = np.array([[*home[:3], *pin.Quaternion(pin.exp3(np.array([0, 0, x]))).coeffs()] for x in angles])
    values = many.conditioning(poses).ravel()
    assert (np.diff(values) < 0).all()
    least = [np.linalg.svd(j)[1][-1] for j in many.motor_jacobian(poses)]
    np.testing.assert_allclose(values[2] / values[3], least[2] / least[3], rtol=0.1)
    four_bar = kernels("four_bar", "motor")
    assert four_bar.conditioning(stp.motor_positions(four_bar.chain, four_bar.chain.q_home)) > 0.1


@pytest.mark.parametrize(
    "name", slow_but_for_few(["four_bar", "rpr_planar", "stewart", "arm_3r_spatial"], ["four_bar"])
)
def test_regressor_is_pinocchios_for_the_motors(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    many = compile_kernels(chain, coordinates="tree")
    q, v, a = tree_states(chain, rng, 2)
    regressor = many.regressor(q, v, a)
    efforts = many.inverse_dynamics(q, v, a)
    for k in range(2):
        close(regressor[k] @ many.inertial_parameters, efforts[k], 1e-11)
        whole = pin.computeJointTorqueRegressor(chain.model, pin.Data(chain.model), q[k], v[k], a[k])
        motions = chain.at(q[k]).freedom.motions
        share = motions[chain.motor_index].T
        close(regressor[k], np.linalg.pinv(share) @ motions.T @ whole, 1e-10)


@pytest.mark.slow
def test_regressor_in_other_coordinates(rng: np.random.Generator) -> None:
    many = kernels("stewart")
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    expected = many.inverse_dynamics(pose, twist, acceleration)
    close(many.regressor(pose, twist, acceleration) @ many.inertial_parameters, expected, 1e-10)
    with pytest.raises(stp.errors.UnsupportedError, match="6 idle"):
        kernels("stewart_sps").casadi("regressor")


def displaced(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    turned = pin.Quaternion(pin.exp3(step[3:]) @ pin.Quaternion(pose[3:]).matrix())
    return np.concatenate([pose[:3] + step[:3], turned.coeffs()])


FREEDOMS = {
    "stewart": np.eye(6),
    "delta": np.eye(6)[:, :3],
    "rpr_planar": np.eye(6)[:, [0, 1, 5]],
}


# Differences of order 4 at h = 1e-3: 1e-12 times derivatives of up to a few hundred units.
@pytest.mark.parametrize(
    ("name", "verb"),
    [
        pytest.param("stewart", "inverse_dynamics", marks=pytest.mark.slow),
        ("rpr_planar", "inverse_dynamics"),
        ("rpr_planar", "forward_dynamics"),
        pytest.param("stewart", "forward_dynamics", marks=pytest.mark.slow),
        pytest.param("delta", "inverse_dynamics", marks=pytest.mark.slow),
        pytest.param("delta", "forward_dynamics", marks=pytest.mark.slow),
    ],
)
def test_derivatives_in_platform_coordinates(name: str, verb: str, rng: np.random.Generator) -> None:
    many, along = kernels(name), FREEDOMS[name]
    _, (pose, twist, third, _) = platform_states(many, rng, 2)
    third_along = along
    if verb == "forward_dynamics":
        third, third_along = many.inverse_dynamics(pose, twist, third), np.eye(many.chain.nu)
    answer = getattr(many, verb)
    matrices = getattr(many, f"{verb}_derivatives")(pose, twist, third)
    for k in range(2):
        state = [pose[k], twist[k], third[k]]
        for place, (matrix, steps) in enumerate(zip(matrices, (along, along, third_along), strict=True)):

            def moved(t: float, place: int = place, steps: np.ndarray = steps, state=state) -> np.ndarray:
                changed = [
                    np.array([displaced(x, t * s) if place == 0 else x + t * s for s in steps.T])
                    if at == place
                    else x
                    for at, x in enumerate(state)
                ]
                return answer(*changed)

            close((matrix[k] @ steps).T, derivative(moved), 1e-8)


@pytest.mark.parametrize("verb", ["inverse_dynamics", "forward_dynamics"])
def test_derivatives_in_motor_coordinates(verb: str, rng: np.random.Generator) -> None:
    many: Kernels = kernels("five_bar", "motor")
    nu = many.chain.nu
    home = stp.motor_positions(many.chain, many.chain.q_home)
    state = [home + 0.1 * rng.normal(size=nu), rng.normal(size=nu), rng.normal(size=nu)]
    answer = getattr(many, verb)
    matrices = getattr(many, f"{verb}_derivatives")(*state)
    for place, matrix in enumerate(matrices):

        def moved(t: float, place: int = place) -> np.ndarray:
            return answer(*[x + t * np.eye(nu) if at == place else x for at, x in enumerate(state)])

        close(matrix.T, derivative(moved), 1e-8)


def test_configuration_chart_follows_the_tangent(rng: np.random.Generator) -> None:
    ca = pytest.importorskip("casadi")
    chain = mechanisms.two_bodies(mechanisms.JointKind.SPHERICAL, rng)
    q = random_configuration(chain, rng)
    symbols = ca.SX.sym("q", chain.nq)
    chart = ca.Function("chart", [symbols], [ca.densify(configuration_chart(tree_of(chain).joints, symbols))])
    v = rng.normal(size=chain.nv)
    slope = derivative(lambda t: pin.integrate(chain.model, q, t * v))
    close(np.array(chart(q)) @ v, slope, 1e-10)


def test_a_singular_home_is_singular_in_motor_coordinates_too() -> None:
    """Loops closed to round-off leave a five-bar with its distal links in line half of its digits off."""
    many = stp.compile_kernels(in_line(), coordinates="motor")
    inward = np.outer([0.0, 1e-13, 1e-7], [-1.0, 1.0])
    status, rest = np.zeros(3, dtype=np.int8), np.zeros((3, 2))
    found = many.inverse_dynamics(inward, rest, rest, status=status)
    assert status.tolist() == [StateStatus.SINGULAR, StateStatus.SINGULAR, StateStatus.OK]
    # Half the weights of the distal links, across a line that sags by the root of what the knees come closer.
    assert np.isnan(found[:2]).all() and 5e3 < abs(found[2, 0]) < 7e3


@pytest.mark.parametrize("name", ["four_bar", "bennett"])
def test_motors_may_stand_many_turns_from_home(name: str) -> None:
    chain = stp.load(name) if name == "four_bar" else zoo_chain(name)
    kernels = stp.compile_kernels(chain, coordinates="motor")
    turns = np.array([[0.0], [13.0], [-40.0]])
    status = np.zeros(3, dtype=np.int8)
    at = chain.q_home[chain.motor_q_index] + 0.3 + 2 * np.pi * turns
    efforts = kernels.inverse_dynamics(at, np.ones((3, 1)), np.zeros((3, 1)), status=status)
    assert not status.any()
    np.testing.assert_allclose(efforts, efforts[:1].repeat(3, axis=0), rtol=1e-9)
