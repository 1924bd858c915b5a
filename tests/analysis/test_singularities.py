"""The first singularity of a path, against roots of closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.closed_states import random_configuration, robot
from tests.mechanisms import five_bar, four_bar
from tests.singular_robots import at_pin, moved, three_upu


def turned(chain: stp.ClosedChain, place: tuple[float, float, float], axis: tuple[float, float, float]):
    """Path of a platform that turns about its origin; its parameter is the angle [rad]."""
    last = [chain.q_home]

    def path(angle: float) -> np.ndarray:
        pose = pin.SE3(pin.exp3(angle * np.array(axis)), np.array(place))
        last[0] = stp.inverse_kinematics(chain, pose, q_guess=chain.q_home, limits=False).q
        return last[0]

    return path


@pytest.mark.parametrize("samples", [2, 9, 33])
def test_hexapod_that_turns_meets_the_right_angle(samples: int) -> None:
    """Fichter's singularity, to the last digits and from any number of samples."""
    chain = robot("stewart")
    found = stp.singularities.find_singularity(
        chain, turned(chain, (0, 0, 1.0), (0, 0, 1.0)), interval=(-0.3, 2.4), samples=samples
    )
    assert found.found and found.crossed and found.kind == "motor"
    assert found.at == pytest.approx(np.pi / 2, abs=1e-13)
    assert found.margin < 1e-13 and found.singularity.kinds == ("motor",)
    assert found.distance > np.pi / 2 + 0.3  # the platform alone turns so far


def test_planar_platform_meets_the_root_of_its_determinant(rng: np.random.Generator) -> None:
    """3-RPR along random moves: the first change of sign of det J in closed form, and none where there is none."""
    chain, planar = (
        robot("rpr_planar"),
        stp.PlanarRPR(np.array([[0, 0], [5, 0], [0, 6.0]]), np.array([[0, 0], [3, 0], [3, 3.0]])),
    )
    start = np.array([2.0, 2.5, 0.2])
    seen = set()
    for reach in (1.0, 1.0, 1.0, 0.1, 0.1):
        end = start + reach * rng.uniform(-1, 1, 3) * [1.0, 1.0, 2.5]

        def along(s: float, end: np.ndarray = end) -> np.ndarray:
            return start + s * (end - start)

        def determinant(s: float, along=along) -> float:
            x = along(s)
            return float(np.linalg.det(stp.planar.planar_leg_jacobian(planar, x[:2], x[2])))

        def path(s: float, along=along) -> np.ndarray:
            x = along(s)
            pose = pin.SE3(pin.exp3(np.array([0, 0, x[2]])), np.array([x[0], x[1], 0]))
            return stp.inverse_kinematics(chain, pose, limits=False).q

        found = stp.singularities.find_singularity(chain, path, kinds=["motor"])
        values = np.array([determinant(s) for s in np.linspace(0, 1, 401)])
        changes = np.flatnonzero(np.diff(np.sign(values)))
        assert found.found == bool(len(changes))
        seen.add(found.found)
        if len(changes):
            k = changes[0]
            root = brentq(determinant, k / 400, (k + 1) / 400, xtol=1e-14)
            assert found.at == pytest.approx(root, abs=1e-11)
    assert seen == {True, False}


def test_crank_meets_both_dead_points() -> None:
    """A crank-rocker: rocker at the ends of its swing, where crank and coupler are in line."""
    chain = replace(four_bar(), platform="rocker")

    def path(angle: float) -> np.ndarray:
        return stp.forward_kinematics(chain, [angle], q_guess=chain.q_home).q

    stretched = np.arccos((1.1**2 + 0.9**2 - 0.6**2) / (2 * 1.1 * 0.9))
    folded = np.pi + np.arccos((0.5**2 + 0.9**2 - 0.6**2) / (2 * 0.5 * 0.9))
    first = stp.singularities.find_singularity(chain, path, interval=(0.2, 6.0))
    assert (first.kind, first.crossed) == ("platform", True)
    assert first.at == pytest.approx(stretched, abs=1e-13)
    second = stp.singularities.find_singularity(chain, path, interval=(first.at + 1e-3, 6.0))
    assert second.at == pytest.approx(folded, abs=1e-13)
    assert second.singularity.kinds == ("platform",)


def test_translational_platform_meets_its_cylinder() -> None:
    """3-UPU: the loops lose rank at 2 (R - r) from the axis, and the singular value has a kink there, not a sign."""
    chain = three_upu(0.5, 0.3)
    for direction in (0.3, 2.0):
        way = np.array([np.cos(direction), np.sin(direction)])
        found = stp.singularities.find_singularity(
            chain, lambda r, way=way: moved(chain, *(r * way), 1.0), interval=(0.0, 0.6), kinds=["loop"]
        )
        assert found.found and found.crossed
        assert found.at == pytest.approx(0.4, abs=1e-9)
        assert "loop" in found.singularity.kinds


def test_arm_between_configurations() -> None:
    arm = robot("arm_3r_planar")
    found = stp.singularities.find_singularity(
        arm, np.array([[0.3, 0.5, 0.2], [0.3, 0.7, 0.2], [0.3, -0.2, 0.7]])
    )
    # Elbow straight: on the second stretch, at 7/9 of it.
    assert found.at == pytest.approx(1 + 7 / 9, abs=1e-13)
    assert found.crossed and found.kind == "platform"
    assert found.q[1] == pytest.approx(0.0, abs=1e-13)
    assert found.distance == pytest.approx(0.2 + np.linalg.norm([0.7, 7 / 9 * 0.5]), rel=1e-9)


