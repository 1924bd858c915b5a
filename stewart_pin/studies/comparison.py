"""The same forces by every method: how well they agree, and what each mass contributes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from stewart_pin.brief import Brief
from stewart_pin.building.joints import without_joint_physics
from stewart_pin.building.variants import massless_legs, replace_inertias
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.choosing import kernels_for
from stewart_pin.mechanics.closed_forms import LegForm, admission, point_of
from stewart_pin.mechanics.inverse_dynamics import Method, inverse_dynamics
from stewart_pin.mechanics.kinematics import platform_motion
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import turning_motors
from stewart_pin.state.outside import MotionWrenches, WrenchSamples, wrench_samples
from stewart_pin.state.state import State, as_chain
from stewart_pin.typing import FloatArray

_ANOTHER_BRANCH = 1e-6
"""How far motors may be from where the motion leads them, in natural units: other branches lie farther away."""
Progress = Callable[[str, int, int], None]
"""Called with the stage, the states done and their number."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Brief):
    """Motor forces of one motion by several methods.

    Attributes
    ----------
    robot
        Name of the robot.
    motors
        Names of the motors.
    time
        (N,) instants [s].
    forces
        Motor forces (N, nu) by method, with the robot's masses [N or N m].
    simplified
        Motor forces (N, nu) by method, with massless legs and a point platform [N or N m].
    contributions
        Motor forces (N, nu) that each part is responsible for: the platform as a point, its rotational inertia
        (with an offset centre of mass), the legs as points, their rotational inertia; wrenches from outside, and
        rotors, springs, damping and friction of joints, where there are such; they add up [N or N m].
    notes
        What was left out, and why.
    """

    robot: str
    motors: tuple[str, ...]
    time: FloatArray
    forces: Mapping[str, FloatArray]
    simplified: Mapping[str, FloatArray]
    contributions: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()

    @property
    def agreement(self) -> dict[str, float]:
        """Largest relative difference between any two methods, with the robot's masses and simplified."""
        return {"agreement": spread(self.forces), "agreement_simplified": spread(self.simplified)}

    @property
    def reference(self) -> FloatArray:
        """(N, nu) motor forces by the first method [N or N m]."""
        return next(iter(self.forces.values()))


