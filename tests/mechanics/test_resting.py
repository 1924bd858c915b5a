"""A leg that may spin, and hangs but for its printed digits, is at rest; one that leans is not."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import robot


def beside(offset: float) -> stp.ClosedChain:
    """Shift the centre of one rod to the side of its axis."""
    chain = robot("stewart_sps")
    body = chain.mechanism.link("leg1_upper").inertia
    assert body is not None
    moved = pin.Inertia(body.mass, body.lever + np.array([offset, 0.5 * offset, 0]), body.inertia)
    return stp.build.replace_inertias(chain, {"leg1_upper": moved})


def test_sixth_digit_of_a_rod_that_may_spin() -> None:
    plain, told = robot("stewart_sps"), beside(5e-7)
    one, two = (stp.natural_frequencies(c, c.q_home, motor_stiffness=1e6).frequency for c in (plain, told))
    np.testing.assert_allclose(two[-6:], one[-6:], rtol=1e-5)
    one, two = (stp.linearise(c, c.q_home) for c in (plain, told))
    assert one.names == two.names
    one, two = (
        stp.polytopes.wrench_polytope(c, c.q_home, effort_limit=500.0, gravity=True) for c in (plain, told)
    )
    assert stp.polytopes.inscribed_ball(two).radius == pytest.approx(
        stp.polytopes.inscribed_ball(one).radius, rel=1e-5
    )


def test_a_rod_that_leans_is_refused() -> None:
    leaning = beside(1e-3)
    with pytest.raises(stp.errors.InputError, match="no equilibrium"):
        stp.linearise(leaning, leaning.q_home)
    with pytest.raises(stp.errors.UnsupportedError, match="cannot rest here"):
        stp.polytopes.wrench_polytope(leaning, leaning.q_home, effort_limit=500.0, gravity=True)