def test_paths_between_closed_configurations_are_closed(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    stops = [random_configuration(chain, rng) for _ in range(3)]
    path = stp.loops.closed_path(chain, stops)
    for k, q in enumerate(stops):
        assert path(float(k)) == pytest.approx(q, abs=1e-9)
    for s in (0.3, 1.7):
        assert np.abs(stp.loop_gap(chain, path(s))).max() < 1e-12
    found = stp.singularities.find_singularity(chain, stops)
    assert not found.found and not found.crossed
    assert found.margin == min(found.singularity.measures.values()) > 0.05


def test_touching_without_crossing() -> None:
    """An arm that straightens and bends back the same way: zero without a change of sign."""
    arm = robot("arm_3r_planar")
    found = stp.singularities.find_singularity(arm, lambda s: np.array([0.3, (s - 0.4137) ** 2, 0.5]))
    assert found.found and not found.crossed
    # The measure is quadratic: where it is below the tolerance of 1e-8 is known to its root.
    assert found.at == pytest.approx(0.4137, abs=1e-3)
    near = stp.singularities.find_singularity(arm, lambda s: np.array([0.3, 1e-3 + (s - 0.4137) ** 2, 0.5]))
    assert not near.found and near.at == pytest.approx(0.4137, abs=1e-2)
    assert 1e-5 < near.margin < 1e-3


def test_a_singularity_at_a_sample_is_still_one_crossing() -> None:
    arm = robot("arm_3r_planar")
    found = stp.singularities.find_singularity(arm, lambda s: np.array([0.3, s - 0.5, 0.5]), samples=3)
    assert (found.found, found.crossed, found.at) == (True, True, 0.5)
    begin = stp.singularities.find_singularity(arm, lambda s: np.array([0.3, s, 0.5]))
    assert (begin.found, begin.at, begin.distance) == (True, 0.0, 0.0)
    end = stp.singularities.find_singularity(arm, lambda s: np.array([0.3, 1 - s, 0.5]))
    assert end.found and end.at == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize(
    ("hip", "way", "kind"), [(0.8, 1, "platform"), (1.05, 1, "motor"), (1.05, -1, "platform")]
)
def test_the_first_of_several_kinds_is_found(hip: float, way: int, kind: str) -> None:
    """Five-bar, its tip as the platform: straight knees against distal links in line, whichever comes first."""
    chain = at_pin(five_bar(motors=("left_hip", "right_hip")))
    bent = replace(chain, motors=("left_hip", "left_knee"))

    def path(s: float) -> np.ndarray:
        return stp.forward_kinematics(bent, [hip, way * s], q_guess=chain.q_home).q

    def lines(s: float) -> tuple[float, float]:
        left_hip, left_knee, right_hip, right_knee = (
            path(s)[chain.tangent_names.index(name)]
            for name in ("left_hip", "left_knee", "right_hip", "right_knee")
        )
        legs = np.sin(left_knee) * np.sin(right_knee)
        return float(legs), float(np.sin(left_hip + left_knee - right_hip - right_knee))

    ends = (-1.7, 0.3) if way > 0 else (-0.3, 1.7)
    ends = ends if kind == "motor" or way < 0 else (-0.9, 0.3)
    grid = np.linspace(*ends, 25)
    values = np.array([lines(s) for s in grid])
    roots = []
    for name, column in (("platform", 0), ("motor", 1)):
        for k in np.flatnonzero(np.diff(np.sign(values[:, column]))):
            root = brentq(lambda x, c=column: lines(x)[c], grid[k], grid[k + 1], xtol=1e-14)
            roots.append((root, name))
    found = stp.singularities.find_singularity(chain, path, interval=ends, axes=("vx", "vy"))
    assert found.found and found.crossed
    assert (pytest.approx(found.at, abs=1e-10), found.kind) == min(roots)
    assert found.kind == kind


def test_jumps_and_bad_arguments_are_refused() -> None:
    arm, bar = robot("arm_3r_planar"), four_bar()
    with pytest.raises(InputError, match=r"path jumps between 0\.5.*joint"):
        stp.singularities.find_singularity(arm, lambda s: np.array([0.3, 0.4, 0.5 + 3.0 * (s > 0.5)]))
    with pytest.raises(InputError, match="interval must rise"):
        stp.singularities.find_singularity(arm, lambda s: arm.q_home, interval=(1.0, 0.0))
    with pytest.raises(InputError, match="samples must be 2 or more"):
        stp.singularities.find_singularity(arm, lambda s: arm.q_home, samples=1)
    with pytest.raises(InputError, match="kinds must be some of loop, motor"):
        stp.singularities.find_singularity(arm, lambda s: arm.q_home, kinds=["type II"])
    with pytest.raises(InputError, match="two or more"):
        stp.loops.closed_path(arm, np.zeros((1, 3)))
    with pytest.raises(InputError, match="path must have shape"):
        stp.singularities.find_singularity(arm, lambda s: np.zeros(2))
    # Between these two the nearest closed configuration changes the assembly mode.
    with pytest.raises(InputError, match=r"path jumps between .* elbow moves by"):
        stp.singularities.find_singularity(bar, np.array([bar.q_home, bar.q_home + [np.pi, 0, 0]]))
