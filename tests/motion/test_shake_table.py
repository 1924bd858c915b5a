"""The demand of a motion, and its largest share within the file's limits."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ClosureError
from stewart_pin.mechanics.closed_forms import leg_form
from stewart_pin.motion.motor_demand import _state_by_state
from stewart_pin.motion.shake_table import _Fit
from tests.closed_states import close, robot

TIME = np.linspace(0.0, 1.0, 201)


def shaking(chain: stp.ClosedChain, amplitude: float, frequency: float):
    home = stp.platform_pose(chain, chain.q_home)
    return lambda scale: stp.motions.sinusoidal_motion(
        TIME, home=home, amplitude=[0.0, 0.0, scale * amplitude], frequency=np.full(3, frequency)
    )


def test_closed_form_demand_is_that_of_the_one_state_verbs() -> None:
    chain = robot("stewart")
    samples = stp.motions.sinusoidal_motion(TIME[:20], home=stp.platform_pose(chain, chain.q_home))
    fast, slow = stp.motor_demand(chain, samples), _state_by_state(chain, samples)
    np.testing.assert_allclose(fast.positions, slow.positions, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.rates, slow.rates, rtol=0, atol=1e-11)
    np.testing.assert_allclose(fast.efforts, slow.efforts, rtol=0, atol=1e-9 * np.abs(slow.efforts).max())


@pytest.mark.parametrize(
    ("amplitude", "frequency", "limit"), [(-0.6, 0.25, "stroke"), (0.5, 1.5, "rate"), (0.05, 40.0, "effort")]
)
def test_the_limit_that_binds_is_met_exactly_and_named(
    amplitude: float, frequency: float, limit: str
) -> None:
    chain = robot("stewart")
    if limit == "effort":
        chain = stp.with_limits(chain, {motor: {"velocity": 1e3} for motor in chain.motors})
    report = stp.fit_to_limits(chain, shaking(chain, amplitude, frequency), margin=0.1)
    assert 0 < report.scale < 1
    assert report.binding is not None
    assert report.binding.limit == limit
    assert report.binding.motor in chain.motors
    # Bisection to 1e-6, from below.
    assert 1 - 1e-5 < report.binding.use <= 1
    demand = {"stroke": report.demand.positions, "rate": report.demand.rates, "effort": report.demand.efforts}
    reached = {"stroke": demand["stroke"].max(), "rate": np.abs(demand["rate"]).max()}
    reached["effort"] = np.abs(demand["effort"]).max()
    joint = chain.motor_q_index[0]
    middle = (chain.model.upperPositionLimit[joint] + chain.model.lowerPositionLimit[joint]) / 2
    half = (chain.model.upperPositionLimit[joint] - chain.model.lowerPositionLimit[joint]) / 2
    allowed = {"stroke": middle + 0.9 * half, "rate": 0.9 * 2.0, "effort": 0.9 * 1e4}
    if limit == "stroke" and report.binding.value < middle:
        reached["stroke"], allowed["stroke"] = -demand["stroke"].min(), -(middle - 0.9 * half)
    assert reached[limit] == pytest.approx(allowed[limit], rel=1e-5)


def test_a_motion_within_the_limits_is_left_alone() -> None:
    chain = robot("stewart")
    report = stp.fit_to_limits(chain, shaking(chain, 0.02, 1.0))
    assert report.scale == 1.0
    assert all(binding.use < 1 for binding in report.unscaled)


def test_what_cannot_be_scaled_is_refused() -> None:
    chain = robot("stewart")
    with pytest.raises(stp.errors.InputError, match="margin"):
        stp.fit_to_limits(chain, shaking(chain, 0.02, 1.0), margin=1.0)
    # Home is not in the middle of the stroke.
    with pytest.raises(stp.errors.InputError, match="scale 0"):
        stp.fit_to_limits(chain, shaking(chain, 0.9, 1.0), margin=0.9999)


@pytest.mark.parametrize("name", ["hexapod_rss", "stewart_sps"])
def test_kernels_change_nothing(name: str) -> None:
    """The demand of a motion, state by state and by compiled kernels."""
    chain = stp.load(name)
    home = stp.platform_pose(chain, chain.q_home)
    size = 0.05 * chain.length_scale
    motion = stp.motions.sinusoidal_motion(
        stp.motions.sample_times(1.0, 20.0), amplitude=(size, size, size), home=home
    )
    by_state = stp.motor_demand(chain, motion, kernels=False)
    by_kernel = stp.motor_demand(chain, motion, kernels=True)
    for field in ("positions", "rates", "efforts"):
        close(getattr(by_kernel, field), getattr(by_state, field), 1e-10)


def test_kernels_leave_errors_to_the_careful_verbs() -> None:
    chain = stp.load("hexapod_rss")
    far = stp.motions.sinusoidal_motion([0.0, 0.1], home=pin.SE3(np.eye(3), np.array([5.0, 0.0, 1.0])))
    with pytest.raises(ClosureError):
        stp.motor_demand(chain, far, kernels=True)


def test_a_limit_that_one_motor_lacks_leaves_the_others_in_force() -> None:
    chain = robot("stewart")
    chain = stp.with_limits(chain, {motor: {"velocity": 1e3} for motor in chain.motors})
    shake = shaking(chain, 0.05, 40.0)
    full = stp.fit_to_limits(chain, shake)
    assert full.binding is not None and full.binding.limit == "effort" and full.scale < 1
    idle = int(np.argmin(np.abs(full.demand.efforts).max(axis=0)))  # one that does not bind
    chain = stp.with_limits(chain, {chain.motors[idle]: {"effort": None}})
    assert stp.fit_to_limits(chain, shake).scale == pytest.approx(full.scale, rel=1e-5)
    # A stroke with one end: the other motors keep both, this one its upper end.
    reach = shaking(chain, 0.6, 0.25)
    both = stp.fit_to_limits(chain, reach)
    upper = chain.limits.position[chain.motor_index[idle], 1]
    chain = stp.with_limits(chain, {chain.motors[idle]: {"position": (None, upper)}})
    assert stp.fit_to_limits(chain, reach).scale == pytest.approx(both.scale, rel=1e-5)


def test_a_limit_of_zero_is_none(tmp_path) -> None:
    """What exporters write for what they were not told."""
    chain = stp.load("stewart")
    stp.write_urdf(chain, tmp_path / "zero.urdf")
    text = (tmp_path / "zero.urdf").read_text()
    told = re.sub(r'(effort|velocity)="[0-9.e+]+"', r'\1="0"', text)
    assert told != text
    (tmp_path / "zero.urdf").write_text(told)
    zero = stp.load(tmp_path / "zero.urdf")
    assert np.isinf(zero.model.effortLimit[zero.motor_index]).all()
    assert np.isinf(zero.model.velocityLimit[zero.motor_index]).all()
    assert "0: taken for not stated" in str(zero.report)
    rest, q = np.zeros(zero.nv), zero.q_home
    run = stp.simulate(zero, q, rest, stp.control.GravityCompensation(zero), duration=0.05)
    np.testing.assert_allclose(run.q[-1], q, atol=1e-9)


def test_closed_forms_are_taken_only_where_they_agree() -> None:
    """Legs that are not round, on balls, have none: they are answered state by state."""
    chain = stp.load("stewart")
    assert leg_form(chain, "leg_efforts") is not None
    lopsided = stp.build.replace_inertias(
        stp.load("stewart_sps"),
        {"leg1_upper": pin.Inertia(2.0, np.array([0.02, 0.0, -0.2]), np.diag([0.1, 0.1, 0.01]))},
    )
    assert leg_form(lopsided, "leg_efforts") is None
    still = shaking(lopsided, 0.0, 1.0)(1.0)
    few = stp.motions.PlatformSamples(*(getattr(still, name)[:2] for name in vars(still)))
    found = stp.motor_demand(lopsided, few, kernels=False)
    at = stp.platform_motion(lopsided, few.pose(0), np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(found.efforts[0], stp.inverse_dynamics(at).tau_motor, rtol=1e-8)


@pytest.mark.parametrize("instants", [None, [0, 8, 25, 38]])
@pytest.mark.parametrize("kind", ["position", "velocity"])
def test_what_joints_cannot_follow_is_said_with_its_instant(instants: list[int] | None, kind: str) -> None:
    chain = stp.load("delta")
    passive = next(n for n in chain.limits.names[: chain.nv] if n.startswith("rod") and n not in chain.motors)
    chain = stp.with_limits(chain, {passive: {kind: 100.0}})
    home = stp.platform_pose(chain, chain.q_home)
    there = pin.SE3(home.rotation, home.translation + [2 * chain.length_scale, 0.0, 0.0])
    samples = stp.motions.minimum_jerk_motion(TIME[::5], start=home, end=there, duration=1.0)
    first = next(
        k
        for k in instants or range(len(samples))
        if not stp.inverse_kinematics(chain, samples.pose(k), throw=False, limits=False).success
    )
    assert first > 0
    (binding,) = _Fit(chain, lambda _: samples, 0.0)._of_others(1.0, instants)
    assert (binding.limit, binding.motor, binding.time) == ("reach", chain.platform, samples.time[first])
