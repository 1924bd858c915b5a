"""Wrenches from outside, one on every link: the laws hold with them as they do without."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.errors import SingularityError, UnsupportedError
from tests.closed_states import along, close, derivative
from tests.laws.conftest import Case, round_off, round_off_of_accelerations, round_off_of_efforts

AGREEMENT = 1e-10  # relative, as without wrenches


def drawn(chain: stp.ClosedChain, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draw a wrench of the size of the robot's weight for every link, the ground and links without mass among them."""
    weight = max(1.0, 9.81 * sum(body.mass for body in chain.model.inertias))
    unit = weight * np.repeat([1.0, chain.length_scale], 3)
    return {link.name: unit * rng.normal(size=6) for link in chain.mechanism.links}


def test_both_formulations_agree(held: Case, rng: np.random.Generator) -> None:
    chain, wrenches = held.chain, drawn(held.chain, rng)
    given = chain, held.q, held.v, held.a
    one = stp.inverse_dynamics(*given, wrenches=wrenches)
    two = stp.inverse_dynamics(*given, wrenches=wrenches, method="constraint_matrix")
    tolerance = round_off_of_efforts(held, AGREEMENT, one)
    close(two.tau_motor, one.tau_motor, tolerance)
    scale = chain.tangent_scale
    close(two.a / scale, one.a / scale, round_off_of_accelerations(held, AGREEMENT, one))
    assert (two.unique, two.reactions_unique) == (one.unique, one.reactions_unique)
    if chain.generic.rank:
        # The least of many reactions also sees the round-off of the null space.
        close(two.lambda_c, one.lambda_c, tolerance if one.reactions_unique else 10 * tolerance)
    without = stp.inverse_dynamics(*given)
    assert np.abs(one.tau_motor - without.tau_motor).max() > 1e-3 * np.abs(one.tau_motor).max()


def test_forward_undoes_inverse(held: Case, rng: np.random.Generator) -> None:
    chain, wrenches, scale = held.chain, drawn(held.chain, rng), held.chain.tangent_scale
    effort = stp.inverse_dynamics(chain, held.q, held.v, held.a, wrenches=wrenches)
    given, tolerance = (
        (chain, held.q, held.v, effort.tau_motor),
        round_off_of_accelerations(held, AGREEMENT, effort),
    )
    for method in (None, "projection", "constraint_dynamics"):
        try:
            motion = stp.forward_dynamics(*given, wrenches=wrenches, method=method)
        except UnsupportedError:
            assert method == "constraint_dynamics"
            continue
        close(motion.a / scale, effort.a / scale, tolerance)
        if effort.reactions_unique and chain.nc:
            close(motion.lambda_c, effort.lambda_c, round_off(held, AGREEMENT))
    if held.pose != "near_singular":  # where response times force loses more digits than a projection
        motion = stp.dynamics.closed_chain_articulated_body(*given, wrenches=wrenches)
        close(motion.a / scale, effort.a / scale, max(tolerance, 1e-9))


