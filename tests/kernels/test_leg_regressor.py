"""Regressors leg by leg against Pinocchio's and the whole tree."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.graph.function_set import FunctionSet
from stewart_pin.kernels.graph.regressor import platform_regressor
from stewart_pin.kernels.kernels import compile_kernels, count_operations
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, robot
from tests.kernels.platforms import PLATFORMS
from tests.kernels.test_compile import LIKE_ANOTHER, kernels, platform_states
from tests.kernels.test_leg_reactions import BUNDLED, placed_platform
from tests.kernels.test_platform_dynamics import platform, states
from tests.kernels.tied_platforms import TIED

AGREE = 1e-10
HAVE_IDLE = ("stewart_sps", "delta", "hexapod_rss")
IDLE = ("stewart_sps", "six cranks", "six cranks, rods askew", "delta, balls", "ball in the tree, idle spins")


def pinocchios(chain: stp.ClosedChain, state: stp.State) -> np.ndarray:
    """Project Pinocchio's regressor of the tree on the motors: the least efforts that do its work."""
    whole = pin.computeJointTorqueRegressor(chain.model, pin.Data(chain.model), state.q, state.v, state.a)
    motions = chain.at(state.q).freedom.motions
    return np.linalg.pinv(motions[chain.motor_index].T) @ motions.T @ whole


@pytest.mark.parametrize("name", [name for name in (*PLATFORMS, *TIED) if name not in IDLE])
def test_regressor_is_pinocchios_for_the_motors(name: str, rng: np.random.Generator) -> None:
    placed = placed_platform(name)
    regressor = platform_regressor(placed)
    for pose, twist, acceleration, s in states(placed, rng, 2):
        found = np.array(regressor.call([pose, twist, acceleration])[0])
        close(found, pinocchios(placed.plan.chain, s), AGREE)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow) if n in LIKE_ANOTHER else n
        for n in BUNDLED
        if n not in HAVE_IDLE
    ],
)
def test_regressor_of_bundled_robots(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    tree = compile_kernels(many.chain, coordinates="tree").casadi("regressor")
    whole, (pose, twist, acceleration, _) = platform_states(many, rng, 3)
    regressor = many.regressor(pose, twist, acceleration)
    assert many.casadi("regressor").name_in() == ["pose", "twist", "acceleration"]
    efforts = many.inverse_dynamics(pose, twist, acceleration)
    for k, s in enumerate(whole):
        close(regressor[k] @ many.inertial_parameters, efforts[k], AGREE)
        close(regressor[k], np.array(tree(s.q, s.v, s.a)[0]), AGREE)


@pytest.mark.parametrize("name", [*HAVE_IDLE, *IDLE[1:]])
def test_idle_freedoms_are_refused(name: str) -> None:
    chain = PLATFORMS[name]() if name in PLATFORMS else robot(name)
    idle = len(stp.mobility(chain).idle)
    for functions in (FunctionSet(chain, "platform"), FunctionSet(chain, "tree")):
        with pytest.raises(stp.errors.UnsupportedError, match=f"has {idle} idle .* not linear"):
            functions.function("regressor")


def test_a_demand_that_the_platform_cannot_follow_has_a_code(rng: np.random.Generator) -> None:
    many = kernels("rpr_planar")
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    twist[1] += [0.0, 0.0, 0.3, 0.2, 0.0, 0.0]
    status = np.empty(2, dtype=np.int8)
    assert np.isnan(many.regressor(pose, twist, acceleration, status=status)[1]).all()
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS]


def test_the_regressor_costs_three_times_the_efforts() -> None:
    # The whole tree takes 6758 operations besides the Newton steps that close it; every entry is written, 1140 in all.
    assert count_operations(platform_regressor(platform("stewart"))) <= 4700
    assert count_operations(platform_regressor(platform("3-RPR"))) <= 720
