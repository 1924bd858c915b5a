"""What motions demand, control, simulation."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, Sized, asks, keeps_closed, told_motion


@asks("motor_demand")
def motor_demand(t: Telling, c: Case) -> Answers:
    return _demand(t, stp.motor_demand(t.chain, told_motion(t, c, 1.0), kernels=False))


@asks("motor_demand", "simulate")
def pushed_platform(t: Telling, c: Case) -> Answers:
    """Push the platform, whose frame stands where it stood, along the axes of the world."""
    push = c.effort * np.repeat([1.0, c.chain.length_scale], 3) * np.linspace(0.5, 1.0, 6)
    wrenches = {t.chain.platform: t.turned(push)}
    demand = stp.motor_demand(t.chain, told_motion(t, c, 1.0), wrenches=wrenches, kernels=False)
    q, v, _ = t.state(c.near, 0.1 * keeps_closed(c, c.near))
    moved = stp.simulate(t.chain, q, v, duration=2e-3, dt=1e-3, wrenches=wrenches, kernels=False)
    return _demand(t, demand) | {
        "moved motors": t.motors(moved.v[:, t.chain.motor_index]),
        "moved platform": t.twists(moved.platform.twist),
        "work": Sized(moved.outside[-1], c.effort * c.chain.length_scale),
    }


@asks("motor_demand", kind="compiled")
def demand_by_kernels(t: Telling, c: Case) -> Answers:
    return _demand(t, stp.motor_demand(t.chain, told_motion(t, c, 1.0), kernels=True))


def _demand(t: Telling, found: stp.motions.MotorDemand) -> Answers:
    return {
        "positions": t.positions(found.positions),
        "rates": t.motors(found.rates),
        "efforts": t.motors(found.efforts),
    }


@asks("compare_methods", kind="slow")
def compare_methods(t: Telling, c: Case) -> Answers:
    found = stp.compare_methods(t.chain, told_motion(t, c, 1.0), kernels=False)
    # Few digits bend the axes of legs by more than a closed form may differ.
    answers: Answers = {"methods": len(found.forces)} if t.exact else {}
    for title, table in (
        ("forces", found.forces),
        ("simplified", found.simplified),
        ("part", found.contributions),
    ):
        # A part may weigh nothing, as the turning of a point.
        answers |= {f"{title}: {name}": Sized(t.motors(tau), c.effort) for name, tau in table.items()}
    return answers


@asks("sweep_demand")
def sweep_demand(t: Telling, c: Case) -> Answers:
    found = stp.sweep_demand(
        t.chain, lambda scale: told_motion(t, c, scale), {"scale": [0.5, 1.0]}, kernels=False
    )
    return {
        name: t.unsigned(found[name])
        for name in ("peak_effort", "rms_effort", "travel", "peak_rate", "peak_power", "mean_power")
    }


@asks("fit_to_limits")
def fit_to_limits(t: Telling, c: Case) -> Answers:
    found = stp.fit_to_limits(t.chain, lambda scale: told_motion(t, c, 5 * scale), margin=0.1)
    answers: Answers = {"scale": found.scale, "efforts": t.motors(found.demand.efforts)}
    if found.binding is not None:
        # A tie between motors, or samples, is decided by round-off.
        answers |= {"use": found.binding.use, "limit": found.binding.limit}
    answers |= {f"unscaled {b.limit}": b.use for b in found.unscaled}
    return answers


@asks("with_limits", "limits_exceeded")
def limits(t: Telling, c: Case) -> Answers:
    """Motors may go at half the speed that they have, one side told by its sign; joints beside them are free."""
    q, v, _ = t.state(c.near, keeps_closed(c, c.near))
    rates = dict(zip(t.chain.motors, v[t.chain.motor_index], strict=True))
    bounds = {
        name: (0.0, abs(rate) / 2) if rate > 0 else (-abs(rate) / 2, 0.0) for name, rate in rates.items()
    }
    slow = stp.with_limits(t.chain, {name: {"velocity": span} for name, span in bounds.items()})
    beyond = {e.joint: e for e in stp.limits_exceeded(slow.at(q, v)) if e.kind == "velocity"}
    by = [beyond[name].by if name in beyond else 0.0 for name in t.chain.motors]
    end = [beyond[name].limit if name in beyond else 0.0 for name in t.chain.motors]
    return {"by": t.unsigned(np.array(by)), "end": t.motors(np.array(end))}


@asks("ComputedTorque")
def computed_torque(t: Telling, c: Case) -> Answers:
    reference = lambda times: told_motion(t, c, 1.0, times)  # noqa: E731
    q, v, _ = t.state(c.near, keeps_closed(c, c.near))
    if not t.same_size:
        return {}  # what is left of a correction that the platform cannot do
    return {"efforts": t.motors(stp.control.ComputedTorque(t.chain, reference)(0.1, q, v))}


@asks("Feedforward", "LegPID", "GravityCompensation", "SampledController")
def control(t: Telling, c: Case) -> Answers:
    reference = lambda times: told_motion(t, c, 1.0, times)  # noqa: E731
    q, v, _ = t.state(c.near, keeps_closed(c, c.near))
    pid = stp.control.LegPID(t.chain, reference, kp=1e3 * c.effort, kd=10 * c.effort)
    answers: Answers = {
        "feedforward": stp.control.Feedforward(t.chain, reference)(0.1, q, v),
        "pid": pid(0.1, q, v),
        "integral": stp.control.LegPID(t.chain, reference, ki=1e3 * c.effort).state_rate(
            0.1, q, v, np.zeros(t.chain.nu)
        ),
        "gravity": stp.control.GravityCompensation(t.chain)(0.1, q, v),
        "sampled": stp.control.SampledController(t.chain, pid)(0.1, q, v),
    }
    return {
        name: Sized(t.motors(tau), c.effort if name != "integral" else 0.0) for name, tau in answers.items()
    }


@asks("Feedforward", "ComputedTorque")
def control_by_a_point(t: Telling, c: Case) -> Answers:
    reference = lambda times: told_motion(t, c, 1.0, times)  # noqa: E731
    q, v, _ = t.state(c.near, keeps_closed(c, c.near))
    makers = (stp.control.Feedforward, stp.control.ComputedTorque)
    if not t.same_size:
        makers = makers[:1]  # what is left of a correction that the platform cannot do
    return {
        # Nothing at all where the platform's origin stands still.
        make.__name__: Sized(t.motors(make(t.chain, reference, model="point_mass")(0.1, q, v)), c.effort)
        for make in makers
    }


@asks("simulate", "resume", "Simulation", kind="slow")
def simulate(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.near, 0.1 * keeps_closed(c, c.near))
    hold = stp.control.GravityCompensation(t.chain)
    first = stp.simulate(t.chain, q, v, hold, duration=0.01, dt=2e-3, kernels=False)
    found = stp.simulation.resume(t.chain, first.final_state, hold, duration=0.01, kernels=False)
    return {
        "efforts": Sized(t.motors(found.tau_motor), c.effort),
        "positions": t.positions(found.q[:, t.chain.motor_q_index]),
        "rates": t.motors(found.v[:, t.chain.motor_index]),
        "platform": t.twists(found.platform.twist),
        "gained": Sized(found.energy[-1] - found.energy[0], c.effort * c.chain.length_scale),
    }
