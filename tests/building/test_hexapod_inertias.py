"""Bodies that fit a geometry."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError


def test_estimated_bodies_are_a_disc_and_rods(report_ideal: stp.Hexapod) -> None:
    bodies = stp.hexapods.hexapod_inertias(report_ideal, platform=20.0, lower=2.0, upper=1.5, leg_length=1.0)
    assert [bodies[name].mass for name in ("platform", "lower", "upper")] == [20.0, 2.0, 1.5]
    np.testing.assert_allclose(
        bodies["platform"].lever, report_ideal.platform_points.mean(axis=0), atol=1e-15
    )
    radius = np.linalg.norm(report_ideal.platform_points, axis=1).max()
    assert bodies["platform"].inertia[2, 2] == pytest.approx(20 * radius**2 / 2, rel=1e-14)
    # Slender rods over 0.6 m from either end: m l² / 12 but for their thickness.
    np.testing.assert_allclose([bodies["lower"].lever[2], bodies["upper"].lever[2]], [0.3, -0.3], rtol=1e-15)
    assert bodies["lower"].inertia[0, 0] == pytest.approx(2 * 0.6**2 / 12, rel=0.01)
    assert bodies["upper"].inertia[1, 1] == pytest.approx(1.5 * 0.6**2 / 12, rel=0.01)
    for name in bodies:
        moments = np.linalg.eigvalsh(bodies[name].inertia)
        assert moments[0] > 0 and moments[2] < moments[0] + moments[1]


@pytest.mark.parametrize(
    "hexapod",
    [
        stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3),
        stp.hexapods.hexapod_6_3(0.5, 0.4, 0.2),
        stp.hexapods.cubic_hexapod(0.6, 0.4),
    ],
)
def test_every_design_becomes_a_robot(hexapod: stp.Hexapod, rng: np.random.Generator) -> None:
    bodies = stp.hexapods.hexapod_inertias(hexapod, platform=20.0, lower=2.0, upper=1.5)
    chain = stp.hexapod_chain(hexapod, **bodies)
    found = stp.mobility(chain)
    assert (found.dof, found.motors_sufficient, found.redundant_rows) == (6, True, 0)
    # Two formulations agree on a robot that no file describes.
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(pin.exp3(rng.uniform(-0.1, 0.1, 3)), home.translation + rng.uniform(-0.05, 0.05, 3))
    state = stp.platform_motion(chain, pose, rng.normal(size=6), rng.normal(size=6))
    efforts = [
        stp.inverse_dynamics(chain, state.q, state.v, state.a, method=method).tau_motor
        for method in ("pinocchio", "constraint_matrix")
    ]
    np.testing.assert_allclose(*efforts, rtol=1e-9)


def test_estimated_bodies_refuse_what_has_no_size(report_ideal: stp.Hexapod) -> None:
    with pytest.raises(InputError, match="upper must be a finite number above zero, got 0"):
        stp.hexapods.hexapod_inertias(report_ideal, platform=1.0, lower=1.0, upper=0.0)
    point = stp.Hexapod(report_ideal.base_points, np.zeros((6, 3)))
    with pytest.raises(InputError, match="all platform points coincide"):
        stp.hexapods.hexapod_inertias(point, platform=1.0, lower=1.0, upper=1.0)


def test_bodies_are_made_for_a_leg_inside_the_stroke() -> None:
    hexapod = stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3)
    masses = {"platform": 20.0, "lower": 2.0, "upper": 1.5}
    for stroke in ((0.5, 0.8), (0.9, 1.3)):
        made = stp.hexapods.hexapod_inertias(hexapod, **masses, stroke=stroke)
        assert 0.3 * stroke[0] <= np.linalg.norm(made["lower"].lever) <= 0.3 * stroke[1]
    with pytest.raises(InputError, match="beyond the stroke"):
        stp.hexapods.hexapod_inertias(hexapod, **masses, leg_length=2.0, stroke=(0.5, 0.8))


def test_bodies_made_for_another_stroke_are_named() -> None:
    """Without a stroke the cylinders are made for legs of 1.83 m: 1.1 m long, where a leg of 1.05 m has no room."""
    angles = np.radians([[-10, 10, 110, 130, 230, 250], [-50, 50, 70, 170, 190, 290]])
    base, platform = (
        radius * np.column_stack([np.cos(a), np.sin(a), 0 * a])
        for radius, a in zip((0.95, 0.70), angles, strict=True)
    )
    hexapod = stp.Hexapod(base, platform)
    blind = stp.hexapods.hexapod_inertias(hexapod, platform=120.0, lower=18.0, upper=9.0)
    report = stp.hexapod_chain(hexapod, **blind, stroke=(1.05, 1.6)).report
    assert [note.subject for note in report.notes] == ["inertia 'lower'", "inertia 'upper'"]
    assert "reaches 1.097 m along the leg" in str(report) and "the shortest leg has 1.05 m" in str(report)
    strokes: tuple[tuple[float, float], ...] = ((1.05, 1.6), (0.6, 2.2), (1.2, 2.0))
    for stroke in strokes:
        told = stp.hexapods.hexapod_inertias(hexapod, platform=120.0, lower=18.0, upper=9.0, stroke=stroke)
        assert stp.hexapod_chain(hexapod, **told, stroke=stroke).report.notes == ()
    assert stp.hexapod_chain(hexapod, **blind).report.notes == ()