def test_articulated_bodies_agree_on_the_open_tree(case: Case, rng: np.random.Generator) -> None:
    chain, wrenches = case.chain, drawn(case.chain, rng)
    tau = rng.normal(size=chain.nv)
    try:
        a = stp.articulated_body_acceleration(chain, case.q, case.v, tau, wrenches=wrenches)
    except SingularityError:
        return  # joints that move no mass while the loops are open
    # Forces at the frames by Pinocchio's own Jacobians of frames, which nothing of the package takes part in.
    model, data = chain.model, pin.Data(chain.model)
    for name, wrench in wrenches.items():
        frame = model.getFrameId(name, pin.FrameType.BODY)
        at = pin.computeFrameJacobian(model, data, case.q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        tau = tau + np.reshape(at, (6, -1)).T @ wrench
    close(a / chain.tangent_scale, pin.aba(model, data, case.q, case.v, tau) / chain.tangent_scale, 1e-9)


def test_motors_and_wrenches_give_what_energy_gains(held: Case, rng: np.random.Generator) -> None:
    chain, model, v, wrenches = held.chain, held.chain.model, held.v, drawn(held.chain, rng)
    effort = stp.inverse_dynamics(chain, held.q, v, held.a, wrenches=wrenches)
    data, curve = pin.Data(model), along(chain, held.q, v, effort.a)

    def energy(t: float) -> float:
        q = curve(t)
        return pin.computeKineticEnergy(model, data, q, v + effort.a * t) + pin.computePotentialEnergy(
            model, data, q
        )

    pin.forwardKinematics(model, data, held.q, v)
    parts = list(effort.tau_motor * v[chain.motor_index])
    for name, wrench in wrenches.items():
        frame, axes = model.getFrameId(name, pin.FrameType.BODY), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        parts.append(float(wrench @ pin.getFrameVelocity(model, data, frame, axes).vector))
    size = max(np.abs(parts).sum(), energy(0.0) if chain.gravity.any() else 0.0)
    # Light parts that nothing holds fly off: the faster, the finer the differences.
    h = 1e-3 / max(1.0, float(np.abs(effort.a / chain.tangent_scale).max()) ** 0.5)
    # Differences see the energy's round-off divided by h.
    assert abs(sum(parts) - derivative(energy, h)) <= 1e-8 * size


def test_reactions_and_wrenches_move_each_body(held: Case, rng: np.random.Generator) -> None:
    chain, model, wrenches = held.chain, held.chain.model, drawn(held.chain, rng)
    if chain.couplings:
        return  # what a gear does to a joint stands in the joint's reaction as the inner moment that it is
    state = chain.at(held.q, held.v, held.a)
    effort = stp.inverse_dynamics(state, wrenches=wrenches)
    data = pin.Data(model)
    pin.forwardKinematics(model, data, held.q, held.v, effort.a)
    body = {
        link.name: model.frames[model.getFrameId(link.name, pin.FrameType.BODY)]
        for link in chain.mechanism.links
    }
    left = np.zeros((model.njoints, 6))
    size = 0.0
    for number in range(1, model.njoints):
        inertia, a = model.inertias[number], data.a[number] - data.oMi[number].actInv(model.gravity)
        force = inertia * a + data.v[number].cross(inertia * data.v[number])
        left[number] += data.oMi[number].act(force).vector
    for name, wrench in wrenches.items():
        frame = body[name]
        point = data.oMi[frame.parentJoint].act(frame.placement.translation)
        left[frame.parentJoint] -= [*wrench[:3], *(wrench[3:] + np.cross(point, wrench[:3]))]
    for part in stp.joint_reactions(state, effort=effort, wrenches=wrenches):
        moved = np.concatenate([part.force, part.moment + np.cross(part.point, part.force)])
        left[body[part.target].parentJoint] -= moved
        left[body[part.source].parentJoint] += moved
        size = max(size, np.abs(moved).max())
    assert np.abs(left[1:]).max() <= round_off(held, 1e-9) * size


def test_the_equation_in_chosen_coordinates_holds_with_them(held: Case, rng: np.random.Generator) -> None:
    chain, wrenches = held.chain, drawn(held.chain, rng)
    state = chain.at(held.q, held.v)
    for coordinates in ("motor", "platform"):
        if held.pose == "near_singular" and coordinates == "platform":
            continue  # rates of motors at rest of the platform have no digits
        if chain.nu > chain.generic.count.motor and coordinates == "motor":
            continue  # motors that depend on each other
        law = stp.operational_dynamics(state, coordinates=coordinates, wrenches=wrenches)
        wanted = law.motion.coordinates.sizes * rng.normal(size=law.g.size)
        a = law.motion.G @ wanted + law.motion.gamma
        effort = stp.inverse_dynamics(chain, held.q, held.v, a, wrenches=wrenches)
        close(effort.a / chain.tangent_scale, a / chain.tangent_scale, round_off(held, 1e-9))
        parts = [law.M @ wanted, law.c, law.g, law.w, law.motion.share.T @ effort.tau_motor]
        left = parts[0] + parts[1] + parts[2] - parts[3] - parts[4]
        assert np.abs(left).max() <= round_off(held, 1e-10) * np.abs(parts).max()
