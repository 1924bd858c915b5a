"""Wrenches from outside in the verbs of one state: against payloads, closed forms and statics; and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError
from tests.closed_states import close, random_configuration, robot

METHODS = ("pinocchio", "constraint_matrix")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["stewart", "delta", "three_rps"])
def test_a_weight_at_the_origin_is_a_payload_at_rest(name: str, method: str, rng) -> None:
    chain, mass = robot(name), 7.5
    loaded = stp.attach_payload(chain, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))))
    q, rest = random_configuration(chain, rng, 0.1), np.zeros(chain.nv)
    weight = {chain.platform_link: np.concatenate([mass * chain.gravity, np.zeros(3)])}
    pushed = stp.inverse_dynamics(chain, q, rest, rest, wrenches=weight, method=method)
    close(pushed.tau_motor, stp.inverse_dynamics(loaded, q, rest, rest, method=method).tau_motor, 1e-11)


def test_a_wrench_at_a_tool_is_its_moment_at_the_platform(rng: np.random.Generator) -> None:
    tool = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    plain = robot("stewart")
    chain = stp.with_platform(plain, "platform", placement=tool, name="tool")
    state = chain.at(random_configuration(chain, rng, 0.1))
    force, moment = rng.normal(size=(2, 3))
    at_tool = stp.inverse_dynamics(state, wrenches={"tool": [*force, *moment]})
    arm = state.pose.translation - stp.platform_pose(plain, state.q).translation
    shifted = [*force, *(moment + np.cross(arm, force))]
    close(stp.inverse_dynamics(state, wrenches={"platform": shifted}).tau_motor, at_tool.tau_motor, 1e-11)


def platform_state(chain: stp.ClosedChain, rng: np.random.Generator) -> tuple[stp.State, tuple]:
    home = stp.platform_pose(chain, chain.q_home)
    turn = Rotation.from_euler("xyz", rng.uniform(-15, 15, 3), degrees=True).as_matrix()
    pose = pin.SE3(turn @ home.rotation, home.translation + rng.uniform(-0.15, 0.15, 3))
    twist, acceleration = rng.normal(size=(2, 6))
    return stp.platform_motion(chain, pose, twist, acceleration), (pose, twist, acceleration)


@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_closed_forms_take_a_wrench_on_the_platform(name: str, rng: np.random.Generator) -> None:
    chain, wrench = robot(name), 100 * rng.normal(size=6)
    state, (pose, twist, acceleration) = platform_state(chain, rng)
    hexapod, bodies = stp.Hexapod.from_chain(chain), stp.hexapods.hexapod_bodies(chain)
    place = hexapod, pose.translation, pose.rotation
    forces = stp.hexapods.hexapod_inverse_dynamics(
        hexapod, bodies, *place[1:], twist, acceleration, gravity=chain.gravity, wrench=wrench
    )
    close(forces.actuator, stp.inverse_dynamics(state, wrenches={"platform": wrench}).tau_motor, 1e-10)
    light, mass = stp.massless_legs(chain, point_platform=True), chain.mechanism.link("platform").inertia.mass
    found = stp.point_mass_forces(*place, acceleration[:3], mass=mass, gravity=chain.gravity, wrench=wrench)
    same = stp.inverse_dynamics(light, state.q, state.v, state.a, wrenches={"platform": wrench})
    close(found, same.tau_motor, 1e-10)


def test_closed_forms_spread_a_wrench_over_a_batch(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    home, wrench = stp.platform_pose(chain, chain.q_home), rng.normal(size=(4, 6))
    place = stp.Hexapod.from_chain(chain), home.translation, home.rotation
    many = stp.point_mass_forces(*place, np.zeros(3), mass=3.0, wrench=wrench)
    one = stp.point_mass_forces(*place, np.zeros(3), mass=3.0, wrench=wrench[2])
    close(many[2], one, 1e-14)
    with pytest.raises(InputError, match=r"wrench must have shape \(\.\.\., 6\)"):
        stp.point_mass_forces(*place, np.zeros(3), mass=3.0, wrench=np.zeros(3))
    with pytest.raises(InputError, match="batch shapes do not fit"):
        stp.point_mass_forces(*place, np.zeros((3, 3)), mass=3.0, wrench=wrench)


def test_redundant_motors_share_a_wrench_within_limits(rng: np.random.Generator) -> None:
    """Three motors on two freedoms: what no motor may give alone, others take over."""
    chain = stp.with_motors(robot("five_bar"), [*robot("five_bar").motors, passive_of(robot("five_bar"))])
    state = chain.at(random_configuration(chain, rng, 0.1))
    wrenches = {link.name: 20 * rng.normal(size=6) for link in chain.mechanism.links}
    free = stp.inverse_dynamics(state, wrenches=wrenches)
    assert not free.unique
    close(
        stp.inverse_dynamics(state, wrenches=wrenches, method="constraint_matrix").tau_motor,
        free.tau_motor,
        1e-10,
    )
    limit = 0.9 * np.abs(free.tau_motor).max()
    held = stp.inverse_dynamics(state, wrenches=wrenches, effort_limit=limit)
    assert np.abs(held.tau_motor).max() <= limit * (1 + 1e-9)
    assert np.abs(held.tau_motor - free.tau_motor).max() > 0.01 * limit
    motion = stp.forward_dynamics(state, tau_motor=held.tau_motor, wrenches=wrenches)
    assert (
        np.abs(motion.a).max() <= 1e-8 * np.abs(stp.forward_dynamics(state, tau_motor=held.tau_motor).a).max()
    )


def passive_of(chain: stp.ClosedChain) -> str:
    return next(name for name in chain.model.names[1:] if name not in chain.motors)


@pytest.mark.parametrize("method", METHODS)
def test_motors_that_do_not_hold_it_carry_what_they_can(method: str, rng: np.random.Generator) -> None:
    chain = stp.with_motors(robot("stewart"), robot("stewart").motors[:5])
    state = chain.at(chain.q_home)
    wrenches = {"platform": 50 * rng.normal(size=6), "leg3_lower": 50 * rng.normal(size=6)}
    effort = stp.inverse_dynamics(state, wrenches=wrenches, method=method, throw=False)
    if method == "pinocchio":  # the demanded motion, what is left over told
        assert effort.residual > 1.0
    else:  # the motors' part of it: what the rest then does is the truth
        motion = stp.forward_dynamics(state, tau_motor=effort.tau_motor, wrenches=wrenches)
        close(motion.a / chain.tangent_scale, effort.a / chain.tangent_scale, 1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_idle_freedoms_follow_the_wrenches(method: str, rng: np.random.Generator) -> None:
    """A moment about a leg on two balls spins it as a free axle, whatever the demand says."""
    chain = robot("stewart_sps")
    state = chain.at(chain.q_home)
    axis = leg_axis(state)
    effort = stp.inverse_dynamics(state, wrenches={"leg1_lower": [0, 0, 0, *(0.3 * axis)]}, method=method)
    without = stp.inverse_dynamics(state, method=method)
    close(effort.tau_motor, without.tau_motor, 1e-10)
    spin = (chain.at(state.q, effort.a).joint_twists(effort.a) - chain.at(state.q).joint_twists(without.a))[
        :, 3:
    ]
    about = sum(
        axis @ (r @ body.inertia @ r.T) @ axis
        for r, body in ((state._placed.rotation[k], chain.model.inertias[k]) for k in leg_joints(chain))
    )
    last = leg_joints(chain)[0]
    assert abs(spin[last] @ axis * about - 0.3) <= 1e-9


def leg_joints(chain: stp.ClosedChain) -> list[int]:
    return [
        chain.model.frames[chain.model.getFrameId(f"leg1_{part}", pin.FrameType.BODY)].parentJoint
        for part in ("lower", "upper")
    ]


def leg_axis(state: stp.State) -> np.ndarray:
    base, platform = state.chain.leg_points()
    along = state.pose.act(platform[0]) - base[0]
    return along / np.linalg.norm(along)


@pytest.mark.parametrize("method", METHODS)
def test_an_idle_freedom_without_inertia_is_not_pushed(method: str) -> None:
    chain = stp.massless_legs(robot("stewart_sps"))
    state = chain.at(chain.q_home)
    along = {"leg1_upper": [*leg_axis(state), 0, 0, 0]}
    about = {"leg1_upper": [0, 0, 0, *leg_axis(state)]}
    carried = stp.inverse_dynamics(state, wrenches=along, method=method)
    assert carried.residual <= 1e-9
    refused = "takes part in the motion leg1_z .1, and wrenches, springs or friction push it"
    with pytest.raises(SingularityError, match=refused) as caught:
        stp.inverse_dynamics(state, wrenches=about, method=method)
    assert caught.value.names == chain.tangent_names
    with pytest.raises(SingularityError, match=refused):
        stp.forward_dynamics(state, tau_motor=np.zeros(6), wrenches=about)


def test_reactions_belong_to_the_wrenches_of_the_effort(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    state = chain.at(random_configuration(chain, rng, 0.1))
    wrenches = {"platform": [0, 0, -300, 0, 0, 0]}
    effort = stp.inverse_dynamics(state, wrenches=wrenches)
    given = stp.joint_reactions(state, effort=effort, wrenches=wrenches)
    own = stp.joint_reactions(state, wrenches=wrenches)
    assert all(np.array_equal(one.force, two.force) for one, two in zip(given, own, strict=True))
    for wrong in ({"effort": effort}, {"effort": stp.inverse_dynamics(state), "wrenches": wrenches}):
        with pytest.raises(InputError, match="and the wrenches that it was given"):
            stp.joint_reactions(state, **wrong)


def test_wrenches_have_the_axes_of_the_inertial_frame_beside_a_base_motion(rng: np.random.Generator) -> None:
    arm = robot("arm_7r")
    q, v, tau = rng.normal(size=(3, 7))
    wrenches = {link.name: rng.normal(size=6) for link in arm.mechanism.links}
    turn = pin.exp3(rng.normal(size=3))
    tilted = stp.load("arm_7r", gravity=turn.T @ arm.gravity)
    turned = {name: np.concatenate([turn.T @ w[:3], turn.T @ w[3:]]) for name, w in wrenches.items()}
    base = stp.dynamics.BaseMotion(turn)
    ours = stp.articulated_body_acceleration(arm, q, v, tau, wrenches=wrenches, base_motion=base)
    close(ours, stp.articulated_body_acceleration(tilted, q, v, tau, wrenches=turned), 1e-11)


VERBS: dict[str, Callable[..., object]] = {
    "inverse_dynamics": stp.inverse_dynamics,
    "constraint_matrix": lambda s, wrenches: stp.inverse_dynamics(
        s, method="constraint_matrix", wrenches=wrenches
    ),
    "forward_dynamics": lambda s, wrenches: stp.forward_dynamics(s, tau_motor=np.zeros(6), wrenches=wrenches),
    "joint_reactions": stp.joint_reactions,
    "constraint_matrix_system": stp.constraint_matrix_system,
    "closed_chain_articulated_body": lambda s, wrenches: stp.dynamics.closed_chain_articulated_body(
        s, tau_motor=np.zeros(6), wrenches=wrenches
    ),
    "articulated_body_acceleration": lambda s, wrenches: stp.articulated_body_acceleration(
        s.chain, s.q, s.v, s.v, wrenches=wrenches
    ),
}


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_refuses_what_is_none(verb: str) -> None:
    state = robot("stewart").at(robot("stewart").q_home)
    for wrenches, said in (
        ({"plattform": np.zeros(6)}, "did you mean 'platform'"),
        ({"platform": np.zeros(5)}, r"wrenches\['platform'\] must have shape \(6,\)"),
        ({"platform": np.full(6, np.nan)}, r"wrenches\['platform'\] must be finite"),
    ):
        with pytest.raises(InputError, match=said):
            VERBS[verb](state, wrenches=wrenches)
    assert VERBS[verb](state, wrenches={}) is not None


def test_the_system_holds_the_forces_on_the_bodies() -> None:
    """A link without inertia that bears a wrench is a body of its own; the ground may be pushed."""
    state = robot("stewart").at(robot("stewart").q_home)
    plain = stp.constraint_matrix_system(state)
    pushed = stp.constraint_matrix_system(
        state, wrenches={"leg1_cross": [1, 2, 3, 4, 5, 6], "base": np.ones(6)}
    )
    assert "leg1_cross" not in plain.bodies
    k = 6 * pushed.bodies.index("leg1_cross")
    force = -pushed.f_p[k : k + 6]
    point = state._placed.translation[1]
    close(force, np.array([1, 2, 3, *([4, 5, 6] + np.cross(point, [1, 2, 3]))]), 1e-12)
