"""The rate of the loop Jacobian is its derivative, for every kind of loop and of joint."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.model.description import JointKind
from tests.closed_states import along, close, derivative, robot
from tests.mechanisms import four_bar, gear_train, rotary_hexapod, two_bodies


def geared() -> stp.ClosedChain:
    return gear_train(np.random.default_rng(1))


def check(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    q = pin.integrate(chain.model, chain.q_home, 0.1 * rng.normal(size=chain.nv) * chain.tangent_scale)
    v = rng.normal(size=chain.nv) * chain.tangent_scale
    curve = along(chain, q, v)
    # h⁴/30 times the fifth derivative at rates of a few per second, and round-off over h: both below 1e-11.
    slope = derivative(lambda t: stp.loop_jacobian(chain, curve(t)), 3e-4)
    close(stp.loops.loop_jacobian_rate(chain, q, v, np.eye(chain.nv)), slope, 1e-9)


@pytest.mark.parametrize("kind", [kind for kind in JointKind if kind is not JointKind.FLOATING])
def test_kinds_of_loops_between_a_ball_and_a_free_body(kind: JointKind, rng: np.random.Generator) -> None:
    check(two_bodies(kind, rng), rng)


@pytest.mark.parametrize("build", [four_bar, geared, rotary_hexapod, lambda: robot("stewart_cad")])
def test_mechanisms(build, rng: np.random.Generator) -> None:
    check(build(), rng)


def test_it_is_the_polar_form_of_the_bias(rng: np.random.Generator) -> None:
    """By the bias alone, which knows nothing of derivatives, up to what does not commute."""
    chain = rotary_hexapod()
    v, u = rng.normal(size=(2, chain.nv))
    q, bias = chain.q_home, lambda w: stp.loop_bias(chain, chain.q_home, w)
    polar = bias(v + u) - bias(v) - bias(u)
    there = stp.loops.loop_jacobian_rate(chain, q, v, u[:, None]) + stp.loops.loop_jacobian_rate(
        chain, q, u, v[:, None]
    )
    close(there[:, 0], polar, 1e-12)


def test_shapes() -> None:
    arm, bar = robot("arm_7r"), four_bar()
    assert stp.loops.loop_jacobian_rate(arm, arm.q_home, np.ones(7), np.eye(7)).shape == (0, 7)
    assert stp.loops.loop_jacobian_rate(bar, bar.q_home, np.ones(3), np.zeros((3, 0))).shape == (bar.nc, 0)
    with pytest.raises(InputError, match=r"motions must have shape \(3, n\)"):
        stp.loops.loop_jacobian_rate(bar, bar.q_home, np.ones(3), np.ones(3))
