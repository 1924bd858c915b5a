"""Derivatives of the dynamics by the geometry: against differences of rebuilt chains, by another way."""

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
from stewart_pin.errors import ClosureError, UnsupportedError
from stewart_pin.kernels.graph.held_motion import _held
from stewart_pin.kernels.planning.samples import idle_moved
from tests import mechanisms
from tests.closed_states import KINDS, close, robot, slow_but_for_few
from tests.kernels.held_motions import HeldState, held_state, slope
from tests.kernels.platforms import PLATFORMS
from tests.zoo.table import ROBOTS

VERBS = ("inverse_dynamics", "forward_dynamics")
SMALL = ("arm_3r_planar", "four_bar")
# Differences of order 6 along directions of about one size, all parameters at once: (h/size)⁶/140 for shapes that
# change over a tenth of the size, and eps/h times the condition of a robot, some hundreds, are both below 1e-9.
STEP, RELATIVE = 2e-4, 1e-8

CASES = [
    pytest.param(
        name,
        coordinates,
        marks=() if name in SMALL else pytest.mark.slow,
    )
    for name in ROBOTS
    for coordinates in ("platform", "motor", "tree")
    # The elbow of the arm may move while the tool rests; the third of the six universal legs tells nothing new.
    if (name, coordinates) != ("arm_7r", "platform") and name != "stewart_cad"
]


def fat_rods() -> stp.ClosedChain:
    """Six cranks with heavy balls for rods about their elbows: only the rates of their spins tell, not the angles.

    A head that is displaced across such a rod turns the axis of its spin, and with it what carries no momentum.
    """
    chain = mechanisms.rotary_hexapod()
    ball = pin.Inertia(0.2, np.zeros(3), 0.01 * np.eye(3))
    return stp.build.replace_inertias(chain, {f"rod{k}": ball for k in range(6)})


def chain_named(name: str) -> stp.ClosedChain:
    if name == "fat rods":
        return fat_rods()
    if name in PLATFORMS and name not in stp.robots():
        return PLATFORMS[name]()
    return mechanisms.five_bar() if name == "motor to spare" else robot(name)


@cache
def kernels_of(name: str, coordinates: Any) -> stp.compiled.Kernels:
    return stp.compile_kernels(chain_named(name), coordinates=coordinates, engine="numpy")


@cache
def state_of(name: str, coordinates: str) -> HeldState:
    kernels = kernels_of(name, coordinates)
    rng = np.random.default_rng(zlib.crc32(f"{name} {coordinates}".encode()))
    return held_state(kernels.chain, coordinates, kernels.geometry_held, rng)


def derivatives(kernels: stp.compiled.Kernels, state: HeldState, verb: str) -> np.ndarray:
    """One state by CasADi itself: compiling for one state takes longer than it is worth."""
    found = kernels.casadi(f"{verb}_by_tree").call([ca.DM(x) for x in state.inputs[verb]])
    return np.array(found[0])


def differences(
    kernels: stp.compiled.Kernels, state: HeldState, verb: str, direction: np.ndarray, step: float
) -> np.ndarray:
    parameters = kernels.geometry_parameters
    used = [(p, x) for p, x in zip(parameters, direction, strict=True) if x]
    return slope(lambda t: state.answer(verb, {p: t * x for p, x in used}), step)


def agree_along(
    name: str,
    coordinates: str,
    directions: np.ndarray,
    verbs: tuple[str, ...] = VERBS,
    *,
    step: float = STEP,
) -> None:
    kernels, state = kernels_of(name, coordinates), state_of(name, coordinates)
    for verb in verbs:
        found = derivatives(kernels, state, verb)
        expected = [differences(kernels, state, verb, direction, step) for direction in directions.T]
        close(found @ directions, np.transpose(expected), RELATIVE)


def mixed(kernels: stp.compiled.Kernels, count: int) -> np.ndarray:
    """Random combinations of all displacements that may be made, sizes as those of the robot: each column counts."""
    rng = np.random.default_rng(17)
    basis = kernels.geometry_displacements
    sizes = np.array(
        [kernels.chain.length_scale if p.unit == "m" else 1.0 for p in kernels.geometry_parameters]
    )
    alone = np.count_nonzero(basis, axis=0) == 1
    return sizes[:, None] * (basis[:, alone] @ rng.uniform(-0.5, 0.5, (np.count_nonzero(alone), count)))


@pytest.mark.parametrize(("name", "coordinates"), CASES)
def test_every_robot_in_all_coordinates(name: str, coordinates: str) -> None:
    kernels = kernels_of(name, coordinates)
    if (
        coordinates == "tree"
        and kernels.chain.nc
        and kernels.chain.at(kernels.chain.q_home).freedom.idle.size
    ):
        # Displaced all at once, idle spins move the platform to the second order, and inverse dynamics refuses that.
        single = np.eye(len(kernels.geometry_parameters))[:, 5::23]
        agree_along(name, coordinates, single, VERBS[:1])
        agree_along(name, coordinates, mixed(kernels, 1), VERBS[1:])
    else:
        agree_along(name, coordinates, mixed(kernels, 2))


OTHERS = [
    ("legs on the platform", "platform"),
    ("six rails", "platform"),
    ("fat rods", "platform"),
    ("3-RRR, motor to spare", "platform"),
    ("motor to spare", "motor"),
]


@pytest.mark.parametrize(
    ("name", "coordinates"),
    [pytest.param(*case, marks=pytest.mark.slow) for case in OTHERS],
)
def test_other_structures(name: str, coordinates: str) -> None:
    """Legs that hang on the platform, a platform frame off its body, spins that tell, motors that share their load."""
    agree_along(name, coordinates, mixed(kernels_of(name, coordinates), 2))


