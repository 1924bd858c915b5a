"""Homes of legs whose balls have cones, and the bounded steps that look for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import lsq_linear

import stewart_pin as stp
from stewart_pin.building.home_within_limits import _within
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Bounds, Joint, JointKind, Link, Loop, Mechanism

BODY = pin.Inertia(1.0, np.zeros(3), np.eye(3))


def tripod(*, swing: float, lean: float) -> Mechanism:
    """Tell of three legs, a ball at either end, whose axes at the base lean inwards; the home is not named."""
    links, loops = [Link("base"), Link("platform", BODY)], []
    joints = [Joint("pose", JointKind.FLOATING, "base", "platform", pin.SE3.Identity())]
    half, upright = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5])), np.eye(3)
    for k in range(3):
        turn = pin.utils.rotate("z", 2 * np.pi * k / 3)
        foot, leant = turn @ [1.0, 0.0, 0.0], turn @ pin.utils.rotate("y", -lean)
        links += [Link(f"lower{k}", BODY), Link(f"upper{k}", BODY)]
        joints += [
            Joint(f"foot{k}", JointKind.SPHERICAL, "base", f"lower{k}", pin.SE3(leant, foot), swing=swing),
            Joint(f"slide{k}", JointKind.PRISMATIC, f"lower{k}", f"upper{k}", half, lower=0.0, upper=1.0),
        ]
        ends = half, pin.SE3(upright, 0.6 * foot)
        cone = (Bounds(position=(-np.inf, swing)), Bounds())
        loops.append(Loop(f"head{k}", JointKind.SPHERICAL, f"upper{k}", "platform", *ends, bounds=cone))
    return Mechanism("tripod", tuple(links), tuple(joints), tuple(loops), platform="platform")


def test_balls_stand_within_their_cones() -> None:
    """Where nothing is named, a home is found at which all six of them do."""
    chain = build_chain(tripod(swing=0.3, lean=0.3), motors=[])
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    assert not stp.limits_exceeded(chain.at(chain.q_home))


def test_cones_that_no_home_meets_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Axes at the base lean outwards, the legs cannot."""
    # The search starts from fewer configurations, which tell as much.
    monkeypatch.setattr("stewart_pin.building.home_within_limits._ATTEMPTS", 1)
    chain = build_chain(tripod(swing=0.05, lean=-1.2), motors=[])
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    told = str(chain.report)
    for ball in ("foot0 swing", "foot1 swing", "foot2 swing"):
        assert f"'{ball}' at " in told


@pytest.mark.parametrize("shape", [(12, 12), (40, 25), (9, 9)])
@pytest.mark.parametrize("damping", [1e-9, 1e-3])
def test_bounded_steps_are_the_least_squares(
    shape: tuple[int, int], damping: float, rng: np.random.Generator
) -> None:
    """Beside SciPy's method of active sets, one row twice and one column nearly so."""
    for _ in range(5):
        matrix, right = rng.normal(size=shape), rng.normal(size=shape[0])
        matrix[1], matrix[:, 2] = matrix[0], matrix[:, 1] * (1 + 1e-9)
        system = np.vstack([matrix, damping * np.eye(shape[1])])
        target = np.concatenate([right, np.zeros(shape[1])])
        upper = rng.uniform(0, 0.3, shape[1])
        lower = -rng.uniform(0, 0.3, shape[1])
        ours = _within(system, target, lower, upper)
        theirs = lsq_linear(system, target, bounds=(lower, upper), method="bvls", tol=1e-14).x
        assert ((ours >= lower) & (ours <= upper)).all()
        left = [np.linalg.norm(system @ x - target) for x in (ours, theirs)]
        assert left[0] <= left[1] * (1 + 1e-9)


def test_a_home_pressed_to_a_limit_is_not_beyond_it_by_a_bit(tmp_path: Path) -> None:
    # The cylinder would be shorter than its stroke lets it, so that the search ends at the limit where it began.
    path = tmp_path / "boom.urdf"
    path.write_text(BOOM)
    chain = stp.load(path)
    stroke = chain.q_home[chain.model.joints[chain.model.getJointId("stroke")].idx_q]
    assert 0.0365 <= stroke <= 0.2365
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    assert stp.limits_exceeded(chain.home_state()) == ()


MASS = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
BOOM = f"""<robot name="boom">
<link name="base"/>
<link name="boom">{MASS}</link>
<link name="cylinder">{MASS}</link>
<link name="rod">{MASS}</link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="boom"/>
<origin rpy="0 0.4 0"/><axis xyz="0 1 0"/></joint>
<joint name="swing" type="continuous"><parent link="base"/><child link="cylinder"/>
<origin xyz="0 0 -0.12"/><axis xyz="0 1 0"/></joint>
<joint name="stroke" type="prismatic" independent="true"><parent link="cylinder"/><child link="rod"/><axis xyz="1 0 0"/>
<limit lower="0.0365" upper="0.2365" effort="10000" velocity="1"/></joint>
<loop name="eye" type="spherical"><predecessor link="rod"><origin xyz="0.25 0 0"/></predecessor>
<successor link="boom"><origin xyz="0.28 0 -0.05"/></successor></loop>
</robot>"""
