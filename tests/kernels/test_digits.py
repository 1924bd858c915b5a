"""The conditioning that kernels tell is that of the digits they have lost, seen by 50 digits."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

from stewart_pin.programs.status import StateStatus
from tests.kernels.digits import efforts
from tests.kernels.everywhere import Coordinates, Mechanism

EPS = float(np.finfo(float).eps)
LOST = 1e4
"""Units of round-off that a conditioning of one stands for: a program of a few thousand operations, whose terms are a
few times as large as the efforts that they add up to."""
SPENT = 1e-2
"""Of these, what is lost indeed at the worst of some states near singularities."""
DECADES = np.logspace(-6, 0, 7)
CASES: list[tuple[str, Coordinates]] = [("four_bar", "platform"), ("kite", "motor")]
SLOW: list[tuple[str, Coordinates]] = [
    ("lever_on_a_cylinder", "platform"),
    ("kite", "tree"),
    ("elliptic_trammel", "motor"),
    ("spherical_4r", "motor"),
    ("stewart", "platform"),
    ("stewart", "motor"),
]


@pytest.mark.parametrize(
    ("name", "coordinates"), [*CASES, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)]
)
def test_conditioning_tells_the_digits_lost(
    name: str, coordinates: Coordinates, rng: np.random.Generator
) -> None:
    mechanism = Mechanism(name)
    chain, kernels = mechanism.chain, mechanism.kernels(coordinates)
    assert kernels is not None
    # A platform of few freedoms cannot follow a twist to the last bit: at rest there is nothing to follow.
    moving = coordinates != "platform" or chain.generic.count.platform == 6
    states = mechanism.draw(10_000, rng, moving=moving)
    given = states.given(chain, coordinates)
    status, conditioning = np.empty(len(states), dtype=np.int8), np.empty(len(states))
    tau = kernels.inverse_dynamics(*given, status=status, conditioning=conditioning)
    good = status == StateStatus.OK
    chosen = [
        k
        for low, high in itertools.pairwise(DECADES)
        for k in np.flatnonzero(good & (conditioning >= low) & (conditioning < high))[:6]
    ]
    weight = 9.81 * pin.computeTotalMass(chain.model) * chain.length_scale
    push = weight / chain.tangent_scale[chain.motor_index]
    spent = []
    for k in chosen:
        right = efforts(kernels, [x[k] for x in given])
        size = max(1.0, float(np.abs(right / push).max()))
        spent.append(float(np.abs((tau[k] - right) / push).max()) / size * conditioning[k] / EPS)
    assert len(chosen) >= 12 and conditioning[chosen].min() < 1e-2
    assert max(spent) <= LOST, spent
    near = [one for one, c in zip(spent, conditioning[chosen], strict=True) if c < 0.1]
    assert max(near) >= SPENT, spent
