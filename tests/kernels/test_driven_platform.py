"""Motor coordinates by way of the pose: graphs of platforms on legs, and verbs that find the pose first."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph import function_set, platform_dynamics
from stewart_pin.kernels.graph.driven_platform import DrivenPlatform, by_motors, drive_platform
from stewart_pin.kernels.graph.leg_reactions import reactions_function
from stewart_pin.kernels.graph.platform_dynamics import place_platform
from stewart_pin.kernels.kernels import Kernels, compile_kernels
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, derivative, robot, slow_but_for_few
from tests.kernels.platforms import FEW_PLATFORMS, PLATFORMS, motor_to_spare
from tests.kernels.test_compile import kernels
from tests.kernels.test_leg_reactions import carts, in_the_tree
from tests.kernels.test_platform_dynamics import call, states

AGREE = 1e-10
SLOW = {"stewart_cad", "stewart_sps", "delta", "hexapod_rss"}
BUNDLED = [
    pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name
    for name in ("stewart", "stewart_sps", "stewart_cad", "delta", "hexapod_rss", "rpr_planar")
]
"""Robots that come apart into a platform and legs; the slow ones take seconds to compile."""
VERBS = (
    "inverse_dynamics",
    "forward_dynamics",
    "reactions",
    "inverse_dynamics_derivatives",
    "forward_dynamics_derivatives",
)


@cache
def driven(name: str) -> DrivenPlatform:
    return drive_platform(place_platform(plan_platform(PLATFORMS[name]())))


def motor_states(chain: stp.ClosedChain, rng: np.random.Generator, count: int, spread: float):
    """Motors displaced by up to `spread` robot sizes or radians, at rates and accelerations of about one of these."""
    size, nu = chain.tangent_scale[chain.motor_index], chain.nu
    home = stp.motor_positions(chain, chain.q_home)
    position = home + spread * size * rng.uniform(-1, 1, (count, nu))
    return position, size * rng.normal(size=(count, nu)), size * rng.normal(size=(count, nu))


def by_the_tree(chain: stp.ClosedChain, monkeypatch: pytest.MonkeyPatch) -> Kernels:
    """Compile the same verbs by the other route, which shares no leg with this one."""

    def refuse(*_: object) -> None:
        raise UnsupportedError("for comparison")

    with monkeypatch.context() as patch:
        patch.setattr(function_set, "plan_platform", refuse)
        many = compile_kernels(chain, coordinates="motor")
    assert (many.report.route, many.report.why_tree) == ("tree", "for comparison")
    return many


@pytest.mark.parametrize("name", slow_but_for_few(PLATFORMS, FEW_PLATFORMS))
def test_graphs_agree_with_the_one_state_verbs(name: str, rng: np.random.Generator) -> None:
    platform = driven(name)
    placed, chain = platform.placed, platform.placed.plan.chain
    inverse = by_motors(platform, platform_dynamics.inverse_dynamics_function(placed))
    forward = by_motors(platform, platform_dynamics.forward_dynamics_function(placed))
    reactions = by_motors(platform, reactions_function(placed))
    size, compared = chain.tangent_scale[chain.motor_index], 0
    for pose, _, _, s in states(placed, rng, 3):
        jacobian = stp.motor_jacobian(chain, s.q) @ placed.plan.twists * placed.twist_scale / size[:, None]
        if np.linalg.cond(jacobian) > 100.0:
            continue  # the motors hardly hold it, and gaps of 1e-12 cost digits
        compared += 1
        velocity, acceleration = s.v[chain.motor_index], s.a[chain.motor_index]
        effort = stp.inverse_dynamics(chain, s.q, s.v, s.a)
        close(call(inverse, pose, velocity, acceleration), effort.tau_motor, AGREE)
        close(call(reactions, pose, velocity, acceleration), effort.lambda_c, AGREE)
        tau_motor = effort.tau_motor * rng.uniform(0.5, 1.5, chain.nu)
        a = stp.forward_dynamics(chain, s.q, s.v, tau_motor).a
        close(call(forward, pose, velocity, tau_motor), a[chain.motor_index], AGREE)
    assert compared


@pytest.mark.parametrize("name", BUNDLED)
def test_verbs_agree_with_the_one_state_verbs(name: str, rng: np.random.Generator) -> None:
    many = kernels(name, "motor")
    assert (many.report.route, many.report.why_tree) == ("legs", "")
    placed, chain = many._functions.placed, many.chain
    assert placed is not None
    whole = [s for *_, s in states(placed, rng, 5)]  # up to a sixth of the robot's size and 20° from home
    position = np.array([s.q[chain.motor_q_index] for s in whole])
    velocity, acceleration = (np.array([getattr(s, x)[chain.motor_index] for s in whole]) for x in ("v", "a"))
    status = np.full(5, 9, dtype=np.int8)
    tau_motor = many.inverse_dynamics(position, velocity, acceleration, status=status)
    assert (status == StateStatus.OK).all()
    reactions = many.reactions(position, velocity, acceleration)
    moved = many.forward_dynamics(position, velocity, tau_motor)
    close(moved, acceleration, 1e-9)  # of rods that are light
    for k, s in enumerate(whole):
        effort = stp.inverse_dynamics(chain, s.q, s.v, s.a)
        close(tau_motor[k], effort.tau_motor, AGREE)
        close(reactions[k], effort.lambda_c, AGREE)


@pytest.mark.parametrize("name", slow_but_for_few(["rpr_planar", "stewart", "delta"], []))
def test_all_verbs_agree_with_the_tree(
    name: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    many = kernels(name, "motor")
    tree = by_the_tree(many.chain, monkeypatch)
    position, velocity, acceleration = motor_states(many.chain, rng, 40, 0.25)
    position[7] = np.nan
    tau_motor = np.nan_to_num(tree.inverse_dynamics(position, velocity, acceleration), nan=1.0)
    verbs = VERBS if many.chain.nv > 12 else (*VERBS, "regressor")
    for verb in verbs:
        third = tau_motor if verb.startswith("forward") else acceleration
        codes = [np.full(40, 9, dtype=np.int8) for _ in range(2)]
        found, expected = (
            getattr(one, verb)(position, velocity, third, status=code)
            for one, code in zip((many, tree), codes, strict=True)
        )
        np.testing.assert_array_equal(*codes, err_msg=verb)
        good = codes[0] == StateStatus.OK
        assert 20 < good.sum() < 40
        pairs = zip(found, expected, strict=True) if isinstance(found, tuple) else [(found, expected)]
        for one, other in pairs:
            close(one[good], other[good], AGREE)
            assert np.isnan(one[~good]).all()


def test_regressor_times_parameters_are_the_efforts(rng: np.random.Generator) -> None:
    many = kernels("stewart", "motor")
    state = motor_states(many.chain, rng, 3, 0.1)
    close(many.regressor(*state) @ many.inertial_parameters, many.inverse_dynamics(*state), AGREE)


@pytest.mark.parametrize("verb", ["inverse_dynamics", "forward_dynamics"])
@pytest.mark.parametrize(
    "name", ["rpr_planar", *(pytest.param(n, marks=pytest.mark.slow) for n in ("stewart", "delta"))]
)
def test_derivatives_are_differences(name: str, verb: str, rng: np.random.Generator) -> None:
    many = kernels(name, "motor")
    nu, size = many.chain.nu, many.chain.tangent_scale[many.chain.motor_index]
    state = [x[0] for x in motor_states(many.chain, rng, 1, 0.03)]
    steps = [np.diag(size), np.diag(size), np.diag(size)]
    if verb == "forward_dynamics":
        state[2] = many.inverse_dynamics(*state)
        steps[2] = np.diag(np.full(nu, np.abs(state[2]).max()))
    answer = getattr(many, verb)
    for place, matrix in enumerate(getattr(many, f"{verb}_derivatives")(*state)):

        def moved(t: float, place: int = place) -> np.ndarray:
            return answer(*[x + t * steps[at] if at == place else x for at, x in enumerate(state)])

        close((matrix @ steps[place]).T, derivative(moved), 1e-8)


def spare_states(rng: np.random.Generator, count: int):
    """Move a platform with a motor to spare such that its motors agree."""
    many = compile_kernels(motor_to_spare(), coordinates="motor")
    placed, chain = many._functions.placed, many.chain
    assert placed is not None
    whole = [s for *_, s in states(placed, rng, count)]
    position = np.array([s.q[chain.motor_q_index] for s in whole])
    velocity, acceleration = (np.array([getattr(s, x)[chain.motor_index] for s in whole]) for x in ("v", "a"))
    return many, whole, position, velocity, acceleration


@pytest.mark.slow
def test_motors_to_spare_must_agree(rng: np.random.Generator) -> None:
    many, whole, position, velocity, acceleration = spare_states(rng, 4)
    assert (many.report.route, many.report.freedoms, many.chain.nu) == ("legs", 3, 4)
    tau_motor = many.inverse_dynamics(position, velocity, acceleration)
    for k, s in enumerate(whole):
        close(tau_motor[k], stp.inverse_dynamics(many.chain, s.q, s.v, s.a).tau_motor, AGREE)
    close(many.forward_dynamics(position, velocity, tau_motor), acceleration, 1e-9)
    # Parts of 1e-9 that do not agree are round-off, parts of 1e-3 are not.
    for motor in range(4):
        wrong = [np.repeat(x[None], 4, axis=0) for x in (position[0], velocity[0], acceleration[0])]
        for k, wrong_by in enumerate((1e-3, 1e-3, 1e-3)):
            wrong[k][k, motor] += wrong_by * np.abs(wrong[k]).max()
        wrong[1][3, motor] += 1e-9
        status = np.full(4, 9, dtype=np.int8)
        found = many.inverse_dynamics(*wrong, status=status)
        assert status.tolist() == [*3 * [StateStatus.OUT_OF_BOUNDS], StateStatus.OK]
        assert np.isnan(found[:3]).all() and np.isfinite(found[3]).all()
        many.forward_dynamics(wrong[0], wrong[1], tau_motor[0], status=status)
        assert status.tolist() == [*2 * [StateStatus.OUT_OF_BOUNDS], *2 * [StateStatus.OK]]


@pytest.mark.slow
def test_derivatives_of_motors_to_spare_hold_for_what_they_can_do(rng: np.random.Generator) -> None:
    many, whole, position, velocity, acceleration = spare_states(rng, 1)
    placed, (s,) = many._functions.placed, whole
    assert placed is not None
    along = stp.motor_jacobian(many.chain, s.q) @ placed.plan.twists
    state = position[0], velocity[0], acceleration[0]
    by_acceleration = many.inverse_dynamics_derivatives(*state)[2]
    slope = derivative(lambda t: many.inverse_dynamics(*state[:2], state[2] + t * along.T))
    close((by_acceleration @ along).T, slope, 1e-8)


@pytest.mark.parametrize("name", ["rpr_planar", "stewart"])
def test_motor_positions_out_of_reach_have_a_code(name: str, rng: np.random.Generator) -> None:
    many = kernels(name, "motor")
    position, velocity, acceleration = motor_states(many.chain, rng, 4, 0.03)
    expected = many.inverse_dynamics(position, velocity, acceleration)
    position[1] = 30.0 * many.chain.length_scale * (np.arange(many.chain.nu) == 0)
    position[2, 0] = np.nan
    status = np.full(4, 9, dtype=np.int8)
    for verb in ("inverse_dynamics", "reactions", "forward_dynamics"):
        found = getattr(many, verb)(position, velocity, acceleration, status=status)
        assert status.tolist() == [
            StateStatus.OK,
            StateStatus.OUT_OF_BOUNDS,
            StateStatus.OUT_OF_BOUNDS,
            StateStatus.OK,
        ]
        assert np.isnan(found[1:3]).all()
        if verb == "inverse_dynamics":
            np.testing.assert_array_equal(found[[0, 3]], expected[[0, 3]])


def test_conditioning_sees_what_the_motors_do_not_hold(rng: np.random.Generator) -> None:
    many, on_platform = kernels("stewart", "motor"), kernels("stewart")
    # Turned about the vertical, a hexapod of this kind loses its hold at 90°.
    angles = np.deg2rad([0.0, 30.0, 45.0, 60.0]) / 2
    poses = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, np.sin(x), np.cos(x)] for x in angles])
    lengths, rest = on_platform.inverse_kinematics(poses), np.zeros(6)
    values, graded = many.conditioning(lengths), np.zeros(4)
    assert (np.diff(values) < 0).all() and 0.3 < values[0] < 3.0
    # Poses, rates and accelerations are looked for, each by what the one before has lost, and by all motors at once.
    alone = on_platform.conditioning(poses)
    assert (values <= np.minimum(alone, alone**3) * (1 + 1e-9)).all()
    hexapod = stp.Hexapod.from_chain(on_platform.chain)
    turned = [np.array(pin.Quaternion(pose[3:]).matrix()) for pose in poses]
    held = [abs(np.linalg.det(stp.leg_jacobian(hexapod, [0, 0, 1], R))) for R in turned]
    np.testing.assert_allclose(values[1:] / values[1], (np.array(held[1:]) / held[1]) ** 3, rtol=1e-9)
    # Rates of the platform follow from the motors' by the same pivots, whatever the verb.
    many.forward_dynamics(lengths, rest, rest, conditioning=graded)
    np.testing.assert_allclose(graded, values, rtol=1e-9)
    on_platform.forward_dynamics(poses, rest, rest, conditioning=graded)
    assert (graded > 0.3).all()


def test_verbs_that_need_the_configuration_still_find_it(rng: np.random.Generator) -> None:
    many = compile_kernels(in_the_tree(carts()), coordinates="motor")
    first = {verb: many.casadi(verb).name_in()[0] for verb in ("inverse_dynamics", "reactions")}
    assert first == {"inverse_dynamics": "pose", "reactions": "q"}
    placed, chain = many._functions.placed, many.chain
    assert placed is not None
    for *_, s in states(placed, rng, 2):
        state = s.q[chain.motor_q_index], s.v[chain.motor_index], s.a[chain.motor_index]
        effort = stp.inverse_dynamics(chain, s.q, s.v, s.a)
        close(many.inverse_dynamics(*state), effort.tau_motor, AGREE)
        close(many.reactions(*state), effort.lambda_c, AGREE)


def test_single_precision_and_pickled_kernels(rng: np.random.Generator) -> None:
    many = kernels("rpr_planar", "motor")
    state = motor_states(many.chain, rng, 3, 0.05)
    expected = many.inverse_dynamics(*state)
    single = compile_kernels(many.chain, coordinates="motor", dtype=np.float32)
    close(single.inverse_dynamics(*state), expected, 1e-4)  # a few hundred operations that cancel
    again = pickle.loads(pickle.dumps(many))
    assert again.coordinates == "motor"
    np.testing.assert_array_equal(again.inverse_dynamics(*state), expected)


def test_what_verbs_are_given_is_no_pose() -> None:
    many = kernels("stewart", "motor")
    with pytest.raises(stp.errors.InputError, match="6"):
        many.inverse_dynamics(np.zeros(7), np.zeros(6), np.zeros(6))
    with pytest.raises(UnsupportedError, match="coordinates='platform'"):
        many.single_state("forward_kinematics")


@pytest.mark.parametrize(
    ("name", "reason"), [("four_bar", "twists that change with the pose"), ("arm_7r", "carries the platform")]
)
def test_other_chains_keep_to_the_tree(name: str, reason: str) -> None:
    report = kernels(name, "motor").report
    assert report.route == "tree"
    assert reason in report.why_tree


def test_too_few_motors_leave_the_platform_open() -> None:
    chain = stp.load("rpr_planar", motors=robot("rpr_planar").motors[:2])
    with pytest.raises(UnsupportedError, match=r"leave 1 freedom\(s\) of its platform open"):
        drive_platform(place_platform(plan_platform(chain)))
    with pytest.raises(UnsupportedError, match="coordinates='platform' or 'tree'"):
        compile_kernels(chain, coordinates="motor")
