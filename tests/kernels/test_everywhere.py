"""Kernels at many regular states of every kind of mechanism, in all coordinates, see `everywhere`."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from tests.kernels.everywhere import COORDINATES, Mechanism, examine
from tests.zoo.table import REFUSED

QUICK = ("planetary_gear", "lever_on_a_cylinder", "triple_rocker", "wedge", "rssr", "five_bar", "four_bar")
SLOW = (
    *("tricept", "tripod_3rps", "schoenflies_4puu", "exechon", "gough_6ups", "planar_3rrr"),
    *("spherical_4r", "spherical_5r", "agile_eye", "bennett", "goldberg_5r", "rccc"),
    *("watt_six_bar", "stephenson_six_bar", "slider_crank", "scissor_lift", "peaucellier", "kite"),
    *("bevel_differential", "rack_and_pinion", "screw_jack", "door_on_two_hinges"),
)
"""Balls, hinges, slides, screws and gears; redundant rows and overconstrained loops; one, two, three, four and six motors.
With those of `QUICK` 27 of the zoo; ``python -m tests.benchmarks.everywhere`` has all of it, with 1e5 states of each."""
NAMES = [
    *QUICK,
    *(pytest.param(name, marks=pytest.mark.slow) for name in (*stp.robots(), *SLOW) if name not in QUICK),
]
JUDGED = {True: 10, False: 40}
"""States of each kind that the verbs of one state judge, in quick and in slow tests."""


@pytest.mark.parametrize("name", NAMES)
def test_kernels_answer_everywhere(name: str, rng: np.random.Generator) -> None:
    quick = name in QUICK
    mechanism = Mechanism(name)
    idle = bool(mechanism.chain.generic.count.idle)
    states = mechanism.draw(1000 if quick else 4000, rng)
    # Motors and platform say nothing of how idle freedoms move: at rest nothing depends on them.
    still = mechanism.draw(1000 if quick else 4000, rng, moving=False) if idle else states
    assert len(states) > (600 if quick else 2400)
    for coordinates in COORDINATES:
        found = examine(mechanism, coordinates, states if coordinates == "tree" else still, rng, JUDGED[quick])
        if found is None:
            assert (coordinates, name) in REFUSED or (coordinates, name) == ("platform", "arm_7r")
            continue
        assert found.wrong == 0 and found.missing == 0, (coordinates, found)
        # Legs with elbows are the only ones that lead to states which the others find no way to.
        assert found.answered + found.other > 0.5 * found.states, (coordinates, found)
        # Accelerations go through the inverse of the inertia, and through the configuration twice.
        assert found.undone <= 1e-6, (coordinates, found)
