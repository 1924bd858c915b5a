"""Law 5: compiled kernels give the forces and accelerations of the one-state verbs."""

from __future__ import annotations

from functools import cache

import numpy as np

import stewart_pin as stp
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, random_motion
from tests.laws.conftest import Case, round_off_of_accelerations, round_off_of_efforts

AGREEMENT = 1e-10  # relative, at generic poses


@cache
def kernels(chain: stp.ClosedChain) -> stp.compiled.Kernels:
    # The interpreter runs the programs that are compiled elsewhere, and starts at once.
    return stp.compile_kernels(chain, coordinates="tree", engine="numpy")


def test_kernels_equal_pinocchio(held: Case, rng: np.random.Generator) -> None:
    chain, many = held.chain, kernels(held.chain)
    motions = [(held.v, held.a), *(random_motion(chain, rng, held.q) for _ in range(2))]
    v, a = (np.array(x) for x in zip(*motions, strict=True))
    q, status = np.tile(held.q, (3, 1)), np.empty(3, dtype=np.int8)
    tau_motor = many.inverse_dynamics(q, v, a, status=status)
    assert (status == StateStatus.OK).all()
    lambda_c, moved = many.reactions(q, v, a), many.forward_dynamics(q, v, tau_motor)
    for k in range(3):
        effort = stp.inverse_dynamics(chain, held.q, v[k], a[k])
        tolerance = round_off_of_efforts(held, AGREEMENT, effort)
        close(tau_motor[k], effort.tau_motor, tolerance)
        close(
            moved[k] / chain.tangent_scale,
            effort.a / chain.tangent_scale,
            round_off_of_accelerations(held, AGREEMENT, effort),
        )
        if chain.nc:
            # Where reactions are not unique, the least of them sees the round-off of the null space as well.
            close(lambda_c[k], effort.lambda_c, tolerance if effort.reactions_unique else 10 * tolerance)
