"""Motors beside serial joints, as of a knee and an ankle: against closed forms, and by power."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import ActuationError, InputError
from stewart_pin.model.description import Joint, Link, Loop, Mechanism
from tests.closed_states import close, derivative, random_configuration, random_motion
from tests.mechanisms import ONE, P, R, S, X, Y, Z, at, five_bar, four_bar, rod, rotary_hexapod

FEET = np.array([[0.05, 0.04, 0.25], [0.05, -0.04, 0.25]])
"""Lower ends of the two linear motors on the shank."""
HEADS = np.array([[0.06, 0.04, 0.0], [0.06, -0.04, 0.0]])
"""Upper ends on the foot, beside an ankle at the origin of the shank."""


def ankle() -> stp.ClosedChain:
    """Build a thigh that swings on a motor, a shank below, and an ankle that two linear motors pitch and roll."""
    links = [Link("hip"), Link("shank", rod(0.4)), Link("cross"), Link("foot", rod(0.2))]
    joints = [
        Joint("knee", R, "hip", "shank", ONE, Y, independent=True),
        Joint("pitch", R, "shank", "cross", ONE, Y),
        Joint("roll", R, "cross", "foot", ONE, X),
    ]
    loops, home = [], {}
    for k, (foot, head) in enumerate(zip(FEET, HEADS, strict=True)):
        reach = head - foot
        links += [Link(f"yoke{k}"), Link(f"tube{k}", rod(0.1, 0.2)), Link(f"rod{k}", rod(0.1, 0.1))]
        joints += [
            Joint(f"swing{k}", R, "shank", f"yoke{k}", at(*foot), X),
            Joint(f"tilt{k}", R, f"yoke{k}", f"tube{k}", ONE, Y),
            Joint(f"motor{k}", P, f"tube{k}", f"rod{k}", ONE, Z, independent=True),
        ]
        loops.append(Loop(f"ball{k}", S, f"rod{k}", "foot", ONE, at(*head)))
        # From above, the tube points down: tilted by half a turn and a little.
        home |= {f"tilt{k}": [np.arctan2(reach[0], reach[2])], f"motor{k}": [np.linalg.norm(reach)]}
    parts = tuple(links), tuple(joints), tuple(loops)
    return build_chain(
        Mechanism("ankle", *parts, platform="foot", home={k: np.array(v) for k, v in home.items()})
    )


def ankle_lengths(pitch: float, roll: float) -> np.ndarray:
    """Lengths of the linear motors as functions of the ankle's two angles, by nothing but trigonometry."""
    turn = np.array(
        [
            [np.cos(pitch), np.sin(pitch) * np.sin(roll), np.sin(pitch) * np.cos(roll)],
            [0.0, np.cos(roll), -np.sin(roll)],
            [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)],
        ]
    )
    return np.linalg.norm(HEADS @ turn.T - FEET, axis=1)


def entry(chain: stp.ClosedChain, name: str) -> int:
    return chain.tangent_names.index(name)


def test_ankle(rng: np.random.Generator) -> None:
    chain = ankle()
    q = random_configuration(chain, rng)
    angles = q[[entry(chain, "pitch"), entry(chain, "roll")]]
    lengths = stp.motor_positions(chain, q)[1:]
    assert np.abs(ankle_lengths(*angles) - lengths).max() < 1e-12
    # Rates of the lengths per rate of the angles, by differences of the trigonometry.
    steps = [derivative(lambda t, e=e: ankle_lengths(*(angles + t * e))) for e in np.eye(2)]
    found = stp.dynamics.joint_motor_map(chain, q, ["pitch", "roll"], motors=["motor0", "motor1"])
    close(found.inverse, np.stack(steps, axis=1), 1e-10)
    close(found.J @ found.inverse, np.eye(2), 1e-12)
    # With all motors the knee adds a column of zeros, and its motor cannot be told from the ankle.
    whole = stp.dynamics.joint_motor_map(chain, q, ["pitch", "roll"])
    close(whole.J, np.hstack([np.zeros((2, 1)), found.J]), 1e-12)
    assert whole.inverse is None and whole.unique


def test_ankle_holds_a_joint_torque(rng: np.random.Generator) -> None:
    """Jᵀ gives the very efforts that inverse dynamics finds where the joint itself had a motor."""
    chain = ankle()
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    beside = stp.inverse_dynamics(chain, q, v, a).tau_motor
    direct = build_chain(chain.described(), motors=["knee", "pitch", "roll"])
    inside = stp.inverse_dynamics(direct, q, v, a).tau_motor
    found = stp.dynamics.joint_motor_map(chain, q, ["knee", "pitch", "roll"])
    close(found.J.T @ inside, beside, 1e-10)
    close(found.inverse.T @ beside, inside, 1e-10)


@pytest.mark.parametrize("build", [ankle, four_bar, five_bar, rotary_hexapod])
def test_power_and_rates(build, rng: np.random.Generator) -> None:
    """For any subset of the joints that the motors move: rates, bias by differences, and no work lost."""
    chain = build()
    idle = [f"elbow{k}" for k in range(6)]  # rods that spin as they like
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    names = [n for n in chain.model.names[1:] if n not in chain.motors and n not in idle]
    for joints in (names, names[:1], list(chain.motors)[::-1]):
        found = stp.dynamics.joint_motor_map(chain, q, joints, v)
        index = [entry(chain, name) for name in found.joints]
        rate_motor, rate_joint = v[chain.motor_index], v[index]
        close(found.J @ rate_motor, rate_joint, 1e-9)
        close(found.J @ a[chain.motor_index] + found.bias, a[index], 1e-9)
        effort = rng.normal(size=len(index))
        assert (found.J.T @ effort) @ rate_motor == pytest.approx(effort @ rate_joint, rel=1e-9)


def test_redundant_motors_share(rng: np.random.Generator) -> None:
    chain = five_bar()
    q = random_configuration(chain, rng)
    v, _ = random_motion(chain, rng, q)
    found = stp.dynamics.joint_motor_map(chain, q, ["right_knee"])
    assert not found.unique
    close(found.J @ v[chain.motor_index], v[[entry(chain, "right_knee")]], 1e-10)


def test_joints_that_motors_do_not_hold_are_refused() -> None:
    chain = rotary_hexapod()
    with pytest.raises(ActuationError, match=r"elbow0 can move with the motors .* at rest: elbow0"):
        stp.dynamics.joint_motor_map(chain, chain.q_home, ["elbow0"])
    with pytest.raises(ActuationError, match="pitch, roll can move with the motors knee, motor0 at rest"):
        stp.dynamics.joint_motor_map(ankle(), ankle().q_home, ["pitch", "roll"], motors=["knee", "motor0"])


def test_unknown_names_are_refused() -> None:
    chain = four_bar()
    with pytest.raises(InputError, match=r"joints name the joint 'knee'.*crank_motor, elbow"):
        stp.dynamics.joint_motor_map(chain, chain.q_home, ["knee"])
    with pytest.raises(InputError, match="motors name the joint 'hip'"):
        stp.dynamics.joint_motor_map(chain, chain.q_home, ["elbow"], motors=["hip"])
    with pytest.raises(InputError, match="joints must be a list"):
        stp.dynamics.joint_motor_map(chain, chain.q_home, "elbow")
    with pytest.raises(InputError, match="joints must be a list"):
        stp.dynamics.joint_motor_map(chain, chain.q_home, [])
