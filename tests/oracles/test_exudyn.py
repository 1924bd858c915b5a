"""Law 9: Exudyn, on rigid bodies with Euler parameters and joints as constraints, moves the platform the same way.

Nothing is shared but masses, points and the initial state: no tree, no loop Jacobian, no minimal coordinates.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.mechanics.kinematics import State

pytest.importorskip("exudyn", reason="needs Exudyn: pip install 'stewart_pin[oracles]'")

import exudyn
from exudyn import itemInterface as item
from exudyn.rigidBodyUtilities import RigidBodyInertia

DURATION = 0.05
LOWER = {"universal": [1, 1, 1, 0, 0, 1], "spherical": [1, 1, 1, 0, 0, 0]}
"""Constrained axes of the lower joint: the point, and for a universal joint first axis at right angles to second."""


def exudyn_position(
    chain: stp.ClosedChain, start: State, tau: np.ndarray, steps: int, lower_joint: str
) -> np.ndarray:
    """Simulate with Exudyn's index-2 trapezoidal rule; return the platform position at the end [m]."""
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(item.ObjectGround())
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, start.q, start.v)
    pin.updateFramePlacements(chain.model, data)

    def body(name: str) -> int:
        inertia = chain.mechanism.link(name).inertia
        frame = chain.model.getFrameId(name)
        velocity = pin.getFrameVelocity(chain.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        lever = pin.skew(inertia.lever)
        about_origin = inertia.inertia - inertia.mass * lever @ lever
        return system.CreateRigidBody(
            inertia=RigidBodyInertia(mass=inertia.mass, inertiaTensor=about_origin, com=inertia.lever),
            nodeType=exudyn.NodeType.RotationEulerParameters,
            referencePosition=data.oMf[frame].translation,
            referenceRotationMatrix=data.oMf[frame].rotation,
            initialVelocity=velocity.linear,
            initialAngularVelocity=velocity.angular,
            gravity=list(chain.gravity),
        )

    def marker(number: int, point: np.ndarray) -> int:
        return system.AddMarker(item.MarkerBodyRigid(bodyNumber=number, localPosition=list(point)))

    platform = body(chain.platform)
    for leg, effort, foot, head in zip(chain.motors, tau, *chain.leg_points(), strict=True):
        lower, upper = (marker(body(f"{leg}_{part}"), np.zeros(3)) for part in ("lower", "upper"))
        base, top = marker(ground, foot), marker(platform, head)
        system.AddObject(item.GenericJoint(markerNumbers=[base, lower], constrainedAxes=LOWER[lower_joint]))
        system.AddObject(item.GenericJoint(markerNumbers=[lower, upper], constrainedAxes=[1, 1, 0, 1, 1, 1]))
        system.AddObject(item.SphericalJoint(markerNumbers=[top, upper]))
        # A spring's force is positive in tension, a motor's effort pushes.
        spring = item.SpringDamper(
            markerNumbers=[base, upper], referenceLength=1.0, stiffness=0.0, damping=0.0, force=-effort
        )
        system.AddObject(spring)
    sensor = system.AddSensor(
        item.SensorBody(
            bodyNumber=platform,
            outputVariableType=exudyn.OutputVariableType.Position,
            storeInternal=True,
            writeToFile=False,
        )
    )
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = DURATION
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.timeIntegration.newton.absoluteTolerance = 1e-12
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    return np.array(system.GetSensorValues(sensor))


def our_position(chain: stp.ClosedChain, start: State, tau: np.ndarray, steps: int) -> np.ndarray:
    """Integrate `forward_dynamics` by the explicit midpoint rule, loops closed at every stage; return the same."""
    h = DURATION / steps

    def closed(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q = stp.close_loops(chain, q).q
        jacobian = stp.loop_jacobian(chain, q)
        return q, v - np.linalg.lstsq(jacobian, jacobian @ v, rcond=1e-10)[0]

    q, v = start.q, start.v
    for _ in range(steps):
        a = stp.forward_dynamics(chain, q, v, tau).a
        q_mid, v_mid = closed(pin.integrate(chain.model, q, h / 2 * v), v + h / 2 * a)
        a = stp.forward_dynamics(chain, q_mid, v_mid, tau).a
        q, v = closed(pin.integrate(chain.model, q, h * v_mid), v + h * a)
    return stp.platform_pose(chain, q).translation


def extrapolated(coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Richardson's extrapolation of a second-order rule from steps h and h/2."""
    return fine + (fine - coarse) / 3


@pytest.mark.parametrize(
    ("robot", "lower_joint"),
    [("stewart", "universal"), ("stewart_cad", "universal"), ("stewart_sps", "spherical")],
)
def test_platform_moves_the_same(robot: str, lower_joint: str, rng: np.random.Generator) -> None:
    chain = stp.load(robot)
    # Small enough for every stroke, and no symmetry left.
    pose = stp.platform_pose(chain, chain.q_home) * pin.exp6(rng.uniform(-0.05, 0.05, 6))
    start = stp.platform_motion(chain, pose, rng.uniform(-0.3, 0.3, 6), np.zeros(6))
    # A tenth more or less than what holds: the platform accelerates.
    tau = stp.inverse_dynamics(chain, start.q, start.v, start.a).tau_motor * rng.uniform(0.9, 1.1, 6)
    ours = extrapolated(*(our_position(chain, start, tau, steps) for steps in (15, 30)))
    theirs = extrapolated(*(exudyn_position(chain, start, tau, steps, lower_joint) for steps in (30, 60)))
    moved = np.abs(ours - pose.translation).max()
    assert moved > 1e-3
    # What both rules leave after extrapolation, h³ or h⁴ times the jerk: near 1e-8 of the way at these steps.
    assert np.abs(ours - theirs).max() < 1e-7 * moved
