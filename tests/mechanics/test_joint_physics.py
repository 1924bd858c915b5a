"""What joints do by themselves: by hand through the motions of the loops, and forward against inverse dynamics."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MechanismError, UnsupportedError
from tests.closed_states import random_configuration, random_motion, robot

AGREE = 1e-9
"""Relative; sums of a dozen terms through a regular loop Jacobian leave 1e-13, and five_bar nears a singularity."""

FIVE_BAR = {
    "left_hip": {"damping": 0.3, "stiffness": (4.0, 0.5, 2.0), "rest": 0.2, "force": 1.5, "armature": 0.01},
    "left_knee": {"damping": 0.2, "friction": 0.4, "stiffness": 3.0},
    "tip_pin": {"damping": 0.15, "friction": 0.3, "stiffness": (2.0, 0.0, 1.0), "rest": 0.4, "force": -0.7},
}
STEWART = {
    "leg1": {"damping": 30.0, "friction": 12.0, "stiffness": 900.0, "rest": 0.9, "armature": 3.0},
    "leg2_x": {"damping": 2.0, "stiffness": 5.0, "friction": 0.5},
    "leg3_ball": {"damping": 1.5, "stiffness": 4.0},
}


@cache
def effective(name: str) -> stp.ClosedChain:
    return stp.with_joint_physics(robot(name), {"five_bar": FIVE_BAR, "stewart": STEWART}[name])


def by_hand(name: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Power that the joints give, as a covector on tangent rates, by differences of their positions along each."""
    chain, total = effective(name), np.zeros(effective(name).nv)
    for joint, own in {"five_bar": FIVE_BAR, "stewart": STEWART}[name].items():
        x, rows = _position(chain, joint, q)
        rate = rows @ v
        powers = np.atleast_1d(own.get("stiffness", 0.0))
        apart = x - own.get("rest", 0.0)
        pull = own.get("force", 0.0) - sum(k * apart ** (n + 1) for n, k in enumerate(powers))
        effort = pull - own.get("damping", 0.0) * rate - own.get("friction", 0.0) * np.sign(rate)
        total += np.atleast_1d(effort) @ np.atleast_2d(rows)
    return total


