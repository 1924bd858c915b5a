"""A chain written as MJCF and read back is the same mechanism, and what is written again is the same file to MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Loop, Mechanism
from tests.closed_states import NAMES
from tests.mechanisms import gear_train

mujoco = pytest.importorskip("mujoco")

TOLERANCE = 1e-12


def there_and_back(chain: stp.ClosedChain, folder: Path) -> stp.ClosedChain:
    path = folder / "again.xml"
    stp.export(chain, path, format="mjcf")
    return stp.load(path, platform=chain.platform, motors=None)


def shared_configuration(chain: stp.ClosedChain, other: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
    """Carry joint values over by name; frames of balls agree in these robots."""
    result = np.zeros(other.nq)
    for name, joint in zip(other.model.names[1:], other.model.joints[1:], strict=True):
        same = chain.model.joints[chain.model.getJointId(name)]
        result[joint.idx_q : joint.idx_q + joint.nq] = q[same.idx_q : same.idx_q + same.nq]
    return result


def tangent_order(chain: stp.ClosedChain, other: stp.ClosedChain) -> np.ndarray:
    """Index of every tangent entry of `other` in `chain`."""
    order: list[int] = []
    for name, joint in zip(other.model.names[1:], other.model.joints[1:], strict=True):
        first = chain.model.joints[chain.model.getJointId(name)].idx_v
        order += range(first, first + joint.nv)
    return np.array(order)


def require_same_mechanism(chain: stp.ClosedChain, other: stp.ClosedChain, rng: np.random.Generator) -> None:
    """Compare what both answer at random states: poses, inertia, bias, gap, Jacobian, in terms of the same joints."""
    assert other.motors == chain.motors
    np.testing.assert_array_equal(other.gravity, chain.gravity)
    order = tangent_order(chain, other)
    scale = chain.length_scale
    for k in range(4):
        q = (
            chain.q_home
            if k == 0
            else pin.integrate(chain.model, chain.q_home, rng.uniform(-0.3, 0.3, chain.nv))
        )
        v = rng.uniform(-1, 1, chain.nv)
        theirs = shared_configuration(chain, other, q)
        if k == 0:
            np.testing.assert_allclose(other.q_home, theirs, rtol=0, atol=TOLERANCE)
        one, two = stp.platform_pose(chain, q), stp.platform_pose(other, theirs)
        np.testing.assert_allclose(two.homogeneous, one.homogeneous, rtol=0, atol=TOLERANCE * max(1, scale))
        data1, data2 = pin.Data(chain.model), pin.Data(other.model)
        mass1, mass2 = pin.crba(chain.model, data1, q), pin.crba(other.model, data2, theirs)
        full = np.triu(mass1) + np.triu(mass1, 1).T
        again = np.triu(mass2) + np.triu(mass2, 1).T
        np.testing.assert_allclose(
            again, full[np.ix_(order, order)], rtol=0, atol=TOLERANCE * np.abs(full).max()
        )
        bias = pin.nonLinearEffects(chain.model, data1, q, v)
        again = pin.nonLinearEffects(other.model, data2, theirs, v[order])
        np.testing.assert_allclose(again, bias[order], rtol=0, atol=TOLERANCE * np.abs(bias).max())
        if chain.nc:
            closed = stp.close_loops(chain, q).q
            theirs = shared_configuration(chain, other, closed)
            assert np.abs(stp.loop_gap(other, theirs)).max() < 1e-11 * max(1, scale)
            first, second = stp.loop_jacobian(chain, closed)[:, order], stp.loop_jacobian(other, theirs)
            projected = second - second @ np.linalg.pinv(first, rcond=1e-9) @ first
            assert np.abs(projected).max() < 1e-9 * max(1, scale)
            assert np.linalg.matrix_rank(first, tol=1e-9) == np.linalg.matrix_rank(second, tol=1e-9)


def require_same_limits(chain: stp.ClosedChain, other: stp.ClosedChain) -> None:
    for joint in chain.mechanism.joints:
        if joint.has_axis:
            again = other.mechanism.joint(joint.name)
            assert (again.lower, again.upper) == (joint.lower, joint.upper)
            assert again.effort == joint.effort or joint.effort == 0


@pytest.mark.parametrize("name", NAMES)
def test_bundled_robots(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    chain = stp.load(name, gravity=(0.3, -0.2, -9.7))
    again = there_and_back(chain, tmp_path)
    assert [(x.name, x.kind) for x in again.loops] == [(x.name, x.kind) for x in chain.loops]
    require_same_mechanism(chain, again, rng)
    require_same_limits(chain, again)


@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_closed_forms_of_hexapods_take_what_was_read(name: str, tmp_path: Path) -> None:
    """The base is a body fixed to MuJoCo's world."""
    chain = stp.load(name)
    mine, other = (stp.Hexapod.from_chain(x) for x in (chain, there_and_back(chain, tmp_path)))
    np.testing.assert_allclose(other.base_points, mine.base_points, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(other.platform_points, mine.platform_points, rtol=0, atol=TOLERANCE)
    mine, other = (stp.hexapods.hexapod_bodies(x) for x in (chain, there_and_back(chain, tmp_path)))
    assert other.lower_joint == mine.lower_joint
    for one, two in zip((mine.platform, *mine.lower), (other.platform, *other.lower), strict=True):
        assert two.mass == one.mass
        np.testing.assert_allclose(two.inertia, one.inertia, rtol=0, atol=TOLERANCE)


def test_couplings(rng: np.random.Generator, tmp_path: Path) -> None:
    chain = gear_train(rng)
    again = there_and_back(chain, tmp_path)
    for mine, other in zip(chain.couplings, again.couplings, strict=True):
        assert (other.name, other.joint1, other.joint2) == (mine.name, mine.joint1, mine.joint2)
        assert other.polynomial == mine.polynomial
    require_same_mechanism(chain, again, rng)


def two_arms(kind: JointKind, rng: np.random.Generator, **options) -> stp.ClosedChain:
    """Build two arms of three joints each from the ground, their hands joined by a loop that closes at home."""

    def skew() -> np.ndarray:
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)

    def place() -> pin.SE3:
        return pin.exp6(rng.uniform(-0.5, 0.5, 6))

    kinds = (JointKind.REVOLUTE, JointKind.SPHERICAL, JointKind.PRISMATIC)
    links, joints = [Link("ground")], []
    for side in ("left", "right"):
        names = ["ground", *(f"{side}{k}" for k in range(1, 4))]
        for k, joint_kind in enumerate(kinds):
            body = place().act(pin.Inertia.FromBox(rng.uniform(1, 3), *rng.uniform(0.1, 1.0, 3)))
            links.append(Link(names[k + 1], body))
            # Axes of balls are those of the body, so that their coordinates survive.
            placed = pin.SE3(np.eye(3), place().translation) if joint_kind is JointKind.SPHERICAL else place()
            joints.append(
                Joint(f"{side}_joint{k}", joint_kind, names[k], names[k + 1], placed, skew(), -4.0, 5.0, 6.0)
            )
    tree = Mechanism("arms", tuple(links), tuple(joints), platform="left3")
    bare = build_chain(tree, motors=["left_joint0"])
    data = pin.Data(bare.model)
    pin.framesForwardKinematics(bare.model, data, bare.q_home)
    end1 = place()
    gap = pin.SE3.Identity()
    axis, axis2 = skew(), skew()
    if kind is JointKind.UNIVERSAL:
        axis2 -= axis * (axis @ axis2)
        axis2 /= np.linalg.norm(axis2)
    if kind is JointKind.DISTANCE:
        gap = pin.SE3(np.eye(3), 0.7 * skew())
    oM1, oM2 = (data.oMf[bare.model.getFrameId(link)] for link in ("left3", "right3"))
    end2 = oM2.inverse() * oM1 * end1 * gap
    loop = Loop("closure", kind, "left3", "right3", end1, end2, axis, axis2, 0.7)
    home = {
        name: bare.q_home[joint.idx_q : joint.idx_q + joint.nq]
        for name, joint in zip(bare.model.names[1:], bare.model.joints[1:], strict=True)
    }
    couplings = (Coupling("held", "right_joint2", None, tuple(home["right_joint2"])),)
    return build_chain(
        Mechanism("arms", tuple(links), tuple(joints), (loop,), couplings, "left3", home),
        motors=["left_joint0"],
    )


