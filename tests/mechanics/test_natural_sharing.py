"""Motors and loop rows of mixed kind share a load in natural units, whatever the method and the unit of length."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import scipy.optimize

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from tests.closed_states import close, random_configuration, random_motion
from tests.mechanisms import ONE, P, R, X, Y, at, rod

SIZES = (1.0, 1000.0, 1e-3)


def slider_crank(size: float = 1.0) -> stp.ClosedChain:
    """One freedom with a rotary and a linear motor, in a plane whose hinge has three rows too many."""
    links = (
        Link("ground"),
        *(
            Link(name, rod(size * length))
            for name, length in (("crank", 0.5), ("coupler", 0.9), ("slider", 0.2))
        ),
    )
    joints = (
        Joint("turn", R, "ground", "crank", ONE, Y),
        Joint("pin", R, "crank", "coupler", at(0.5 * size), Y),
        Joint("slide", P, "ground", "slider", at(z=-0.1 * size), X),
    )
    hinge = Loop("hinge", JointKind.REVOLUTE, "coupler", "slider", at(0.9 * size), ONE, Y)
    home = {"turn": [-0.9], "pin": [1.4], "slide": [1.1 * size]}
    mechanism = Mechanism(
        "slider_crank", links, joints, (hinge,), platform="coupler", home={k: np.array(v) for k, v in home.items()},
        home_is_guess=True, gravity=(0.0, 0.0, -9.81),
    )  # fmt: skip
    return stp.with_motors(build_chain(mechanism), ["turn", "slide"])


def shares(chain: stp.ClosedChain, size: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Efforts and reactions at rest in the units of the robot of size one, by every formulation."""
    q, rest = chain.q_home, np.zeros(chain.nv)
    found = {}
    for method in ("pinocchio", "constraint_matrix"):
        effort = stp.inverse_dynamics(chain, q, rest, rest, method=method)
        assert not effort.unique and not effort.reactions_unique
        found[method] = effort.tau_motor, effort.lambda_c
    tau = found["pinocchio"][0]
    found["forward"] = tau, stp.forward_dynamics(chain, q, rest, tau).lambda_c
    found["articulated"] = tau, stp.dynamics.closed_chain_articulated_body(chain, q, rest, tau).lambda_c
    still = np.zeros((1, 6))
    by_pose = stp.compile_kernels(chain, engine="numpy")
    pose = pin.SE3ToXYZQUAT(stp.platform_pose(chain, q))[None]
    found["platform kernels"] = (
        by_pose.inverse_dynamics(pose, still, still)[0],
        by_pose.reactions(pose, still, still)[0],
    )
    by_tree = stp.compile_kernels(chain, coordinates="tree", engine="numpy")
    found["tree kernels"] = (
        by_tree.inverse_dynamics(q[None], rest[None], rest[None])[0],
        by_tree.reactions(q[None], rest[None], rest[None])[0],
    )
    efforts, rows = size ** (chain.tangent_scale[chain.motor_index] == 1), size ** (chain.row_sizes == 1)
    return {name: (motors / efforts, reactions / rows) for name, (motors, reactions) in found.items()}


def test_every_formulation_shares_alike_at_every_size() -> None:
    expected = shares(slider_crank(), 1.0)["pinocchio"]
    assert np.abs(expected[0]).min() > 0.1
    for size in SIZES:
        for name, (motors, reactions) in shares(slider_crank(size), size).items():
            np.testing.assert_allclose(motors, expected[0], rtol=1e-8, err_msg=f"{name} {size}")
            np.testing.assert_allclose(reactions, expected[1], rtol=0, atol=1e-8, err_msg=f"{name} {size}")


def test_the_share_is_the_least_by_a_search() -> None:
    chain = slider_crank()
    q, rest = chain.q_home, np.zeros(chain.nv)
    found = stp.inverse_dynamics(chain, q, rest, rest)
    sizes = np.array([1.0, chain.length_scale])
    # What the motors do against each other, by virtual work on the motion of the mechanism.
    motion = chain.at(q).freedom.motions[chain.motor_index, 0]
    against = np.array([-motion[1], motion[0]])
    best = scipy.optimize.minimize_scalar(lambda t: np.sum((sizes * (found.tau_motor + t * against)) ** 2))
    assert abs(best.x) < 1e-6
    limit = [0.9 * abs(found.tau_motor[0]), np.inf]
    for size in SIZES:
        larger = slider_crank(size)
        bounded = stp.inverse_dynamics(
            larger, larger.q_home, rest, rest, effort_limit=np.array(limit) * [size, 1.0]
        ).tau_motor / [size, 1.0]
        assert abs(bounded[0]) == pytest.approx(limit[0], rel=1e-9)
        assert bounded @ motion == pytest.approx(found.tau_motor @ motion, rel=1e-8)
        wide = stp.inverse_dynamics(larger, larger.q_home, rest, rest, effort_limit=np.inf).tau_motor
        np.testing.assert_allclose(wide / [size, 1.0], found.tau_motor, rtol=1e-8)


def test_derivatives_are_those_of_the_natural_share(rng: np.random.Generator) -> None:
    chain = slider_crank()
    v, a = random_motion(chain, rng, chain.q_home)
    rates = stp.dynamics.inverse_dynamics_derivatives(chain, chain.q_home, v, a)
    motion = chain.at(chain.q_home).freedom.motions[:, 0]
    rest = np.zeros(chain.nv)
    at_rest = stp.dynamics.inverse_dynamics_derivatives(chain, chain.q_home, rest, rest)

    def efforts(step: float) -> tuple[np.ndarray, np.ndarray]:
        q = stp.close_loops(chain, pin.integrate(chain.model, chain.q_home, step * motion)).q
        moved = pin.difference(chain.model, chain.q_home, q)
        return stp.inverse_dynamics(chain, q, rest, rest).tau_motor, moved

    (after, there), (before, back) = efforts(1e-4), efforts(-1e-4)
    close(after - before, at_rest.tau_q @ (there - back), 1e-7)
    further = stp.inverse_dynamics(chain, chain.q_home, v, a + motion).tau_motor
    close(further - stp.inverse_dynamics(chain, chain.q_home, v, a).tau_motor, rates.tau_a @ motion, 1e-10)


@pytest.mark.parametrize(("name", "further"), [("rpr_planar", "leg1_hinge"), ("stewart", "leg1_x")])
def test_legs_with_a_rotary_motor_beside_the_linear_ones_share_alike(name: str, further: str, rng) -> None:
    chain = stp.load(name)
    chain = stp.with_motors(chain, [*chain.motors, further])
    pose = stp.platform_pose(chain, random_configuration(chain, rng, 0.1))
    twist, acceleration = (
        chain.at(chain.q_home).P @ random_motion(chain, rng, chain.q_home)[0] for _ in range(2)
    )
    state = stp.platform_motion(chain, pose, twist, acceleration, limits=False)
    effort = stp.inverse_dynamics(state)
    judge = stp.inverse_dynamics(state, method="constraint_matrix")
    assert not effort.unique and np.abs(effort.tau_motor).min() > 1e-6
    close(judge.tau_motor, effort.tau_motor, 1e-9)
    close(judge.lambda_c, effort.lambda_c, 1e-9)
    kernels = stp.compile_kernels(chain, engine="numpy")
    motion = pin.SE3ToXYZQUAT(pose)[None], twist[None], acceleration[None]
    close(kernels.inverse_dynamics(*motion)[0], effort.tau_motor, 1e-9)
    close(kernels.reactions(*motion)[0], effort.lambda_c, 1e-9)
