"""One state at a time: the package's verbs beside bare Pinocchio code that gives the same numbers without any check.

``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m tests.benchmarks.states`` runs both interleaved, in one process,
and prints medians and ratios: from q, v, a as a user has them, and from a state that exists already.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

import stewart_pin as stp

ROUNDS = 25
CALLS = 40


class Bare:
    """What a user of Pinocchio writes for a robot whose loops are balls: no checks, scratch kept."""

    def __init__(self, chain: stp.ClosedChain) -> None:
        self.model, table = chain.model.copy(), chain.loop_table
        self.motors, self.motors_q, self.home = chain.motor_index, chain.motor_q_index, chain.q_home
        ends = []
        for k in range(len(chain.loops)):
            for side, joint, place in (
                (1, table.joint1[k], pin.SE3(table.rotation1[k], table.translation1[k])),
                (2, table.joint2[k], pin.SE3(table.rotation2[k], table.translation2[k])),
            ):
                frame = pin.Frame(f"end{side}_{k}", joint, 0, place, pin.FrameType.OP_FRAME)
                ends.append((self.model.addFrame(frame), joint, place))
        self.ends = list(zip(ends[::2], ends[1::2], strict=True))
        self.platform = chain.platform_id
        self.data = self.model.createData()
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for (_, joint1, place1), (_, joint2, place2) in self.ends:
            self.models.append(
                pin.RigidConstraintModel(
                    pin.ContactType.CONTACT_3D,
                    self.model,
                    joint1,
                    place1,
                    joint2,
                    place2,
                    pin.ReferenceFrame.LOCAL,
                )
            )
            self.datas.append(self.models[-1].createData())
        self.pairs = list(zip(self.models, self.datas, strict=True))
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)
        self.settings = pin.ProximalSettings(1e-14, 0.0, 1)
        self.rows = np.eye(self.model.nv)[self.motors]

    def loops(self, q: np.ndarray) -> np.ndarray:
        """Loop Jacobian, in the package's sign."""
        pin.computeJointJacobians(self.model, self.data, q)
        for model, data in self.pairs:
            model.calc(self.model, self.data, data)
        return -pin.getConstraintsJacobian(self.model, self.data, self.models, self.datas)

    def inverse_dynamics(self, q, v, a):
        """Motor efforts, then loop reactions."""
        needed = pin.rnea(self.model, self.data, q, v, a)
        found = np.linalg.solve(np.vstack([self.loops(q), self.rows]).T, needed)
        return found[-len(self.motors) :]

    def forward_dynamics(self, q, v, tau_motor):
        """Acceleration by Pinocchio's own constrained algorithm."""
        tau = np.zeros(self.model.nv)
        tau[self.motors] = tau_motor
        return pin.constraintDynamics(
            self.model, self.data, q, v, tau, self.models, self.datas, self.settings
        )

    def motor_jacobian(self, q):
        """Motor rates per twist."""
        jacobian = self.loops(q)
        pin.updateFramePlacement(self.model, self.data, self.platform)
        platform = pin.getFrameJacobian(
            self.model, self.data, self.platform, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        right = np.zeros((self.model.nv, 6))
        right[-6:] = np.eye(6)
        return np.linalg.solve(np.vstack([jacobian, platform]), right)[self.motors]

    def operational_dynamics(self, q, v):
        """Inertia, Coriolis matrix and weight in motor coordinates."""
        model, data = self.model, self.data
        local = pin.ReferenceFrame.LOCAL
        jacobian = self.loops(q)
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        pin.forwardKinematics(model, data, q, v)
        rates = []
        for (frame1, _, _), (frame2, _, _) in self.ends:
            oM1, oM2 = data.oMf[frame1], data.oMf[frame2]
            turn = oM1.rotation.T @ oM2.rotation
            spin1 = pin.getFrameVelocity(model, data, frame1, local).angular
            spin2 = pin.getFrameVelocity(model, data, frame2, local).angular
            one = pin.getFrameJacobian(model, data, frame1, local)
            two = pin.getFrameJacobian(model, data, frame2, local)
            rate1 = pin.getFrameJacobianTimeVariation(model, data, frame1, local)
            rate2 = pin.getFrameJacobianTimeVariation(model, data, frame2, local)
            # d/dt of R v2 - v1 - ω1 × t, which is the point's velocity in frame 1; t is zero.
            turning = turn @ pin.skew(spin2) - pin.skew(spin1) @ turn
            drift = pin.skew(turn @ two[:3] @ v - one[:3] @ v) @ one[3:]
            rates.append(turn @ rate2[:3] + turning @ two[:3] - rate1[:3] + drift)
        matrix = np.linalg.inv(np.vstack([jacobian, self.rows]))
        G = matrix[:, -len(self.motors) :]
        G_rate = -matrix[:, : -len(self.motors)] @ (np.vstack(rates) @ G)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        C = pin.computeCoriolisMatrix(model, data, q, v)
        g = pin.computeGeneralizedGravity(model, data, q)
        return G.T @ M @ G, G.T @ (M @ G_rate + C @ G), G.T @ g

    def newton(self, rows: Callable, residual: Callable):
        """Newton's method from home, until nothing is left."""
        q = self.home
        while True:
            jacobian = self.loops(q)
            gap = np.concatenate([data.c1Mc2.translation for data in self.datas])
            left = np.concatenate([gap, residual(q)])
            if np.abs(left).max() < 1e-12:
                return q
            q = pin.integrate(self.model, q, np.linalg.solve(np.vstack([jacobian, rows(q)]), -left))

    def inverse_kinematics(self, pose):
        """Find the configuration of a pose."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

        def residual(q):
            here = pin.updateFramePlacement(self.model, self.data, self.platform)
            turn = pin.log3(here.rotation @ pose.rotation.T)
            return np.concatenate([here.translation - pose.translation, turn])

        return self.newton(
            lambda q: pin.getFrameJacobian(self.model, self.data, self.platform, axes), residual
        )

    def forward_kinematics(self, lengths):
        """Find the configuration of motor positions."""
        return self.newton(lambda q: self.rows, lambda q: q[self.motors_q] - lengths)


def cases(name: str = "stewart") -> dict[str, tuple[Callable, Callable, Callable | None, Callable, Callable]]:
    """Bare call, the verb, the verb of an existing state, and what to compare."""
    chain = stp.load(name)
    bare = Bare(chain)
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.05, 0.1, -0.08), np.array([0.05, -0.03, 1.0]))
    twist, acceleration = np.array([0.1, 0.0, -0.2, 0.3, 0.1, 0.2]), np.array([0.0, 0.5, 1.0, 0.0, 0.4, -0.3])
    held = stp.platform_motion(chain, pose, twist, acceleration)
    q, v, a = (np.array(x) for x in (held.q, held.v, held.a))
    tau = stp.inverse_dynamics(chain, q, v, a).tau_motor
    lengths = stp.motor_positions(chain, q)
    known = chain.at(q, v, a)
    stp.inverse_dynamics(known), stp.motor_jacobian(known)
    stp.operational_dynamics(known)
    return {
        "inverse dynamics": (
            lambda: bare.inverse_dynamics(q, v, a),
            lambda: stp.inverse_dynamics(chain, q, v, a),
            lambda: stp.inverse_dynamics(known),
            lambda x: x,
            lambda x: x.tau_motor,
        ),
        "forward dynamics": (
            lambda: bare.forward_dynamics(q, v, tau),
            lambda: stp.forward_dynamics(chain, q, v, tau),
            lambda: stp.forward_dynamics(known, tau_motor=tau),
            lambda x: x,
            lambda x: x.a,
        ),
        "motor Jacobian": (
            lambda: bare.motor_jacobian(q),
            lambda: stp.motor_jacobian(chain, q),
            lambda: stp.motor_jacobian(known),
            lambda x: x,
            lambda x: x,
        ),
        "operational dynamics": (
            lambda: bare.operational_dynamics(q, v),
            lambda: stp.operational_dynamics(chain, q, v),
            lambda: stp.operational_dynamics(known),
            lambda x: np.concatenate([part.ravel() for part in x]),
            lambda x: np.concatenate([x.M.ravel(), x.C.ravel(), x.g]),
        ),
        "inverse kinematics": (
            lambda: bare.inverse_kinematics(pose),
            lambda: stp.inverse_kinematics(chain, pose),
            None,
            lambda x: x,
            lambda x: x.q,
        ),
        "forward kinematics": (
            lambda: bare.forward_kinematics(lengths),
            lambda: stp.forward_kinematics(chain, lengths),
            None,
            lambda x: x,
            lambda x: x.q,
        ),
    }


def timed(call: Callable) -> float:
    """Microseconds of one call."""
    begin = time.perf_counter()
    for _ in range(CALLS):
        call()
    return (time.perf_counter() - begin) / CALLS * 1e6


def main() -> None:
    """Print the table."""
    print(
        f"{'stewart, one state':24s} {'bare':>8s} {'verb':>8s} {'ratio':>6s} {'of a state':>10s} {'ratio':>6s}  agree"
    )
    for name, (bare, verb, again, of_bare, of_verb) in cases().items():
        off = np.abs(of_bare(bare()) - of_verb(verb())).max() / np.abs(of_bare(bare())).max()
        calls = [bare, verb, *([again] if again else [])]
        rounds = [[timed(call) for call in calls] for _ in range(ROUNDS)]
        medians = [statistics.median(column) for column in zip(*rounds, strict=True)]
        ratios = [statistics.median(r[k] / r[0] for r in rounds) for k in range(1, len(calls))]
        last = f"{medians[2]:8.0f} µs {ratios[1]:6.1f}" if again else " " * 17
        print(
            f"{name:24s} {medians[0]:5.0f} µs {medians[1]:5.0f} µs {ratios[0]:6.1f} {last}  {off:.0e}",
            flush=True,
        )


if __name__ == "__main__":
    main()
