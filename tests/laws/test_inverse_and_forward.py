"""Law 4: inverse and forward dynamics undo each other."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from tests.closed_states import close
from tests.laws.conftest import Case, round_off, round_off_of_accelerations


def test_forward_undoes_inverse(held: Case) -> None:
    chain = held.chain
    effort = stp.inverse_dynamics(chain, held.q, held.v, held.a)
    motion = stp.forward_dynamics(chain, held.q, held.v, effort.tau_motor)
    close(
        motion.a / chain.tangent_scale,
        effort.a / chain.tangent_scale,
        round_off_of_accelerations(held, 1e-10, effort),
    )
    if effort.reactions_unique and chain.nc:
        close(motion.lambda_c, effort.lambda_c, round_off(held, 1e-10))


def test_pinocchio_forward_undoes_inverse(held: Case) -> None:
    chain = held.chain
    effort = stp.inverse_dynamics(chain, held.q, held.v, held.a)
    try:
        motion = stp.forward_dynamics(chain, held.q, held.v, effort.tau_motor, method="constraint_dynamics")
    except UnsupportedError:
        kinds = {str(loop.kind) for loop in chain.loops}
        assert kinds - {"spherical", "fixed"} or chain.couplings or not effort.reactions_unique
        return
    close(
        motion.a / chain.tangent_scale,
        effort.a / chain.tangent_scale,
        round_off_of_accelerations(held, 1e-10, effort),
    )
    if chain.nc:
        close(motion.lambda_c, effort.lambda_c, round_off(held, 1e-10))


def test_inverse_undoes_forward(held: Case, rng: np.random.Generator) -> None:
    chain = held.chain
    rest = np.zeros(chain.nv)
    weight = stp.inverse_dynamics(chain, held.q, rest, rest).tau_motor
    tau_motor = (1.0 + np.abs(weight).max(initial=0.0)) * rng.normal(size=chain.nu)
    motion = stp.forward_dynamics(chain, held.q, held.v, tau_motor)
    effort = stp.inverse_dynamics(chain, held.q, held.v, motion.a)
    # What redundant motors do against each other moves nothing: the motion tells the least-norm efforts only.
    if effort.unique:
        close(effort.tau_motor, tau_motor, round_off(held, 1e-10))
    again = stp.forward_dynamics(chain, held.q, held.v, effort.tau_motor)
    close(
        again.a / chain.tangent_scale,
        motion.a / chain.tangent_scale,
        round_off_of_accelerations(held, 1e-10, effort),
    )
