"""Wrenches from outside in kernels: against the verbs of one state, central differences, and weights."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.kernels import Kernels, compile_kernels, count_operations
from stewart_pin.kernels.planning.samples import require_standing_points, telling_wrenches
from stewart_pin.model.description import Joint, Link, Loop, Mechanism
from stewart_pin.programs.status import StateStatus
from tests import mechanisms
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.kernels.held_motions import held_state, slope
from tests.kernels.platforms import PLATFORMS
from tests.mechanisms import F, R, S, at, rod

AGREE = 1e-10
OTHERS = tuple(name for name in PLATFORMS if name not in stp.robots() and name != "3-RPR")
"""Platforms on legs of other kinds than the bundled robots have: hanging, on rails, with spins, motors to spare."""
QUICK = {("four_bar", "platform"), ("four_bar", "tree"), ("five_bar", "motor"), ("rpr_planar", "platform")}
"""Both routes and all coordinates, of robots whose kernels are written in a moment."""
CASES = [
    pytest.param(name, coordinates, marks=() if (name, coordinates) in QUICK else pytest.mark.slow)
    for name in (*stp.robots(), *OTHERS)
    for coordinates in ("platform", "motor", "tree")
]


@cache
def chain_named(name: str) -> stp.ClosedChain:
    return PLATFORMS[name]() if name in OTHERS else robot(name)


def links_of(chain: stp.ClosedChain) -> tuple[str, ...]:
    """List platform, a link in the middle, ground and the last link, those at points that no idle motion moves."""
    names = [link.name for link in chain.mechanism.links]
    own = () if chain.platform is None else (chain.platform,)
    links = dict.fromkeys((*own, names[len(names) // 2], chain.mechanism.root, names[-1]))
    return tuple(link for link in links if stands(chain, link))


def stands(chain: stp.ClosedChain, link: str) -> bool:
    try:
        require_standing_points(chain, (link,))
    except UnsupportedError:
        return False
    return True


@cache
def kernels(name: str, coordinates: Any = "platform", **options: Any) -> Kernels:
    chain = chain_named(name)
    options = {"wrenches": links_of(chain), "engine": "numpy"} | options
    return compile_kernels(chain, coordinates=coordinates, **options)


def usable(name: str, coordinates: str) -> Kernels:
    """Kernels with wrenches, where there are any without and the motors hold the robot."""
    if not stp.mobility(chain_named(name)).motors_sufficient:
        pytest.skip("its motors do not hold it")
    try:
        return kernels(name, coordinates)
    except UnsupportedError:
        with pytest.raises(UnsupportedError):
            compile_kernels(chain_named(name), coordinates=coordinates)  # pyright: ignore[reportArgumentType]
        pytest.skip("it has no kernels in these coordinates")


def by_link(many: Kernels, wrenches: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(many.wrenches, wrenches.reshape(-1, 6), strict=True))


def state_of(many: Kernels, rng: np.random.Generator) -> tuple[stp.State, list[np.ndarray]]:
    """Draw a state, and what the kernels take for it; idle freedoms of a driven chain carry no momentum."""
    chain = many.chain
    q = random_configuration(chain, rng, 0.1)
    v, a = random_motion(chain, rng, q)
    if many.coordinates == "tree":
        return chain.at(q, v, a), [q, v, a]
    if chain.platform is not None:
        before = chain.at(q, v, a)
        pose, twist, acceleration = (
            stp.platform_pose(chain, q),
            before.P @ v,
            before.P @ a + before.platform_bias,
        )
        if many.coordinates == "platform":  # on the branch that the kernels take
            q = stp.forward_kinematics(chain, many.inverse_kinematics(pin.SE3ToXYZQUAT(pose)), limits=False).q
        state = stp.platform_motion(chain, pose, twist, acceleration, q_guess=q, limits=False)
    else:
        state = chain.at(q, v, a)
    if many.coordinates == "motor":
        return state, [state.q[chain.motor_q_index], state.v[chain.motor_index], state.a[chain.motor_index]]
    return state, [pin.SE3ToXYZQUAT(pose), twist, acceleration]


def in_coordinates(many: Kernels, state: stp.State, a: np.ndarray) -> np.ndarray:
    if many.coordinates == "platform":
        return state.P @ a + state.platform_bias
    return a[many.chain.motor_index] if many.coordinates == "motor" else a


@pytest.mark.parametrize(("name", "coordinates"), CASES)
def test_they_agree_with_the_verbs_of_one_state(
    name: str, coordinates: str, rng: np.random.Generator
) -> None:
    many = usable(name, coordinates)
    # Motors do not tell where rods stand that spin and are round to the six digits of their file.
    agree = 1e-8 if coordinates == "motor" and many.chain.generic.count.idle else AGREE
    for _ in range(3):
        state, motion = state_of(many, rng)
        size = max(1.0, np.abs(stp.inverse_dynamics(state).tau_motor).max())
        wrenches = size * rng.normal(size=6 * len(many.wrenches))
        if (
            coordinates != "tree"
        ):  # what spins a rod that is round to six digits is refused: only forces on it
            for link in telling_wrenches(many.chain, many.wrenches):
                by_link(many, wrenches)[link][3:] = 0.0
        loads = by_link(many, wrenches)
        effort = stp.inverse_dynamics(state, wrenches=loads)
        close(many.inverse_dynamics(*motion, wrenches), effort.tau_motor, agree)
        if many.chain.nc:
            close(many.reactions(*motion, wrenches), effort.lambda_c, agree)
        efforts = effort.tau_motor * rng.uniform(0.9, 1.1, many.chain.nu)
        moved = many.forward_dynamics(*motion[:2], efforts, wrenches)
        free = stp.forward_dynamics(many.chain, state.q, state.v, efforts, wrenches=loads).a
        expected = in_coordinates(many, state, free)
        # A moment spins a thin rod at a million rad/s²: the platform's acceleration is then a small part of all.
        assert np.abs(moved - expected).max() <= agree * np.abs(free).max()


# ----------------------------------------------------------------------------------------------------
# Derivatives
# ----------------------------------------------------------------------------------------------------


def displaced(many: Kernels, position: np.ndarray, by: np.ndarray) -> np.ndarray:
    if many.coordinates == "motor":
        return position + by
    pose = pin.XYZQUATToSE3(position)
    moved = pin.SE3(pin.exp3(by[3:]) @ pose.rotation, pose.translation + by[:3])
    return pin.SE3ToXYZQUAT(moved)


DERIVATIVES = [
    ("rpr_planar", "platform"),
    ("five_bar", "motor"),
    pytest.param("rpr_planar", "motor", marks=pytest.mark.slow),
    pytest.param("stewart", "platform", marks=pytest.mark.slow),
    pytest.param("stewart_sps", "motor", marks=pytest.mark.slow),
    pytest.param("legs on the platform", "platform", marks=pytest.mark.slow),
    pytest.param("3-RRR, motor to spare", "platform", marks=pytest.mark.slow),
    pytest.param("delta", "motor", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("verb", ["inverse_dynamics", "forward_dynamics"])
@pytest.mark.parametrize(("name", "coordinates"), DERIVATIVES)
def test_derivatives_are_differences(
    name: str, coordinates: str, verb: str, rng: np.random.Generator
) -> None:
    many = kernels(name, coordinates)
    state, motion = state_of(many, rng)
    wrenches = 10 * rng.normal(size=6 * len(many.wrenches))
    if verb == "forward_dynamics":
        motion[2] = stp.inverse_dynamics(state, wrenches=by_link(many, wrenches)).tau_motor
    given = [*motion, wrenches]
    found = getattr(many, f"{verb}_derivatives")(*given)
    assert len(found) == 4
    twists = many._functions.placed.plan.twists if coordinates == "platform" else np.eye(many.chain.nu)
    of_motors = verb == "forward_dynamics" or coordinates == "motor"
    ways = [twists, twists, np.eye(len(motion[2])) if of_motors else twists, np.eye(len(wrenches))]
    for k, along in enumerate(ways):
        way = along @ rng.normal(size=along.shape[1])

        def at(t: float, k: int = k, way: np.ndarray = way) -> np.ndarray:
            moved = list(given)
            moved[k] = given[k] + t * way if k else displaced(many, given[0], t * way)
            return getattr(many, verb)(*moved)

        expected = slope(at, 1e-3)
        # What is differenced has the size of the result: its round-off over the step is left.
        size = max(np.abs(expected).max(), 1e-3 * np.abs(at(0.0)).max())
        assert np.abs(found[k] @ way - expected).max() <= 1e-7 * size, k


@pytest.mark.parametrize(
    ("name", "coordinates"),
    [
        ("four_bar", "motor"),
        ("four_bar", "tree"),
        *(
            pytest.param(name, coordinates, marks=pytest.mark.slow)
            for name, coordinates in (
                ("rpr_planar", "platform"),
                ("five_bar", "motor"),
                ("stewart", "platform"),
                ("hexapod_rss", "motor"),
                ("3-RRR, motor to spare", "platform"),
                ("six cranks", "platform"),
            )
        ),
    ],
)
def test_derivatives_by_the_geometry(name: str, coordinates: str, rng: np.random.Generator) -> None:
    many = kernels(name, coordinates)
    drawn = held_state(many.chain, coordinates, many.geometry_held, rng)
    wrenches = 10 * rng.normal(size=6 * len(many.wrenches))
    held = replace(drawn, wrenches=by_link(many, wrenches))
    basis = many.geometry_displacements
    alone = basis[:, np.count_nonzero(basis, axis=0) == 1]  # others keep the mobility to the first order only
    sizes = [many.chain.length_scale if p.unit == "m" else 1.0 for p in many.geometry_parameters]
    way = sizes * (alone @ rng.uniform(-0.5, 0.5, alone.shape[1]))
    moved = [(p, x) for p, x in zip(many.geometry_parameters, way, strict=True) if x]
    for verb in ("inverse_dynamics", "forward_dynamics"):
        given = [ca.DM(x) for x in (*held.inputs[verb], wrenches)]
        found = np.array(many.casadi(f"{verb}_by_tree").call(given)[0]) @ way
        expected = slope(lambda t, verb=verb: held.answer(verb, {p: t * x for p, x in moved}), 2e-4)
        close(found, expected, 1e-7)


@pytest.mark.slow
def test_derivatives_by_the_ends_of_legs_are_those_of_the_tree(rng: np.random.Generator) -> None:
    many = kernels("stewart")
    state, motion = state_of(many, rng)
    wrenches = 10 * rng.normal(size=6 * len(many.wrenches))
    for verb in ("inverse_dynamics", "forward_dynamics"):
        if verb == "forward_dynamics":
            motion[2] = stp.inverse_dynamics(state, wrenches=by_link(many, wrenches)).tau_motor
        legs = many._functions.leg_displacements
        by_legs = many.casadi(f"{verb}_by_legs").call([ca.DM(x) for x in (*motion, wrenches)])[0]
        by_tree = many.casadi(f"{verb}_by_tree")
        whole = by_tree.call([ca.DM(x) for x in (state.q, *motion[1:], wrenches)])[0]
        close(np.array(by_legs), np.array(whole)[:, list(legs)], 1e-9)


def test_efforts_are_the_regressor_and_the_share_of_the_wrenches(rng: np.random.Generator) -> None:
    many = kernels("rpr_planar")
    _, motion = state_of(many, rng)
    wrenches = 10 * rng.normal(size=6 * len(many.wrenches))
    share = many.inverse_dynamics_derivatives(*motion, wrenches)[3]
    expected = many.regressor(*motion) @ many.inertial_parameters + share @ wrenches
    close(many.inverse_dynamics(*motion, wrenches), expected, 1e-12)


# ----------------------------------------------------------------------------------------------------
# What is said in one line
# ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "coordinates"),
    [
        ("scissor_lift", "tree"),
        *(pytest.param("three_rps", c, marks=pytest.mark.slow) for c in ("platform", "motor")),
    ],
)
def test_a_weight_is_that_of_its_payload(name: str, coordinates: Any) -> None:
    chain, mass = robot(name), 2.5
    loaded = stp.attach_payload(chain, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))))
    many = compile_kernels(chain, coordinates=coordinates, wrenches=(chain.platform,), engine="numpy")
    position, size = {
        "platform": (pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home)), 6),
        "motor": (chain.q_home[chain.motor_q_index], chain.nu),
        "tree": (chain.q_home, chain.nv),
    }[coordinates]
    rest, weight = np.zeros(size), np.concatenate([mass * chain.gravity, np.zeros(3)])
    own, expected = (
        stp.inverse_dynamics(one, chain.q_home, np.zeros(chain.nv), np.zeros(chain.nv))
        for one in (chain, loaded)
    )
    share = many.inverse_dynamics(position, rest, rest, weight) - own.tau_motor
    close(share, expected.tau_motor - own.tau_motor, 1e-9)
    assert np.abs(share).max() > 0.1
    close(many.reactions(position, rest, rest, weight), expected.lambda_c, 1e-9)


@cache
def tooled() -> stp.ClosedChain:
    """Fix a tool to the plate of a planar platform."""
    old = robot("rpr_planar").described()
    tool = Joint(
        "tool_fixed",
        F,
        old.platform,
        "tool",
        pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.2])), np.array([0.1, -0.05, 0.2])),
    )
    return build_chain(
        replace(old, links=(*old.links, Link("tool")), joints=(*old.joints, tool)),
        motors=robot("rpr_planar").motors,
    )


@pytest.mark.parametrize("coordinates", ["platform", "tree"])
def test_wrenches_elsewhere_on_the_platform_have_their_arm(
    coordinates: Any, rng: np.random.Generator
) -> None:
    chain = tooled()
    links = (chain.platform, "tool")
    many = compile_kernels(chain, coordinates=coordinates, wrenches=links, engine="numpy")
    state, motion = state_of(many, rng)
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, state.q)
    here, there = (data.oMf[chain.model.getFrameId(link)].translation for link in links)
    wrench = rng.normal(size=6)
    moved = wrench + np.concatenate([np.zeros(3), np.cross(there - here, wrench[:3])])
    on_tool, on_plate = np.concatenate([np.zeros(6), wrench]), np.concatenate([moved, np.zeros(6)])
    for verb in ("inverse_dynamics", "reactions"):
        close(getattr(many, verb)(*motion, on_tool), getattr(many, verb)(*motion, on_plate), 1e-11)


def test_a_wrench_on_the_ground_changes_nothing(rng: np.random.Generator) -> None:
    many = kernels("rpr_planar")
    bare = compile_kernels(many.chain, engine="numpy")
    _, motion = state_of(many, rng)
    ground = many.wrenches.index(many.chain.mechanism.root)
    wrenches = np.zeros((len(many.wrenches), 6))
    wrenches[ground] = 1e3 * rng.normal(size=6)
    close(many.inverse_dynamics(*motion, wrenches.ravel()), bare.inverse_dynamics(*motion), 1e-14)
    wrenches[ground, 2], status = np.nan, np.zeros(1, dtype=np.int8)
    many.inverse_dynamics(*(x[None] for x in motion), wrenches.ravel(), status=status)
    assert status[0] == StateStatus.INPUT_NOT_FINITE


@pytest.mark.parametrize("name", ["four_bar", "rpr_planar"])
@pytest.mark.parametrize("coordinates", ["platform", "motor", "tree"])
def test_one_state_as_many_bit_for_bit(name: str, coordinates: str, rng: np.random.Generator) -> None:
    many = kernels(name, coordinates)
    states = [state_of(many, rng)[1] for _ in range(3)]
    motion = [np.array(x) for x in zip(*states, strict=True)]
    wrenches = 10 * rng.normal(size=(3, 6 * len(many.wrenches)))
    one = many.single_state("inverse_dynamics")
    every = many.inverse_dynamics(*motion, wrenches)
    for k in range(3):
        np.testing.assert_array_equal(one(*(x[k] for x in motion), wrenches[k]), every[k])
    # The same wrench for all states, and several wrenches on one state.
    np.testing.assert_array_equal(many.inverse_dynamics(*motion, wrenches[1])[1], every[1])
    several = many.inverse_dynamics(*(x[2] for x in motion), wrenches)
    np.testing.assert_array_equal(several[2], every[2])
    with pytest.raises(InputError, match="takes 4 arrays"):
        one(*(x[0] for x in motion))


def test_machine_code_single_precision_and_pickles(rng: np.random.Generator) -> None:
    many = kernels("four_bar")
    _, motion = state_of(many, rng)
    wrenches = rng.normal(size=6 * len(many.wrenches))
    expected = many.inverse_dynamics(*motion, wrenches)
    close(kernels("four_bar", engine="llvm").inverse_dynamics(*motion, wrenches), expected, 1e-13)
    # 1e-7 of round-off, times a few hundred operations that cancel.
    close(kernels("four_bar", dtype=np.float32).inverse_dynamics(*motion, wrenches), expected, 1e-4)
    again = pickle.loads(pickle.dumps(many))
    assert again.wrenches == many.wrenches
    np.testing.assert_array_equal(again.inverse_dynamics(*motion, wrenches), expected)


def test_kernels_say_what_acts() -> None:
    many = kernels("four_bar")
    assert many.wrenches == many.report.wrenches == links_of(many.chain)
    assert f"wrenches on {', '.join(many.wrenches)}" in str(many.report)
    assert many.casadi("inverse_dynamics").name_in()[-1] == "wrenches"
    assert "wrenches" not in many.casadi("regressor").name_in()
    assert "wrenches" not in str(compile_kernels(many.chain, engine="numpy").report)


def test_wrong_wrenches_are_refused() -> None:
    chain = robot("four_bar")
    many, bare = kernels("four_bar"), compile_kernels(chain, engine="numpy")
    rest = np.zeros(6)
    pose = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    size = 6 * len(many.wrenches)
    for verb in (
        "inverse_dynamics",
        "reactions",
        "inverse_dynamics_derivatives",
        "inverse_dynamics_geometry",
    ):
        with pytest.raises(
            InputError, match=rf"wrenches must be given, \(N, {size}\).* on {many.wrenches[0]}, "
        ):
            getattr(many, verb)(pose, rest, rest)
        with pytest.raises(InputError, match=r"compiled without; use compile_kernels\(chain, wrenches="):
            getattr(bare, verb)(pose, rest, rest, rest)
    with pytest.raises(
        InputError, match=rf"wrenches must have shape \(N, {size}\) or \({size},\), got \(6,\)"
    ):
        many.inverse_dynamics(pose, rest, rest, rest)
    with pytest.raises(InputError, match="wrenches must be an array of real numbers, got dict"):
        many.inverse_dynamics(pose, rest, rest, {"coupler": rest})
    near = chain.mechanism.links[1].name
    with pytest.raises(InputError, match=f"did you mean {near!r}"):
        compile_kernels(chain, wrenches=(near + "x",))
    with pytest.raises(InputError, match=r"wrenches must be a sequence of names of links.*got 'crank'"):
        compile_kernels(chain, wrenches="crank")
    with pytest.raises(InputError, match=f"wrenches names {near!r} twice"):
        compile_kernels(chain, wrenches=(near, near))


# ----------------------------------------------------------------------------------------------------
# Idle freedoms
# ----------------------------------------------------------------------------------------------------


@cache
def spinning(inertia: pin.Inertia | None = None, *, level: bool = False) -> stp.ClosedChain:
    """Build a crank and a rocker, a rod on balls between them, and a tip beside the axis about which it spins."""
    tilt = pin.SE3(np.eye(3) if level else pin.exp3(np.array([0.6, 0.2, 0.0])), np.zeros(3))
    ends = {"crank": 0.3, "rod": 0.8, "rocker": 0.6}
    links = [Link("ground"), *(Link(name, rod(length)) for name, length in ends.items()), Link("tip")]
    if inertia is not None:
        links[2] = Link("rod", inertia)
    joints = (
        Joint("motor", R, "ground", "crank", tilt, independent=True),
        Joint("elbow", S, "crank", "rod", at(0.3)),
        Joint("hinge", R, "ground", "rocker", tilt * at(0.9)),
        Joint("fixed", F, "rod", "tip", at(0.5, 0.1)),
    )
    loop = Loop("ball", S, "rocker", "rod", at(0.6), at(0.8))
    home = {"motor": [1.0], "elbow": [0, 0, np.sin(-0.35), np.cos(-0.35)], "hinge": [1.8]}
    parts = Mechanism("spinning", tuple(links), joints, (loop,), platform="rocker")
    return mechanisms._near(parts, home, ("motor",))


def test_points_that_spin_are_left_to_whole_states(rng: np.random.Generator) -> None:
    chain = spinning()
    assert chain.generic.count.idle == 1
    for coordinates in ("platform", "motor"):
        with pytest.raises(
            UnsupportedError, match=r"a wrench on 'tip'.*idle freedoms .* move.*coordinates='tree'"
        ):
            compile_kernels(chain, coordinates=coordinates, wrenches=("rod", "tip"))
    many = compile_kernels(chain, coordinates="tree", wrenches=("rod", "tip"), engine="numpy")
    state, motion = state_of(many, rng)
    wrenches = rng.normal(size=12)
    expected = stp.inverse_dynamics(state, wrenches=by_link(many, wrenches)).tau_motor
    close(many.inverse_dynamics(*motion, wrenches), expected, AGREE)


def test_spins_do_not_matter_where_gravity_does_no_work() -> None:
    chain = spinning(level=True)
    assert compile_kernels(chain, coordinates="motor", engine="numpy").report.freedoms == 1
    assert telling_wrenches(chain, ("rod",)) == ()


@pytest.mark.parametrize("coordinates", ["platform", "motor", "tree"])
def test_what_spins_without_inertia_has_no_answer_to_moments(
    coordinates: Any, rng: np.random.Generator
) -> None:
    require_answers_but_to_spins(spinning(pin.Inertia.Zero()), "rod", 0, coordinates, rng)


@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_what_is_round_to_nine_digits_tells_where_it_spins(
    coordinates: Any, rng: np.random.Generator
) -> None:
    round_rod = rod(0.8)
    uneven = round_rod.inertia + 1e-9 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]])
    chain = spinning(pin.Inertia(round_rod.mass, round_rod.lever, uneven))
    assert telling_wrenches(chain, ("rod", "rocker")) == ("rod",)
    assert telling_wrenches(spinning(), ("rod", "rocker")) == ()
    require_answers_but_to_spins(chain, "rod", 0, coordinates, rng)


@pytest.mark.slow
@pytest.mark.parametrize("coordinates", ["platform", "motor", "tree"])
def test_what_spins_without_inertia_in_legs(coordinates: Any, rng: np.random.Generator) -> None:
    chain = stp.massless_legs(robot("stewart_sps"))
    require_answers_but_to_spins(chain, chain.mechanism.links[-1].name, 2, coordinates, rng)


@pytest.mark.slow
@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_what_is_round_to_six_digits_in_legs(coordinates: Any, rng: np.random.Generator) -> None:
    chain = robot("linear_delta")
    joint = chain.mechanism.joint("rod3b_spin")
    require_answers_but_to_spins(chain, "rod3b", np.array(joint.axis), coordinates, rng)


def require_answers_but_to_spins(
    chain: stp.ClosedChain, link: str, along: Any, coordinates: Any, rng: np.random.Generator
) -> None:
    """Require that forces and moments across the spin of a link are carried, and a moment about it refused."""
    many = compile_kernels(chain, coordinates=coordinates, wrenches=(link,), engine="numpy")
    state, motion = state_of(many, rng)
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, state.q)
    axis = data.oMf[chain.model.getFrameId(link)].rotation @ (
        np.eye(3)[along] if np.ndim(along) == 0 else along
    )
    force, none = rng.normal(size=3), np.zeros(3)
    wrenches = np.array(
        [[*none, *none], [*force, *none], [*force, *np.cross(axis, force)], [*force, *(1e-3 * axis)]]
    )
    status = np.zeros(4, dtype=np.int8)
    found = many.inverse_dynamics(*motion, wrenches, status=status)
    assert status.tolist() == [StateStatus.OK] * 3 + [StateStatus.OUT_OF_BOUNDS]
    for k in range(3):
        close(found[k], stp.inverse_dynamics(state, wrenches={link: wrenches[k]}).tau_motor, 1e-8)
    if coordinates != "tree":
        derivatives = many.inverse_dynamics_derivatives(*motion, wrenches, status=status)
        assert status.tolist() == [StateStatus.OK] * 3 + [StateStatus.OUT_OF_BOUNDS]
        assert np.isnan(derivatives[0][3]).all()


def test_a_load_on_the_platform_costs_little() -> None:
    bare = count_operations(compile_kernels(robot("stewart")).casadi("inverse_dynamics"))
    loaded = count_operations(
        compile_kernels(robot("stewart"), wrenches=("platform",)).casadi("inverse_dynamics")
    )
    assert loaded <= bare + 6  # a wrench at the platform's own origin is subtracted, entry by entry