@pytest.mark.parametrize("kind", slow_but_for_few(KINDS, ["spherical", "gear_train"]))
def test_every_kind_of_closure(kind: str) -> None:
    """Whole states, in which idle freedoms obey their own inertia."""
    agree_along(kind, "tree", mixed(kernels_of(kind, "tree"), 2))


@pytest.mark.parametrize("name", slow_but_for_few(["four_bar", "five_bar"], ["four_bar"]))
def test_what_locks_has_no_derivative(name: str) -> None:
    """A parameter comes out as nan where, and only where, the chain displaced by it cannot be closed."""
    kernels, state = kernels_of(name, "motor"), state_of(name, "motor")
    q = state.q[kernels.chain.motor_q_index]
    found = kernels.inverse_dynamics_geometry(q, state.rates, state.accelerations)
    locked = []
    for parameter in kernels.geometry_parameters:
        try:
            stp.build.displace_geometry(kernels.chain, {parameter: 1e-3})
        except ClosureError:
            locked.append(parameter)
    missing = [
        p for p, column in zip(kernels.geometry_parameters, found.T, strict=True) if np.isnan(column).all()
    ]
    assert len(locked) > 10
    assert missing == locked
    assert np.isnan(found).sum() == len(locked) * kernels.chain.nu
    column = np.zeros((len(kernels.geometry_parameters), 1))
    column[kernels.geometry_parameters.index(locked[0])] = 1.0
    with pytest.raises(
        UnsupportedError, match=r"no derivative along column 0 of along \(joint '.*would lose its"
    ):
        kernels.inverse_dynamics_geometry(q, state.rates, state.accelerations, along=column)


@pytest.mark.parametrize("name", slow_but_for_few(["four_bar", "five_bar", "rpr_planar"], ["four_bar"]))
def test_combinations_keep_what_each_alone_would_lock(name: str) -> None:
    """All hinges of a planar robot tilted or shifted together, and the like."""
    kernels = kernels_of(name, "motor")
    basis = kernels.geometry_displacements
    combined = basis[:, np.count_nonzero(basis, axis=0) > 1]
    assert combined.shape[1] >= 7
    # With the single ones they span all that does not open the redundant rows.
    assert np.linalg.matrix_rank(basis) == basis.shape[1]
    # They hold to the first order: farther away the loops do not close to the last digit.
    agree_along(name, "motor", combined, step=1e-5 * min(1.0, kernels.chain.length_scale))


HEXAPODS = ("stewart", "stewart_sps", "six cranks, rods askew", "six rails", "ball in the tree")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "stewart" else pytest.mark.slow) for name in HEXAPODS]
)
def test_closed_forms_of_legs_agree_with_the_whole_tree(name: str, rng: np.random.Generator) -> None:
    kernels = kernels_of(name, "platform")
    legs = list(kernels._functions.leg_displacements)
    # One leg of the last is cut where it carries the platform: there the joint is displaced, which legs do not know.
    assert len(legs) == (33 if name == "ball in the tree" else 36)
    state = state_of(name, "platform")
    pose = np.concatenate([state.pose.translation, pin.Quaternion(state.pose.rotation).coeffs()])
    for verb, inputs in state.inputs.items():
        by_legs = kernels.casadi(f"{verb}_by_legs").call([ca.DM(x) for x in (pose, *inputs[1:])])[0]
        close(np.array(by_legs), derivatives(kernels, state, verb)[:, legs], 1e-11)


def test_dependent_coordinates_are_not_held() -> None:
    functions = kernels_of("rpr_planar", "platform")._functions
    rows, names = functions.driven.drive, ("vx", "vy", "vz")
    with pytest.raises(UnsupportedError, match=r"held of rpr_planar \(vx, vy, vz\) does not determine"):
        _held(functions.closed, rows, np.ones(6), names, [0, 1, 2], True, functions.driven.idle)


@pytest.mark.parametrize("name", ["delta", "legs on the platform", "rpr_planar", "five_bar"])
def test_legs_leave_the_rest_to_the_whole_tree(name: str) -> None:
    assert kernels_of(name, "platform")._functions.leg_displacements == ()


@pytest.mark.slow
def test_derivatives_that_depend_on_idle_freedoms_are_left_out(rng: np.random.Generator) -> None:
    """A ball beside the axis of its rod moves the platform with the rod's spin; one farther along the rod does not."""
    kernels, state = kernels_of("six cranks", "platform"), state_of("six cranks", "platform")
    chain = kernels.chain
    alone = kernels._functions.displacements.alone
    missing = [str(p) for p, x in zip(kernels.geometry_parameters, alone, strict=True) if not x]
    assert missing == [
        f"loop 'ball{k}', frame 2: shift {axis} in 'rod{k}'" for k in range(6) for axis in "yz"
    ]
    idle = chain.at(state.q).freedom.idle
    spun = replace(state, q=idle_moved(chain, state.q, idle @ rng.uniform(0.5, 1.0, idle.shape[1])))
    for parameter in kernels.geometry_parameters:
        if parameter.owner == "ball2" and parameter.unit == "m":
            here, there = (
                slope(lambda t, s=s, p=parameter: s.answer("inverse_dynamics", {p: t}), STEP)
                for s in (state, spun)
            )
            change = np.abs(here - there).max() / np.abs(here).max()
            # Differences hold seven digits here, and the spin of a tenth of a turn changes the first.
            assert (change > 1e-2) if str(parameter) in missing else (change < 1e-6), str(parameter)


@pytest.mark.slow
def test_nothing_is_left_out_where_the_angles_of_spins_do_not_matter() -> None:
    """With rods that are balls about their elbows even a head beside the axis leaves the efforts determined."""
    basis = kernels_of("fat rods", "platform").geometry_displacements
    np.testing.assert_array_equal(basis, np.eye(144))