KINDS = (
    JointKind.SPHERICAL,
    JointKind.FIXED,
    JointKind.REVOLUTE,
    JointKind.UNIVERSAL,
    JointKind.DISTANCE,
)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_loop_that_mujoco_has(
    kind: JointKind, rng: np.random.Generator, tmp_path: Path
) -> None:
    chain = two_arms(kind, rng)
    again = there_and_back(chain, tmp_path)
    (loop,) = again.loops
    assert (loop.name, loop.kind) == ("closure", kind)
    require_same_mechanism(chain, again, rng)
    require_same_limits(chain, again)


def test_what_is_read_is_written_the_same(rng: np.random.Generator, tmp_path: Path) -> None:
    """Read a file with every joint, write it, and compare what MuJoCo compiles from both."""
    from tests.model.small_mjcf import QPOS, WORKSHOP, write
    from tests.oracles.test_mjcf_reading import Twin, require_same_tree

    text = WORKSHOP.replace(' ref="25"', "").replace(' ref="0.12"', "").replace(' ref="-0.05"', "")
    ties = '<connect name="c" body1="coupler" body2="platform" anchor="0.1 0.2 0.3"/>'
    source = write(tmp_path, text % (ties, QPOS), "source.xml")
    chain = stp.load(source)
    stp.export(chain, tmp_path / "written.xml", format="mjcf")
    first, second = Twin.of(source).model, Twin.of(tmp_path / "written.xml").model
    require_same_tree(Twin.of(tmp_path / "written.xml"), rng)
    assert (first.nv, first.njnt, first.neq) == (second.nv, second.njnt, second.neq)
    for number in range(1, first.nbody):
        name = first.body(number).name
        if name:
            other = second.body(name)
            np.testing.assert_allclose(other.mass, first.body(name).mass, rtol=1e-12)
            np.testing.assert_allclose(np.sort(other.inertia), np.sort(first.body(name).inertia), rtol=1e-12)
