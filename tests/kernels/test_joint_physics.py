"""What joints do by themselves, in kernels: as the verbs of one state, or refused by name."""

from __future__ import annotations

import zlib
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels import choosing
from stewart_pin.kernels.graph.joint_effects import quaternion_of, rotation_vector
from stewart_pin.model.description import JointKind, physics_coordinates
from stewart_pin.programs.status import StateStatus
from tests.closed_states import (
    KINDS,
    close,
    derivative,
    random_configuration,
    random_motion,
    robot,
    slow_but_for_few,
)
from tests.kernels.held_motions import held_state, slope
from tests.zoo.table import ROBOTS

AGREE = 1e-10
"""Relative; as law 5 without what joints do, of which these are a part."""
QUICK = ("five_bar", "rpr_planar", "revolute", "prismatic")
TWINS = ("stewart_s1", "stewart_cad")
"""Their joints, legs and loops are those of `stewart`: the same kernels with other numbers."""
EACH = [name for name in (*ROBOTS, *KINDS) if name not in TWINS]
NAMES = slow_but_for_few(EACH, QUICK)


@cache
def physical(name: str, friction: bool = True, legs: bool = False) -> stp.ClosedChain:
    """Give every joint, of the tree and of loops, all that it may have, as strong as its bodies are heavy.

    Or only hinges and slides of legs, from where they hang to before their ends, which no idle motion moves.
    """
    chain = robot(name)
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    inertia = pin.crba(chain.model, pin.Data(chain.model), chain.q_home).diagonal() * chain.tangent_scale**2
    usual = float(np.median(inertia[inertia > 0]))
    physics: dict[str, dict[str, Any]] = {}

    def own(size: float, *, whole: bool) -> dict[str, Any]:
        strong = usual / size**2
        found: dict[str, Any] = {"damping": strong * rng.uniform(0.2, 1.0)}
        found["stiffness"] = strong * rng.uniform(0.5, 2.0)
        if whole:
            found["friction"] = friction * usual / size * rng.uniform(0.2, 1.0)
            found["stiffness"] = [
                found["stiffness"],
                *(found["stiffness"] * rng.normal(size=2) / size ** np.arange(1, 3)),
            ]
            found["rest"] = size * rng.uniform(-0.5, 0.5)
            found["force"] = usual / size * rng.normal()
        return found

    idle = np.abs(np.hstack([chain.at(q).freedom.idle for q in chain.generic.samples])).max(
        axis=1, initial=0.0
    )
    for joint in chain.mechanism.joints:
        if joint.kind is not JointKind.FIXED:
            entry = chain.model.joints[chain.model.getJointId(joint.name)].idx_v
            if legs and (not joint.has_axis or idle[entry] > 1e-9 or joint.child == chain.platform):
                continue
            size = float(chain.tangent_scale[entry])
            found = own(size, whole=joint.has_axis)
            found["armature"] = usual / size**2 * rng.uniform(0.2, 1.0)
            if joint.kind is JointKind.FLOATING:
                del found["stiffness"]
            if joint.kind is JointKind.SPHERICAL:
                found["friction"] = friction * usual * rng.uniform(0.2, 1.0)
            physics[joint.name] = found
    for loop in () if legs else chain.loops:
        words = physics_coordinates(loop.kind)
        for word in words:
            coordinate = loop.name if len(words) == 1 else f"{loop.name} {word}"
            size = chain.length_scale if word in ("length", "x", "y") else 1.0
            physics[coordinate] = own(size, whole=word != "turn")
    return stp.with_joint_physics(chain, physics)


@cache
def kernels_of(
    name: str, coordinates: Any, friction: bool = True, legs: bool = False
) -> stp.compiled.Kernels:
    return stp.compile_kernels(physical(name, friction, legs), coordinates=coordinates, engine="numpy")


def compiled(name: str, coordinates: str, friction: bool = True, legs: bool = False) -> stp.compiled.Kernels:
    if not stp.mobility(robot(name)).motors_sufficient:
        pytest.skip(f"the motors of {name} do not hold it")
    if (name, coordinates) == ("arm_3r_planar", "platform"):
        pytest.skip("its home is stretched: a pose beside it does not tell on which side the elbow is")
    try:
        return kernels_of(name, coordinates, friction, legs)
    except UnsupportedError as error:
        if not friction or "dry friction" not in str(error):
            pytest.skip(str(error))
    try:
        return kernels_of(name, coordinates, False, legs)
    except UnsupportedError as error:
        pytest.skip(str(error))


