"""Mechanisms without platform or motors: every verb answers, or names what is missing and who could be it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MechanismError, MissingRoleError, StewartPinError, UnsupportedError
from tests.public_names import public

BODY = (
    '<link name="{}"><inertial><origin xyz="{} 0 0"/><mass value="1"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>'
)
JOINT = (
    '<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 -1 0"/></joint>'
)
GRIPPER = (
    '<robot name="gripper"><link name="base"/>'
    + BODY.format("crank", 0.02)
    + BODY.format("coupler", 0.04)
    + BODY.format("finger", 0.03)
    + JOINT.format("a", "base", "crank", 0)
    + JOINT.format("b", "crank", "coupler", 0.04)
    + JOINT.format("c", "base", "finger", 0.1)
    + '<loop name="d" type="continuous"><predecessor link="coupler"><origin xyz="0.09 0 0"/></predecessor>'
    '<successor link="finger"><origin xyz="0.06 0 0"/></successor><axis xyz="0 -1 0"/></loop>{}</robot>'
)


@pytest.fixture
def gripper(tmp_path: Path) -> stp.ClosedChain:
    return read(tmp_path)


def read(folder: Path, more: str = "", **options: Any) -> stp.ClosedChain:
    path = folder / "gripper.urdf"
    path.write_text(GRIPPER.replace("{}", more))
    return stp.load(path, **options)


def still(t: float) -> stp.motions.PlatformSamples:
    return stp.motions.PlatformSamples(
        np.array([t]), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 6)), np.zeros((1, 6))
    )


def samples() -> stp.motions.PlatformSamples:
    n = 3
    return stp.motions.PlatformSamples(
        np.arange(n) * 0.1,
        np.zeros((n, 3)),
        np.tile(np.eye(3), (n, 1, 1)),
        np.zeros((n, 6)),
        np.zeros((n, 6)),
    )


ONE, TWO = pin.SE3.Identity(), np.zeros(6)
PAYLOAD = pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))

ANSWERS: dict[str, Callable[[stp.ClosedChain, Path], Any]] = {
    "articulated_body_acceleration": lambda c, f: stp.articulated_body_acceleration(
        c, c.q_home, np.zeros(3), np.zeros(3)
    ),
    "close_loops": lambda c, f: stp.close_loops(c, c.q_home + 0.01).q,
    "closed_chain_articulated_body": lambda c, f: stp.dynamics.closed_chain_articulated_body(
        balls(c), c.q_home, np.zeros(3)
    ),
    "closed_path": lambda c, f: stp.loops.closed_path(
        c, np.array([c.q_home, stp.close_loops(c, c.q_home + 0.01).q])
    )(0.5),
    "constraint_matrix_system": lambda c, f: stp.constraint_matrix_system(
        c, c.q_home, np.zeros(3), falling(c)
    ),
    "constraint_models": lambda c, f: stp.loops.constraint_models(balls(c)),
    "displace_geometry": lambda c, f: stp.build.displace_geometry(c, {}),
    "export": lambda c, f: stp.export(c, f / "out.urdf"),
    "forward_dynamics": lambda c, f: stp.forward_dynamics(c, c.q_home, np.zeros(3)).a,
    "forward_dynamics_derivatives": lambda c, f: (
        stp.dynamics.forward_dynamics_derivatives(c, c.q_home, np.zeros(3)).a_q
    ),
    "generic_freedom": lambda c, f: stp.loops.generic_freedom(c).dof,
    "geometry_parameters": lambda c, f: stp.build.geometry_parameters(c),
    "joint_efforts": lambda c, f: stp.dynamics.joint_efforts(c, c.q_home).elastic,
    "joint_motor_map": lambda c, f: stp.dynamics.joint_motor_map(c, c.q_home, joints=["c"], motors=["a"]),
    "joint_reactions": lambda c, f: stp.joint_reactions(
        c, c.q_home, np.zeros(3), stp.inverse_dynamics(c, c.q_home, np.zeros(3), falling(c), throw=False)
    ),
    "lock_joints": lambda c, f: stp.lock_joints(c, ["a"]),
    "loop_bias": lambda c, f: stp.loop_bias(c, c.q_home, np.zeros(3)),
    "loop_gap": lambda c, f: stp.loop_gap(c, c.q_home),
    "loop_jacobian": lambda c, f: stp.loop_jacobian(c, c.q_home),
    "loop_jacobian_rate": lambda c, f: stp.loops.loop_jacobian_rate(c, c.q_home, np.zeros(3)),
    "loops_by_balls": lambda c, f: stp.build.loops_by_balls(c),
    "mobility": lambda c, f: stp.mobility(c),
    "motor_positions": lambda c, f: stp.motor_positions(c, c.q_home),
    "on_floating_base": lambda c, f: stp.on_floating_base(c, base_inertia=PAYLOAD),
    "replace_inertias": lambda c, f: stp.build.replace_inertias(c, {}),
    "simulate": lambda c, f: stp.simulate(c, c.q_home, np.zeros(3), duration=0.02, dt=1e-3).q,
    "with_joint_physics": lambda c, f: stp.with_joint_physics(c, {"a": {"damping": 2.0}}),
    "with_limits": lambda c, f: stp.with_limits(c, {"a": {"velocity": 2.0}}),
    "with_motors": lambda c, f: stp.with_motors(c, ["a"]),
    "with_platform": lambda c, f: stp.with_platform(c, "finger"),
    "write_urdf": lambda c, f: stp.write_urdf(c, f / "out.urdf"),
}
"""Verbs that need neither platform nor motors."""

MISSING: dict[str, tuple[str, Callable[[stp.ClosedChain], Any]]] = {
    "all_forward_kinematics": ("motors", lambda c: stp.loops.all_forward_kinematics(c, [])),
    "attach_payload": ("platform", lambda c: stp.attach_payload(c, PAYLOAD)),
    "classify_singularity": ("platform", lambda c: stp.singularities.classify_singularity(c, c.q_home)),
    "closed_forms": ("platform", lambda c: stp.dynamics.closed_forms(c)),
    "compare_methods": ("platform", lambda c: stp.compare_methods(c, samples())),
    "compile_kernels": ("platform", lambda c: stp.compile_kernels(c)),
    "find_singularity": (
        "platform",
        lambda c: stp.singularities.find_singularity(
            c, np.array([c.q_home, stp.close_loops(c, c.q_home + 0.01).q])
        ),
    ),
    "fit_to_limits": ("platform", lambda c: stp.fit_to_limits(c, still)),
    "forward_kinematics": ("motors", lambda c: stp.forward_kinematics(c, [])),
    "hexapod_bodies": ("platform", lambda c: stp.hexapods.hexapod_bodies(c)),
    "inverse_dynamics": ("motors", lambda c: stp.inverse_dynamics(c, c.q_home, np.zeros(3), np.zeros(3))),
    "inverse_dynamics_derivatives": (
        "motors",
        lambda c: stp.dynamics.inverse_dynamics_derivatives(c, c.q_home, np.zeros(3), np.zeros(3)),
    ),
    "inverse_kinematics": ("platform", lambda c: stp.inverse_kinematics(c, ONE)),
    "linearise": ("motors", lambda c: stp.linearise(c, c.q_home)),
    "massless_legs": ("platform", lambda c: stp.massless_legs(c)),
    "motion_map": ("motors", lambda c: stp.dynamics.motion_map(c, c.q_home)),
    "motor_demand": ("platform", lambda c: stp.motor_demand(c, samples())),
    "motor_jacobian": ("platform", lambda c: stp.motor_jacobian(c, c.q_home)),
    "natural_frequencies": ("motors", lambda c: stp.natural_frequencies(c, c.q_home, motor_stiffness=1.0)),
    "operational_dynamics": ("motors", lambda c: stp.operational_dynamics(c, c.q_home)),
    "planar_rpr": ("platform", lambda c: stp.planar.planar_rpr(c)),
    "platform_motion": ("platform", lambda c: stp.platform_motion(c, ONE, TWO, TWO)),
    "platform_pose": ("platform", lambda c: stp.platform_pose(c, c.q_home)),
    "frequency_response": (
        "motors",
        lambda c: stp.dynamics.frequency_response(c, c.q_home, frequency=[1.0], motor_stiffness=1.0),
    ),
    "platform_compliance": (
        "motors",
        lambda c: stp.dynamics.platform_compliance(c, c.q_home, motor_stiffness=1.0),
    ),
    "platform_stiffness": (
        "motors",
        lambda c: stp.dynamics.platform_stiffness(c, c.q_home, motor_stiffness=1.0),
    ),
    "rotary_legs": ("platform", lambda c: stp.rotary.rotary_legs(c)),
    "singularity_map": ("platform", lambda c: stp.singularities.singularity_map(c, [0.0, 0.1], [0.0, 0.1])),
    "velocity_polytope": ("motors", lambda c: stp.polytopes.velocity_polytope(c, c.q_home, rate_limit=1.0)),
    "wrench_closure": ("motors", lambda c: stp.polytopes.wrench_closure(c, c.q_home)),
    "wrench_feasible": (
        "motors",
        lambda c: stp.polytopes.wrench_feasible(c, c.q_home, wrenches=np.zeros(6)),
    ),
    "wrench_polytope": ("motors", lambda c: stp.polytopes.wrench_polytope(c, c.q_home, effort_limit=1.0)),
}
"""Verbs that need a platform or motors, and which they ask for."""

ELSEWHERE = {"cable_lengths", "resume", "sweep_demand", "view"}
"""Take what these verbs hand out, or chains with cables; a page without roles is asked in `tests.viewer`."""


def balls(chain: stp.ClosedChain) -> stp.ClosedChain:
    return stp.build.loops_by_balls(chain)


def falling(chain: stp.ClosedChain) -> np.ndarray:
    return stp.forward_dynamics(chain, chain.q_home, np.zeros(3)).a


def test_every_verb_is_tried() -> None:
    verbs = set()
    for name, verb in public().items():
        if inspect.isfunction(verb):
            first = next(iter(inspect.signature(verb).parameters), "")
            if first == "chain" and not name.startswith("viz."):
                verbs.add(name.rsplit(".", 1)[-1])
    assert verbs <= {*ANSWERS, *MISSING, *ELSEWHERE}


def test_a_gripper_loads(gripper: stp.ClosedChain) -> None:
    assert (gripper.motors, gripper.platform) == ((), None)
    found = stp.mobility(gripper)
    # Four bars have one freedom; any one joint of one freedom holds them.
    assert found.dof == 1 and found.lost == 1 and len(found.suggestion) == 1
    assert gripper.generic.count == stp.loops.FreedomCount(dof=1, motor=0, platform=1, either=1)


@pytest.mark.parametrize("verb", ANSWERS)
def test_verbs_that_need_neither(verb: str, gripper: stp.ClosedChain, tmp_path: Path) -> None:
    try:
        answer = ANSWERS[verb](gripper, tmp_path)
    except UnsupportedError as error:  # of revolute loops or others, said as for any chain
        assert "platform" not in str(error) and "motor" not in str(error)
        return
    if isinstance(answer, np.ndarray) and answer.dtype.kind == "f":
        assert np.isfinite(answer).all()


@pytest.mark.parametrize("verb", MISSING)
def test_verbs_that_need_one(verb: str, gripper: stp.ClosedChain) -> None:
    role, ask = MISSING[verb]
    with pytest.raises(MissingRoleError) as caught:
        ask(gripper)
    text = str(caught.value)
    # Both are missing, so both are named at once, best guess first.
    assert "platform=... or with_platform" in text and "motors=[...] or with_motors" in text
    assert "coupler" in text and "best guess first: a, c, b" in text
    assert caught.value.missing == role
    assert caught.value.candidates[0] == {"platform": "coupler", "motors": "a"}[role]


@pytest.mark.parametrize(
    ("changed", "left"), [({"motors": ["a"]}, "platform"), ({"platform": "finger"}, "motors")]
)
def test_only_what_is_missing_is_asked_for(changed: dict, left: str, tmp_path: Path) -> None:
    chain = read(tmp_path, **changed)
    for role, ask in MISSING.values():
        try:
            ask(chain)
        except MissingRoleError as error:
            assert error.missing == left == role or error.missing == left
            assert ("with_motors" in str(error)) is (left == "motors")
            assert ("with_platform" in str(error)) is (left == "platform")
        except StewartPinError:
            pass  # one motor, or one freedom, is little for some verbs; they say so


def test_the_answers_are_those_of_a_chain_with_roles(gripper: stp.ClosedChain) -> None:
    whole = stp.with_platform(stp.with_motors(gripper, ["a"]), "finger")
    rest = np.zeros(3)
    # No platform and no motor changes how the links fall, nor what the joints carry: equal but for round-off.
    fall = stp.forward_dynamics(whole, whole.q_home, rest, [0.0]).a
    np.testing.assert_allclose(falling(gripper), fall, rtol=1e-9)
    run = stp.simulate(gripper, gripper.q_home, rest, duration=0.05, dt=1e-3)
    same = stp.simulate(whole, whole.q_home, rest, duration=0.05, dt=1e-3)
    np.testing.assert_allclose(run.q, same.q, atol=1e-9)
    assert run.platform is None and same.platform is not None


@pytest.mark.parametrize("format", ["urdf+", "mjcf"])
def test_what_is_written_has_none_either(format: str, gripper: stp.ClosedChain, tmp_path: Path) -> None:
    path = tmp_path / ("again.xml" if format == "mjcf" else "again.urdf")
    stp.export(gripper, path, format=format)
    other = stp.load(path)
    assert (other.motors, other.platform) == ((), None)
    assert stp.mobility(other).dof == 1


def test_pictures(gripper: stp.ClosedChain) -> None:
    labels = [text.get_text() for text in stp.viz.plot_chain(gripper).legends[0].get_texts()]
    assert "platform" not in labels and "motor" not in labels and "loop" in labels


def test_kernels_in_tree_coordinates(gripper: stp.ClosedChain) -> None:
    kernels = stp.compile_kernels(gripper, coordinates="tree")
    q, rest = gripper.q_home[None], np.zeros((1, 3))
    right = stp.forward_dynamics(gripper, gripper.q_home, rest[0]).a
    # Two ways of elimination: round-off of a well-conditioned system.
    np.testing.assert_allclose(kernels.forward_dynamics(q, rest, np.zeros((1, 0)))[0], right, rtol=1e-9)
    with pytest.raises(MissingRoleError, match="the platform is needed"):
        kernels.casadi("platform_pose")
    with pytest.raises(MissingRoleError, match="the motors are needed"):
        kernels.inverse_dynamics(q, rest, rest)
    with pytest.raises(MissingRoleError, match="the motors are needed"):
        stp.compile_kernels(gripper, coordinates="motor")


def test_motor_kernels_without_a_platform(tmp_path: Path) -> None:
    chain = read(tmp_path, motors=["a"])
    kernels = stp.compile_kernels(chain, coordinates="motor")
    state = chain.at(chain.q_home)
    effort = stp.inverse_dynamics(state, throw=True).tau_motor
    np.testing.assert_allclose(
        kernels.inverse_dynamics(chain.q_home[chain.motor_q_index][None], np.zeros((1, 1)), np.zeros((1, 1)))[
            0
        ],
        effort,
        atol=1e-9,
    )


def test_names_that_are_none_of_the_mechanism(tmp_path: Path) -> None:
    with pytest.raises(MechanismError, match=r"no moving link 'hand'.*candidates are: coupler"):
        read(tmp_path, platform="hand")
    with pytest.raises(MechanismError, match="missing or has not one freedom"):
        read(tmp_path, motors=["z"])


def test_hints_of_the_file_come_first(tmp_path: Path) -> None:
    hint = '<transmission name="t"><joint name="c"/><joint name="b"/></transmission>'
    chain = read(tmp_path, hint)
    assert chain.motors == ()
    with pytest.raises(MissingRoleError) as caught:
        stp.dynamics.motion_map(chain, chain.q_home)
    assert caught.value.candidates == ("c", "b", "a")


def test_a_chain_in_the_wrong_place_is_an_input_error() -> None:
    assert issubclass(MissingRoleError, InputError)
