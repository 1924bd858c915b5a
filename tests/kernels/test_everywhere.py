"""Kernels at many regular states of every kind of mechanism, in all coordinates, see `everywhere`."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.graph.verbs import VERBS
from tests.closed_states import slow_but_for_few
from tests.kernels.everywhere import COORDINATES, Coordinates, Mechanism, examine
from tests.zoo.table import REFUSED, ROBOTS

QUICK = ("planetary_gear", "lever_on_a_cylinder", "triple_rocker", "wedge", "five_bar", "door_on_two_hinges")
SLOW = (
    *(name for name in ROBOTS if name not in (*QUICK, "stewart_cad", "stewart_s1")),
    *("tricept", "three_rps", "schoenflies_4puu", "spherical_4r", "agile_eye", "cardan_shaft"),
    *("bevel_differential", "rccc", "watt_six_bar", "scissor_lift", "screw_jack", "bennett", "sarrus"),
)
"""Every bundled robot, hexapods with the joints of `stewart` by it alone; hinges, balls, slides, cylinders, screws and
gears; redundant rows and overconstrained loops; one motor to seven. The whole zoo, with 1e5 states of each, has
``python -m tests.benchmarks.everywhere``."""
LONGER = ("lever_on_a_cylinder", "triple_rocker")
"""Of the quick ones those that take seconds and are moved as others are: asked with the slow ones."""
NAMES = slow_but_for_few((*QUICK, *SLOW), [name for name in QUICK if name not in LONGER])
STATES, JUDGED = {True: 800, False: 250}, {True: 8, False: 4}
"""States of `QUICK` and `SLOW`, and those of each kind that the verbs of one state judge: compiling takes longest."""


@pytest.mark.parametrize("name", NAMES)
def test_kernels_answer_everywhere(name: str, rng: np.random.Generator) -> None:
    quick = name in QUICK
    mechanism, count = Mechanism(name), STATES[quick]
    idle = bool(mechanism.chain.generic.count.idle)
    states = mechanism.draw(count, rng)
    # Motors and platform say nothing of how idle freedoms move: at rest nothing depends on them.
    still = mechanism.draw(count, rng, moving=False) if idle else states
    assert len(states) > 0.8 * count
    for coordinates in COORDINATES:
        found = examine(
            mechanism, coordinates, states if coordinates == "tree" else still, rng, JUDGED[quick]
        )
        if found is None:
            assert (coordinates, name) in REFUSED or (coordinates, name) == ("platform", "arm_7r")
            continue
        assert found.wrong == 0 and found.missing == 0 and found.bold == 0, (coordinates, found)
        # An arm turns about singularities: half of what it can take it reaches on no straight way from home.
        assert found.answered > 0.4 * found.states, (coordinates, found)
        # Accelerations go through the inverse of the inertia, and through the configuration twice.
        assert found.undone <= 1e-6, (coordinates, found)


ONE_MOTOR: list[tuple[str, Coordinates]] = [
    (name, coordinates)
    for name in ("four_bar", "planetary_gear", "slider_crank")
    for coordinates in COORDINATES
]


@pytest.mark.parametrize(("name", "coordinates"), ONE_MOTOR)
def test_shapes_for_one_motor(name: str, coordinates: Coordinates) -> None:
    """An axis of one entry is kept, in arrays of states and in one alone."""
    mechanism = Mechanism(name, engine="numpy")
    chain, kernels = mechanism.chain, mechanism.kernels(coordinates)
    assert kernels is not None and chain.nu == 1
    pose = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    place, size = {"tree": (chain.q_home, chain.nv), "motor": (chain.q_home[chain.motor_q_index], 1)}.get(
        coordinates, (pose, 6)
    )
    still, tau, parameters = np.zeros(size), np.zeros(1), len(kernels.inertial_parameters)
    shapes: dict[str, tuple[int, ...]] = {
        "inverse_dynamics": (1,),
        "forward_dynamics": (size,),
        "reactions": (chain.nc,),
        "regressor": (1, parameters),
        "conditioning": (),
    }
    given = {"forward_dynamics": (place, still, tau), "conditioning": (place,)}
    if coordinates == "platform":
        shapes |= {"inverse_kinematics": (1,), "motor_jacobian": (1, 6), "forward_kinematics": (7,)}
        given |= dict.fromkeys(("inverse_kinematics", "motor_jacobian"), (place,))
        given["forward_kinematics"] = (chain.q_home[chain.motor_q_index], pose)
    assert set(VERBS) & set(kernels.names) <= set(shapes)
    for verb, shape in shapes.items():
        inputs = given.get(verb, (place, still, still))
        for many in (None, 1, 3):
            rows = inputs if many is None else [np.tile(x, (many, 1)) for x in inputs]
            status = np.empty(many or 1, dtype=np.int8)
            found = np.asarray(getattr(kernels, verb)(*rows, status=status))
            assert found.shape == (shape if many is None else (many, *shape)), (verb, many)
            assert np.isfinite(found).all() and not status.any(), (verb, many)
        one = kernels.single_state(verb)(*inputs)
        assert np.shape(one) in (shape, (1,) if verb == "conditioning" else shape), verb