def motion_of(chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool) -> tuple[np.ndarray, ...]:
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    if rest:
        state = chain.at(q, np.zeros(chain.nv))
        v = state.v
        along = state.motions.basis @ rng.normal(size=chain.generic.count.dof)
        a = chain.tangent_scale * along
    return q, v, a


def given_of(chain: stp.ClosedChain, coordinates: str, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Any:
    if coordinates == "tree":
        return (q, v, a), chain.tangent_scale
    if coordinates == "motor":
        at = chain.motor_index
        return (q[chain.motor_q_index], v[at], a[at]), chain.tangent_scale[at]
    state = chain.at(q, v)
    pose = pin.SE3ToXYZQUAT(stp.platform_pose(chain, q))
    return (pose, state.P @ v, state.P @ a + state.platform_bias), np.repeat([chain.length_scale, 1.0], 3)


@pytest.mark.parametrize("coordinates", ["tree", "motor", "platform"])
@pytest.mark.parametrize("name", NAMES)
def test_kernels_agree_with_the_verbs_of_one_state(
    name: str, coordinates: str, rng: np.random.Generator
) -> None:
    agree_in_motion_and_at_rest(name, compiled(name, coordinates), rng)


def agree_in_motion_and_at_rest(name: str, kernels: stp.compiled.Kernels, rng: np.random.Generator) -> None:
    chain, coordinates = kernels.chain, kernels.coordinates
    for rest in (False, True):
        q, v, a = motion_of(chain, rng, rest=rest)
        if (
            coordinates != "tree" and stp.mobility(chain).idle
        ):  # where they stand and how they move is the verb's
            pose, twist, acceleration = given_of(chain, "platform", q, v, a)[0]
            found = stp.platform_motion(chain, pin.XYZQUATToSE3(pose), twist, acceleration, limits=False)
            q, v, a = found.q, found.v, found.a
        given, size = given_of(chain, coordinates, q, v, a)
        effort = stp.inverse_dynamics(chain, q, v, a)
        close(kernels.inverse_dynamics(*given), effort.tau_motor, AGREE)
        bare = stp.inverse_dynamics(robot(name), q, v, a).tau_motor
        assert np.abs(effort.tau_motor - bare).max() > 1e-4 * np.abs(bare).max()  # they are felt
        if chain.nc and (coordinates == "tree" or not stp.mobility(chain).idle):
            close(kernels.reactions(*given), effort.lambda_c, 10 * AGREE)
        status = np.zeros(1, dtype=np.int8)
        found = kernels.forward_dynamics(*(x[None] for x in given[:2]), effort.tau_motor, status=status)[0]
        effects = chain.at(q, v).effects
        assert effects is not None
        if rest and effects.rubbing.limits.size:
            assert status[0] == StateStatus.RESTING and np.isnan(found).all()
        else:
            assert status[0] == StateStatus.OK
            moved = stp.forward_dynamics(chain, q, v, effort.tau_motor).a
            expected = given_of(chain, coordinates, q, v, moved)[0][2]
            close(found / size, expected / size, 1e-8)  # round-off times the inertias' spread


@pytest.mark.parametrize("name", NAMES)
def test_without_friction_a_joint_at_rest_is_nothing_special(name: str, rng: np.random.Generator) -> None:
    kernels = compiled(name, "tree", friction=False)
    chain = kernels.chain
    q, v, _ = motion_of(chain, rng, rest=True)
    tau, size = rng.normal(size=chain.nu), chain.tangent_scale
    expected = stp.forward_dynamics(chain, q, v, tau).a
    close(kernels.forward_dynamics(q, v, tau) / size, expected / size, 1e-8)


@pytest.mark.parametrize("coordinates", ["motor", "platform"])
@pytest.mark.parametrize("name", slow_but_for_few(EACH, ("five_bar", "rpr_planar")))
def test_derivatives_agree_with_differences(name: str, coordinates: str, rng: np.random.Generator) -> None:
    derivatives_agree(compiled(name, coordinates), rng)


def derivatives_agree(kernels: stp.compiled.Kernels, rng: np.random.Generator) -> None:
    chain, coordinates = kernels.chain, kernels.coordinates
    q, v, a = motion_of(chain, rng, rest=False)
    given, size = given_of(chain, coordinates, q, v, a)
    count = chain.generic.count
    if coordinates == "platform" and count.platform < 6:
        pytest.skip("derivatives hold along what the platform can do")
    tau = kernels.inverse_dynamics(*given)
    for verb, inputs in (("inverse_dynamics", given), ("forward_dynamics", (*given[:2], tau))):
        found = getattr(kernels, f"{verb}_derivatives")(*inputs)
        for place, matrix in enumerate(found):
            direction = rng.uniform(-1, 1, matrix.shape[1])
            if matrix.shape[1] == len(size) and inputs[place] is not tau:
                direction *= size

            def moved(
                t: float, place: int = place, inputs: Any = inputs, along: Any = direction
            ) -> np.ndarray:
                parts = list(inputs)
                parts[place] = _moved(parts[place], t * along)
                return getattr(kernels, verb)(*parts)  # noqa: B023

            close(matrix @ direction, derivative(moved, 1e-3), 1e-7)
        status = np.zeros(1, dtype=np.int8)
        still = (inputs[0][None], np.zeros((1, len(given[1]))), inputs[2][None])
        slopes = getattr(kernels, f"{verb}_derivatives")(*still, status=status)
        effects = chain.at(q).effects
        assert effects is not None
        rests = bool(effects.rubbing.limits.size)
        assert rests == (status[0] == StateStatus.RESTING) == bool(np.isnan(slopes[0]).all())


def _moved(value: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Displace a pose in world axes, or add."""
    if len(value) != 7 or len(step) != 6:
        return value + step
    pose = pin.XYZQUATToSE3(value)
    return pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(step[3:]) @ pose.rotation, pose.translation + step[:3]))


@pytest.mark.parametrize("coordinates", ["tree", "motor"])
@pytest.mark.parametrize("name", slow_but_for_few(EACH, ("five_bar",)))
def test_derivatives_by_the_geometry_agree_with_differences(name: str, coordinates: str) -> None:
    kernels = compiled(name, coordinates)
    if stp.mobility(kernels.chain).idle:
        pytest.skip("judged without what joints do: displaced all at once, idle spins move the platform")
    rng = np.random.default_rng(5)
    state = held_state(kernels.chain, coordinates, kernels.geometry_held, rng)
    basis, parameters = kernels.geometry_displacements, kernels.geometry_parameters
    sizes = np.array([kernels.chain.length_scale if p.unit == "m" else 1.0 for p in parameters])
    alone = np.count_nonzero(basis, axis=0) == 1
    along = sizes * (basis[:, alone] @ rng.uniform(-0.5, 0.5, np.count_nonzero(alone)))
    for verb in ("inverse_dynamics", "forward_dynamics"):
        function = kernels.casadi(f"{verb}_by_tree")
        assert "resting" in function.name_out()  # there dry friction has no slope
        found = np.array(function.call([ca.DM(x) for x in state.inputs[verb]])[0]) @ along
        pairs = list(zip(parameters, along, strict=True))
        close(found, slope(lambda t: state.answer(verb, {p: t * x for p, x in pairs if x}), 2e-4), 1e-7)  # noqa: B023


# ----------------------------------------------------------------------------------------------------
# Legs with closed forms keep them
# ----------------------------------------------------------------------------------------------------


LEGGED = [name for name in stp.robots() if name not in TWINS]


@pytest.mark.parametrize("coordinates", ["motor", "platform"])
@pytest.mark.parametrize("name", slow_but_for_few(LEGGED, ("rpr_planar",)))
def test_legs_feel_their_joints_in_closed_form(name: str, coordinates: str, rng: np.random.Generator) -> None:
    kernels = compiled(name, coordinates, legs=True)
    bare = stp.compile_kernels(robot(name), coordinates=coordinates, engine="numpy")
    assert kernels.by_legs == bare.by_legs, kernels.report.why_tree
    agree_in_motion_and_at_rest(name, kernels, rng)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "coordinates"), [("stewart", "platform"), ("rpr_planar", "motor"), ("delta", "motor")]
)
def test_derivatives_of_legs_agree_with_differences(
    name: str, coordinates: str, rng: np.random.Generator
) -> None:
    derivatives_agree(compiled(name, coordinates, legs=True), rng)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stewart_s1"])
def test_derivatives_by_the_ends_of_legs_are_those_of_the_whole_tree(
    name: str, rng: np.random.Generator
) -> None:
    kernels = compiled(name, "platform", legs=True)
    q, v, a = motion_of(kernels.chain, rng, rest=False)
    given, _ = given_of(kernels.chain, "platform", q, v, a)
    tau = kernels.inverse_dynamics(*given)
    legs = list(kernels._functions.leg_displacements)
    assert legs
    for verb, third in (("inverse_dynamics", given[2]), ("forward_dynamics", tau)):
        ways = [
            kernels.casadi(f"{verb}_by_{way}").call([ca.DM(x) for x in (at, given[1], third)])[0]
            for way, at in (("legs", given[0]), ("tree", q))
        ]
        close(np.array(ways[0]), np.array(ways[1])[:, legs], 1e-9)
        assert all("resting" in kernels.casadi(f"{verb}_by_{way}").name_out() for way in ("legs", "tree"))


@pytest.mark.parametrize("name", slow_but_for_few(LEGGED, ("rpr_planar",)))
def test_regressors_of_legs_hold_their_rotors(name: str, rng: np.random.Generator) -> None:
    chain = physical(name, legs=True)
    own = {joint.name: joint.physics.armature for joint in chain.mechanism.joints if joint.physics}
    rotors = {joint: {"armature": armature} for joint, armature in own.items()}
    chain = stp.with_joint_physics(robot(name), rotors)
    if stp.mobility(chain).idle or not stp.mobility(chain).motors_sufficient:
        pytest.skip("efforts are not linear, or do not hold it")
    try:
        kernels = stp.compile_kernels(chain, engine="numpy")
    except UnsupportedError as error:
        pytest.skip(str(error))
    if not kernels.by_legs:
        pytest.skip(kernels.report.why_tree)
    q, v, a = motion_of(chain, rng, rest=False)
    given, _ = given_of(chain, "platform", q, v, a)
    efforts = stp.inverse_dynamics(chain, q, v, a).tau_motor
    close(kernels.regressor(*given) @ kernels.inertial_parameters, efforts, AGREE)


def test_dry_friction_of_idle_freedoms_is_left_to_the_verbs_of_one_state() -> None:
    chain = stp.with_joint_physics(robot("delta"), {"rod1a_spin": {"friction": 0.01}})
    with pytest.raises(UnsupportedError, match="idle freedoms of delta move has dry friction"):
        stp.compile_kernels(chain, coordinates="tree")
    assert choosing.kernels_for(chain, choosing.HANDFUL) is None


def test_a_rotor_that_idle_motions_turn_is_left_to_the_whole_tree() -> None:
    chain = stp.with_joint_physics(robot("delta"), {"rod1a_spin": {"armature": 0.01}})
    kernels = stp.compile_kernels(chain, engine="numpy")
    assert not kernels.by_legs and "'rod1a_spin' has a rotor (armature), and idle" in kernels.report.why_tree


@pytest.mark.parametrize(
    ("joint", "own", "says"),
    [
        ("platform_pose", {"damping": 1.0}, "joint 'platform_pose' has damping 1"),
        ("platform_pose", {"armature": 1.0}, "joint 'platform_pose', which carries it, has a rotor"),
        ("leg1_ball", {"stiffness": 1.0}, "'turn' of loop 'leg1_ball' has stiffness 1"),
    ],
)
def test_where_legs_end_the_whole_tree_answers(joint: str, own: dict[str, float], says: str) -> None:
    kernels = stp.compile_kernels(stp.with_joint_physics(robot("stewart"), {joint: own}), engine="numpy")
    assert not kernels.by_legs and says in kernels.report.why_tree


def test_rotation_vectors_are_right_near_none_and_near_half_a_turn(rng: np.random.Generator) -> None:
    symbols, matrix = ca.SX.sym("q", 4), ca.SX.sym("R", 3, 3)
    of_quaternion = ca.Function("log", [symbols], [rotation_vector(symbols)])
    slopes = ca.Function("slopes", [symbols], [ca.jacobian(rotation_vector(symbols), symbols)])
    of_matrix = ca.Function("log", [matrix], [rotation_vector(quaternion_of(matrix))])
    for angle in (0.0, 1e-300, 1e-12, 1e-6, 0.0199, 0.0201, 0.5, 2.0, 3.0, np.pi - 1e-6):
        for _ in range(4):
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            vector = angle * axis
            quaternion = np.array([*np.sin(angle / 2) * axis, np.cos(angle / 2)])
            for sign in (1.0, -1.0):
                found = np.array(of_quaternion(sign * quaternion)).ravel()
                np.testing.assert_allclose(found, vector, rtol=1e-14, atol=1e-300)
            np.testing.assert_allclose(
                np.array(of_matrix(pin.exp3(vector))).ravel(),
                vector,
                rtol=0,
                atol=1e-9 if angle > 3 else 2e-15,
            )
            # Along the turn itself, q exp(t axis), the vector grows by the axis.
            turning = 0.5 * np.array([*quaternion[3] * axis, -quaternion[:3] @ axis])
            np.testing.assert_allclose(np.array(slopes(quaternion)) @ turning, axis, rtol=0, atol=1e-12)


# ----------------------------------------------------------------------------------------------------
# What is refused, and whose joints kernels are of
# ----------------------------------------------------------------------------------------------------


def test_regressors_have_no_part_for_what_joints_do() -> None:
    kernels = kernels_of("five_bar", "motor")
    with pytest.raises(UnsupportedError, match=r"five_bar has no regressor: joint 'left_hip' has damping"):
        kernels.regressor(*np.zeros((3, 2)))


def test_single_precision_does_not_tell_rest() -> None:
    with pytest.raises(UnsupportedError, match=r"dry friction.*float64"):
        stp.compile_kernels(physical("five_bar"), coordinates="motor", dtype=np.float32)
    stp.compile_kernels(physical("five_bar", friction=False), coordinates="motor", dtype=np.float32)


@pytest.mark.parametrize(
    ("name", "joint", "own", "says"),
    [
        ("stewart", "leg1", {"damping": 3.0}, "joint 'leg1' has damping 3"),
        ("stewart", "leg2_x", {"friction": 0.1}, "joint 'leg2_x' has friction 0.1"),
        ("stewart", "leg3_ball", {"damping": 0.1}, "'turn' of loop 'leg3_ball' has damping 0.1"),
        ("five_bar", "left_hip", {"stiffness": 2.0}, "joint 'left_hip' has a spring"),
        ("five_bar", "left_hip", {"force": 2.0}, "joint 'left_hip' has a spring or a force"),
        ("five_bar", "tip_pin", {"damping": 2.0}, "'angle' of loop 'tip_pin' has damping 2"),
    ],
)
def test_simulation_takes_no_kernels_of_such_joints(
    name: str, joint: str, own: dict[str, float], says: str
) -> None:
    chain = stp.with_joint_physics(robot(name), {joint: own})
    assert choosing.simulation_kernels(chain, choosing.MANY_CALLS) is None
    with pytest.raises(UnsupportedError, match=says):
        choosing.simulation_kernels(chain, 1, wanted=True)


@pytest.mark.parametrize("field", ["armature", "damping", "friction"])
def test_kernels_of_joints_that_are_no_more_say_so(field: str) -> None:
    chain = robot("five_bar")
    chain = replace(chain, model=chain.model.copy())
    kernels = stp.compile_kernels(chain, coordinates="motor", engine="numpy")
    given = np.zeros((3, 1, chain.nu))
    before = kernels.inverse_dynamics(*given)
    getattr(chain.model, field)[1] = 2.0
    with pytest.raises(UnsupportedError, match=r"was 0 when .* is 2 now; compile them again"):
        kernels.inverse_dynamics(*given)
    with pytest.raises(UnsupportedError, match="compile them again"):
        kernels.casadi("inverse_dynamics")
    getattr(chain.model, field)[1] = 0.0
    np.testing.assert_array_equal(kernels.inverse_dynamics(*given), before)


@pytest.mark.parametrize("field", ["armature", "damping", "friction"])
def test_kernels_that_are_kept_are_those_of_the_model_as_it_is(field: str) -> None:
    chain = robot("five_bar")
    chain = replace(chain, model=chain.model.copy())
    kept = choosing.kernels_for(chain, choosing.HANDFUL)
    getattr(chain.model, field)[:] = 3.0
    other = choosing.kernels_for(chain, choosing.HANDFUL)
    assert other is not kept and other is not None
    getattr(chain.model, field)[:] = 0.0
    assert choosing.kernels_for(chain, choosing.HANDFUL) is kept


def test_springs_that_count_turns_are_left_to_states_in_a_row() -> None:
    chain = stp.with_joint_physics(robot("five_bar"), {"left_hip": {"stiffness": 2.0}})
    free = stp.with_limits(chain, {"left_hip": {"position": (-np.inf, np.inf)}})
    kept = stp.with_limits(chain, {"left_hip": {"position": (-1.0, 3.0)}})
    assert choosing.kernels_for(free, choosing.HANDFUL) is None
    with pytest.raises(UnsupportedError, match="spring of joint 'left_hip' counts whole turns"):
        choosing.kernels_for(free, 1, wanted=True)
    assert choosing.kernels_for(kept, choosing.HANDFUL) is not None
    pushed = stp.with_joint_physics(robot("five_bar"), {"left_hip": {"force": 2.0, "damping": 1.0}})
    assert choosing.kernels_for(pushed, choosing.HANDFUL) is not None