def compare_methods(
    chain: ClosedChain,
    samples: PlatformSamples,
    *,
    wrenches: MotionWrenches | None = None,
    kernels: bool | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Compute the motor forces of a motion by every method that applies.

    Parameters
    ----------
    chain
        Closed chain whose platform can do the motion.
    samples
        The motion.
    wrenches
        What acts from outside, as in `motor_demand`; the closed forms are methods where it acts on the platform alone
        [N, N m].
    kernels
        Whether compiled kernels are one of the methods, and give the contributions; None: for more than a handful of
        states, where CasADi is installed and the chain can be compiled.
    progress
        Told after every state.

    Returns
    -------
    Comparison
        Forces by method; the closed form and the point-mass formula where they stand for the chain (`closed_forms`),
        kernels where they have an answer at every instant, on the branch of the motion.
    """
    as_chain(chain)
    if not isinstance(samples, PlatformSamples):
        raise InputError(
            f"samples must be PlatformSamples, as sinusoidal_motion gives, got {type(samples).__name__}"
        )
    outside = wrench_samples(chain, wrenches, samples.time)
    links, rows = ((), ()) if outside is None else (outside.links, (outside.rows,))
    say = progress or (lambda stage, done, total: None)
    states: list[State] = []
    q = chain.q_home
    for k in range(len(samples)):
        states.append(
            platform_motion(chain, samples.pose(k), samples.twist[k], samples.acceleration[k], q_guess=q)
        )
        q = states[-1].q
        say("kinematics", k + 1, len(samples))

    def tree_forces(
        variant: ClosedChain, method: Method, stage: str, outside: WrenchSamples | None = outside
    ) -> FloatArray:
        forces = np.empty((len(states), chain.nu))
        for k, state in enumerate(states):
            forces[k] = inverse_dynamics(
                variant,
                *(state.q, state.v, state.a),
                wrenches=None if outside is None else outside.at(k),
                method=method,
            ).tau_motor
            say(stage, k + 1, len(states))
        return forces

    pose = np.hstack([samples.position, Rotation.from_matrix(samples.rotation).as_quat()])

    notes: list[str] = []
    turning = turning_motors(chain)
    followed = np.array([state.q[chain.motor_q_index] for state in states]).reshape(len(states), chain.nu)

    def array_forces(variant: ClosedChain) -> FloatArray | None:
        try:
            compiled = kernels_for(variant, len(samples), kernels, links)
        except UnsupportedError as error:
            notes.append(f"no kernels: {error}")
            return None
        if compiled is None:
            return None
        codes = np.zeros((2, len(samples)), dtype=np.int8)
        own = compiled.inverse_kinematics(pose, status=codes[0])
        forces = compiled.inverse_dynamics(pose, samples.twist, samples.acceleration, *rows, status=codes[1])
        refused = (codes != StateStatus.OK).any(axis=0)
        if refused.any():
            first = int(np.argmax(refused))
            code = StateStatus(int(codes[:, first].max())).name
            where = f"the first at {samples.time[first]:g} s: {code}"
            notes.append(
                f"no kernels: from home they have no answer at {refused.sum()} of {len(samples)} instants, {where}"
            )
            return None
        apart = (own - followed) / chain.tangent_scale[chain.motor_index]
        apart[:, turning] = np.sin(apart[:, turning] / 2)
        if np.abs(apart).max(initial=0.0) > _ANOTHER_BRANCH:
            notes.append("no kernels: from home they reach another branch than the motion that is followed")
            return None
        return forces

    def forces_of(variant: ClosedChain, stage: str) -> FloatArray:
        forces = array_forces(variant)
        return tree_forces(variant, "pinocchio", stage) if forces is None else forces

    simple = point_of(chain)
    methods: tuple[Method, ...] = ("pinocchio", "constraint_matrix")
    forces: dict[str, FloatArray] = {m: tree_forces(chain, m, m) for m in methods}
    simplified: dict[str, FloatArray] = {m: tree_forces(simple, m, f"{m}, simplified") for m in methods}
    for variant, found in ((chain, forces), (simple, simplified)):
        compiled = array_forces(variant)
        if compiled is not None:
            found["kernels"] = compiled
    given = samples, outside
    _add_closed_form("closed form", chain, "leg_efforts", *given, forces, notes)
    _add_closed_form("simplified closed form", simple, "leg_efforts", *given, simplified, notes)
    _add_closed_form("simplified point mass", chain, "point_mass", *given, simplified, notes)
    # Inverse dynamics is linear in the inertial parameters: what each adds is its share, whatever the order.
    rigid = forces_of(massless_legs(chain), "massless legs")
    points = forces_of(_point_legs(chain), "point legs")
    whole, bare = forces["pinocchio"], simplified["pinocchio"]
    contributions = {
        "platform mass": bare,
        "platform inertia": rigid - bare,
        "leg masses": points - rigid,
        "leg inertia": whole - points,
    }
    if outside is not None:
        contributions["platform mass"] = tree_forces(simple, "pinocchio", "without wrenches", None)
        contributions["wrenches"] = bare - contributions["platform mass"]
    if chain.joint_effects.present:
        with_joints = contributions["platform mass"]
        guiding = without_joint_physics(simple)
        contributions["platform mass"] = tree_forces(guiding, "pinocchio", "without joints", None)
        contributions["joints"] = with_joints - contributions["platform mass"]
    return Comparison(
        chain.name, chain.motors, samples.time, forces, simplified, contributions, tuple(dict.fromkeys(notes))
    )


def _add_closed_form(
    name: str,
    chain: ClosedChain,
    form: Literal["leg_efforts", "point_mass"],
    samples: PlatformSamples,
    outside: WrenchSamples | None,
    found: dict[str, FloatArray],
    notes: list[str],
) -> None:
    """Add the motor forces (N, nu) by a closed form; where it does not stand, a note that says why."""
    admitted = admission(chain, form)
    if not (admitted.admitted and isinstance(admitted.geometry, LegForm)):
        notes.append(f"no {name} for this robot: {admitted.reason}")
        return
    pushed = None if outside is None else outside.on_platform(chain, samples.rotation)
    if outside is not None and pushed is None:
        notes.append(f"no {name}: wrenches act on other links than the platform")
        return
    motion = samples.position, samples.rotation, samples.twist, samples.acceleration
    found[name.removeprefix("simplified ").replace(" ", "_")] = admitted.geometry.efforts(*motion, pushed)


def spread(forces: Mapping[str, FloatArray]) -> float:
    """Measure how far methods are apart.

    Parameters
    ----------
    forces
        (N, nu) by method [N or N m].

    Returns
    -------
    float
        Largest difference between two methods, relative to the largest force of all; nan where one has no number.
    """
    stack = np.stack(list(forces.values()))
    largest = np.abs(stack).max(initial=0.0)
    # A nan is not zero, and stays.
    return float(np.ptp(stack, axis=0).max() / largest) if largest != 0 else 0.0


def _point_legs(chain: ClosedChain) -> ClosedChain:
    """Shrink every body but ground and platform to a point at its centre of mass."""
    kept = {chain.mechanism.root, chain.platform_link}
    inertias = {
        link.name: pin.Inertia(link.inertia.mass, link.inertia.lever, np.zeros((3, 3)))
        for link in chain.mechanism.links
        if link.inertia is not None and link.name not in kept
    }
    return replace_inertias(chain, inertias)
