"""Rules that every row of the table of verbs keeps: no state is answered that none has judged."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph import driven_tree
from stewart_pin.kernels.graph.function_set import Coordinates, FunctionSet
from stewart_pin.kernels.graph.verbs import VERBS, Verb
from stewart_pin.kernels.verbs.calling import Places, SingleVerb
from stewart_pin.programs.status import StateStatus
from tests.closed_states import robot

WAYS: list[tuple[str, Coordinates]] = [
    ("four_bar", "tree"),
    ("four_bar", "motor"),
    ("four_bar", "platform"),
    ("rpr_planar", "platform"),  # legs with closed forms
]


@pytest.mark.parametrize(("name", "coordinates"), WAYS)
def test_every_motion_is_judged(name: str, coordinates: Coordinates) -> None:
    functions = FunctionSet(robot(name), coordinates)
    for verb, row in VERBS.items():
        if verb not in functions.names or verb == "conditioning":
            continue
        function = functions.function(verb)
        if coordinates == "tree":
            assert "open" in function.name_out(), f"{verb} does not tell how far a state is from closed loops"
        elif function.n_in() > 1:
            assert "infeasible" in function.name_out(), f"{verb} does not tell what the chain cannot do"
        if function.n_in() > 1:
            assert row.solves != "nothing", f"{verb} divides, and no singularity is told"


def test_every_verb_is_for_single_states() -> None:
    assert set(VERBS) - {"conditioning"} <= set(get_args(SingleVerb))


def test_open_loops_have_no_regressor(rng: np.random.Generator) -> None:
    chain = robot("four_bar")
    many = stp.compile_kernels(chain, coordinates="tree", engine="numpy")
    q = np.array([chain.q_home, pin.integrate(chain.model, chain.q_home, 0.3 * rng.normal(size=chain.nv))])
    status = np.empty(2, dtype=np.int8)
    found = many.regressor(q, np.zeros(chain.nv), np.zeros(chain.nv), status=status)
    assert np.isfinite(found[0]).all() and np.isnan(found[1]).all()
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS]


@pytest.mark.parametrize("coordinates", ["platform", "motor"])
def test_a_verb_without_closed_forms_asks_the_whole_tree(
    coordinates: Coordinates, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = Verb(driven=driven_tree.driven_inverse_dynamics, solves="motors")
    monkeypatch.setitem(VERBS, "efforts", row)
    chain = robot("rpr_planar")  # legs with closed forms
    many = stp.compile_kernels(chain, coordinates=coordinates, engine="numpy")
    assert many.by_legs
    place = stp.motor_positions(chain, chain.q_home)
    if coordinates == "platform":
        place = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    still = np.zeros(6 if coordinates == "platform" else chain.nu)
    found = many._call("efforts", (place, still, still), Places(None, None, None, 1))
    np.testing.assert_allclose(found, many.inverse_dynamics(place, still, still), rtol=0, atol=1e-9)


def test_no_conditioning_is_made_up() -> None:
    many = stp.compile_kernels(robot("rpr_planar"), engine="numpy")
    pose = pin.SE3ToXYZQUAT(stp.platform_pose(many.chain, many.chain.q_home))
    with pytest.raises(UnsupportedError, match="'inverse_kinematics' divides by nothing"):
        many._call("inverse_kinematics", (pose,), Places(None, None, np.empty(1), 1))