def _position(chain: stp.ClosedChain, joint: str, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position of a joint, and its rates: of a loop from the frames of its links alone."""
    model = chain.model
    if model.existJointName(joint):
        entry = model.joints[model.getJointId(joint)]
        return q[entry.idx_q], np.eye(chain.nv)[entry.idx_v]
    loop = next(loop for loop in chain.loops if loop.name == joint)
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, q)
    ends, jacobians = [], []
    for link, placement in ((loop.link1, loop.placement1), (loop.link2, loop.placement2)):
        frame = model.getFrameId(link, pin.FrameType.BODY)
        ends.append(pin.updateFramePlacement(model, data, frame) * placement)
        jacobians.append(pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.WORLD)[3:])
    apart = pin.log3(ends[0].rotation.T @ ends[1].rotation)
    turning = ends[0].rotation.T @ (jacobians[1] - jacobians[0])
    if loop.kind == "spherical":
        return apart, turning
    return float(loop.axis @ apart), loop.axis @ turning


@pytest.mark.parametrize("name", ["five_bar", "stewart"])
def test_efforts_are_those_of_springs_dampers_and_friction_by_hand(
    name: str, rng: np.random.Generator
) -> None:
    chain, bare = effective(name), robot(name)
    for _ in range(3):
        q = random_configuration(chain, rng)
        v, a = random_motion(chain, rng, q)
        with_them, without = (stp.inverse_dynamics(each, q, v, a).tau_motor for each in (chain, bare))
        G = stp.dynamics.motion_map(bare, q).G
        rotors = G.T @ (np.array(chain.model.armature) * a)
        expected = without + rotors - G.T @ by_hand(name, q, v)
        assert with_them == pytest.approx(expected, rel=AGREE, abs=AGREE * np.abs(expected).max())


@pytest.mark.parametrize("name", ["five_bar", "stewart"])
def test_forward_dynamics_undoes_inverse_dynamics(name: str, rng: np.random.Generator) -> None:
    chain = effective(name)
    for moving in (1.0, 0.0):
        q = random_configuration(chain, rng)
        v, _ = random_motion(chain, rng, q)
        v = moving * v
        state = chain.at(q, v)
        along = state.motions.basis @ rng.normal(size=chain.generic.count.dof)
        a = chain.tangent_scale * (along - state.motions.across(state.loop_bias / chain.row_sizes))
        effort = stp.inverse_dynamics(chain, q, v, a)
        assert effort.band is None
        back = stp.forward_dynamics(chain, q, v, effort.tau_motor).a
        assert back == pytest.approx(a, rel=1e-7, abs=1e-7 * np.abs(a).max())


@pytest.mark.parametrize("name", ["five_bar", "stewart"])
def test_friction_holds_what_is_at_rest_within_its_band(name: str, rng: np.random.Generator) -> None:
    chain = effective(name)
    q = random_configuration(chain, rng)
    effort = stp.inverse_dynamics(chain, q, chain.rest, chain.rest)
    assert effort.band is not None
    least, most = effort.band.T
    assert (most > least).any() and (least + most) / 2 == pytest.approx(effort.tau_motor)
    rows = stp.dynamics.motion_map(chain, q).G.T
    friction = {"five_bar": FIVE_BAR, "stewart": STEWART}[name]
    half = sum(
        own["friction"] * np.abs(rows @ np.ravel(_position(chain, joint, q)[1]))
        for joint, own in friction.items()
        if "friction" in own
    )
    assert (most - least) / 2 == pytest.approx(half, rel=AGREE)
    for share in (-0.99, 0.3, 0.99):  # one motor at a time stays within what friction can hold alone
        tau = effort.tau_motor.copy()
        tau[0] += share * {"five_bar": 0.0, "stewart": 12.0}[name]
        assert np.abs(stp.forward_dynamics(chain, q, chain.rest, tau).a).max() < 1e-9
    tau = most + 1.0
    assert np.abs(stp.forward_dynamics(chain, q, chain.rest, tau).a).max() > 1e-3


def test_the_slopes_are_those_of_the_efforts(rng: np.random.Generator) -> None:
    for name in ("five_bar", "stewart"):
        chain = effective(name)
        q = random_configuration(chain, rng)
        v, _ = random_motion(chain, rng, q)
        by_q, by_v = chain.at(q, v).effects.slopes()
        step = 1e-6 * chain.tangent_scale
        for k, each in enumerate(np.diag(step)):
            after, before = (pin.integrate(chain.model, q, sign * each) for sign in (1, -1))
            change = (chain.at(after, v).effects.efforts() - chain.at(before, v).effects.efforts()) / (
                2 * step[k]
            )
            assert by_q[:, k] == pytest.approx(change, abs=2e-7 * np.abs(by_q).max())
            faster = chain.at(q, v + each).effects.efforts() - chain.at(q, v - each).effects.efforts()
            assert by_v[:, k] == pytest.approx(faster / (2 * step[k]), abs=1e-7 * np.abs(by_v).max())


@pytest.mark.parametrize(
    ("joint", "own", "error", "says"),
    [
        ("left_hipp", {"damping": 1}, InputError, "left_hipp.*no joint that moves"),
        ("left_hip", {"damp": 1}, InputError, "the quantities are armature, damping"),
        ("left_hip", {"damping": "much"}, InputError, "must be a number"),
        ("left_hip", {"damping": -1}, MechanismError, "damping is -1"),
        ("left_hip", {"friction": np.nan}, MechanismError, "friction is nan"),
        ("tip_pin", {"armature": 1}, MechanismError, "closes a loop and has a rotor"),
        ("tool", {"damping": 1}, InputError, "no joint that moves"),
    ],
)
def test_what_makes_no_sense_is_refused(joint: str, own: dict[str, object], error: type, says: str) -> None:
    with pytest.raises(error, match=says):
        stp.with_joint_physics(robot("five_bar"), {joint: own})


def test_fields_of_the_model_count_and_are_carried_on() -> None:
    chain = stp.load("five_bar")
    chain.model.damping = np.array([0.0, 2.0, 0.0, 0.0])
    chain.model.friction = np.array([0.5, 0.0, 0.0, 0.0])
    v = stp.dynamics.motion_map(chain, chain.q_home).G @ [1.0, -0.5]
    assert chain.at(chain.q_home, v).effects.efforts() == pytest.approx([-0.5, -2.0 * v[1], 0.0, 0.0])
    said = stp.with_joint_physics(chain, {"right_hip": {"force": 2.0}})
    assert said.mechanism.joint("left_knee").physics.damping == 2.0
    assert (
        stp.attach_payload(said, pin.Inertia(1.0, np.zeros(3), np.eye(3)), link="left_distal").model.damping[
            1
        ]
        == 2.0
    )
    with pytest.raises(UnsupportedError, match="make both sides alike"):
        chain.model.lowerDryFrictionLimit = np.array([-0.1, 0.0, 0.0, 0.0])
        stp.inverse_dynamics(chain, chain.q_home, chain.rest, chain.rest)


def test_what_joints_give_is_the_slope_of_their_energy_and_heat(rng: np.random.Generator) -> None:
    for name in ("five_bar", "stewart"):
        chain = effective(name)
        q = random_configuration(chain, rng)
        v, _ = random_motion(chain, rng, q)
        found = stp.dynamics.joint_efforts(chain, q, v)
        by_hand_ = by_hand(name, q, v)
        assert found.elastic + found.viscous + found.dry == pytest.approx(
            by_hand_, abs=1e-9 * np.abs(by_hand_).max()
        )
        step = 1e-6
        after, before = (
            stp.dynamics.joint_efforts(chain, pin.integrate(chain.model, q, h * v)) for h in (step, -step)
        )
        power = (after.energy - before.energy) / (2 * step)
        assert power == pytest.approx(-found.elastic @ v, abs=1e-7 * max(1.0, abs(found.energy)))
        assert found.dissipation == pytest.approx(-(found.viscous + found.dry) @ v) and found.dissipation > 0


def test_a_chain_tells_what_its_joints_do() -> None:
    said = str(effective("five_bar"))
    assert "by themselves: tip_pin: damping 0.15, friction 0.3, stiffness 2 0 1, rest 0.4, force -0.7" in said


def test_balls_do_not_stand_for_a_hinge_with_physics() -> None:
    with pytest.raises(UnsupportedError, match=r"joint 'tip_pin' closes a loop and has damping 0\.15"):
        stp.build.loops_by_balls(effective("five_bar"))
    assert stp.build.loops_by_balls(effective("stewart")).mechanism.loops[2].physics[0].stiffness == (4.0,)


def test_what_is_not_named_stays_where_entries_of_a_joint_differ(rng: np.random.Generator) -> None:
    chain = stp.load("stewart")
    free = chain.model.joints[chain.model.getJointId("platform_pose")]
    own = slice(free.idx_v, free.idx_v + free.nv)
    fields = {"armature": rng.random(chain.nv), "damping": rng.random(chain.nv)}
    chain.model.armature, chain.model.damping = fields["armature"], fields["damping"]
    changed = stp.with_joint_physics(chain, {"leg1": {"force": 5.0}})
    for field, values in fields.items():
        np.testing.assert_array_equal(getattr(changed.model, field), values)
    changed = stp.with_joint_physics(chain, {"platform_pose": {"damping": 2.0}})
    np.testing.assert_array_equal(changed.model.damping[own], 2.0)
    np.testing.assert_array_equal(changed.model.armature, fields["armature"])
    assert not stp.with_joint_physics(chain, {"platform_pose": None}).model.armature[own].any()
