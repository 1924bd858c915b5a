"""The picture of a chain shows every body, joint and loop where it stands."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.model.description import JointKind
from tests.cable_robots import cables_8
from tests.closed_states import robot
from tests.mechanisms import two_bodies
from tests.zoo.table import ROBOTS


def lines(figure, label: str) -> list[np.ndarray]:
    return [np.array(line.get_data_3d()).T for line in figure.axes[0].lines if line.get_label() == label]


def test_a_four_bar_has_its_lengths() -> None:
    figure = stp.viz.plot_chain(robot("four_bar"))
    spans = [max(np.linalg.norm(body - end, axis=1).max() for end in body) for body in lines(figure, "body")]
    np.testing.assert_allclose(sorted(spans), [0.04, 0.08, 0.12], atol=1e-12)
    (ground,) = lines(figure, "ground")
    np.testing.assert_allclose(np.ptp(ground, axis=0), [0.1, 0, 0], atol=1e-15)
    assert (len(lines(figure, "motor")), len(lines(figure, "joint")), len(lines(figure, "loop"))) == (1, 2, 1)


def test_a_hexapod_shows_its_leg_ends() -> None:
    chain = robot("stewart")
    figure = stp.viz.plot_chain(chain)
    hexapod = stp.Hexapod.from_chain(chain)
    (platform,) = lines(figure, "platform")
    tops = hexapod.platform_points + [0, 0, 1.0]
    apart = np.linalg.norm(platform[:, None] - tops[None], axis=2)
    assert apart.min(axis=1).max() < 1e-12 and apart.min(axis=0).max() < 1e-12
    motors = np.array([line[0] for line in lines(figure, "motor")])
    np.testing.assert_allclose(motors, (hexapod.base_points + tops) / 2, atol=1e-12)


def test_open_loops_show(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    for q, gap in (
        (chain.q_home, 0.0),
        (pin.integrate(chain.model, chain.q_home, 0.1 * rng.normal(size=24)), None),
    ):
        ends = [line[1] - line[0] for line in lines(stp.viz.plot_chain(chain, q), "loop")]
        expected = np.linalg.norm(stp.loop_gap(chain, q).reshape(6, 3), axis=1)
        np.testing.assert_allclose(np.linalg.norm(ends, axis=1), expected, atol=1e-14)
        assert gap is not None or expected.min() > 1e-3


def test_cables_run_over_their_pulleys() -> None:
    chain = cables_8()
    shown = lines(stp.viz.plot_chain(chain), "cable")
    lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in shown]
    # An arc of at most half a turn in eleven chords is a hundredth shorter, of 0.05 m.
    np.testing.assert_allclose(lengths, stp.cables.cable_lengths(chain, chain.q_home), atol=1e-3)
    for line, loop in zip(shown, chain.loops, strict=True):
        np.testing.assert_allclose(line[0], loop.placement1.translation, atol=1e-12)
        along = np.diff(line[-3:], axis=0)
        bend = along / np.linalg.norm(along, axis=1)[:, None]
        assert bend[0] @ bend[1] > 0.95  # the free cable goes on where the arc ends


def test_any_chain_can_be_drawn(rng: np.random.Generator) -> None:
    for name in ROBOTS:
        assert stp.viz.plot_chain(robot(name)).axes[0].get_title() == name
    stp.viz.plot_chain(two_bodies(JointKind.DISTANCE, rng))


@pytest.mark.parametrize("name", ["agile_eye", "spherical_4r"])
def test_a_linkage_about_one_point_is_drawn_out_along_its_axes(name: str) -> None:
    """All joints stand at one point: every hinge is marked one robot size from there, on its axis."""
    chain = robot(name)
    size = chain.length_scale
    figure = stp.viz.plot_chain(chain)
    for label in ("motor", "joint", "loop"):
        marks = np.array([line[0] for line in lines(figure, label)])
        np.testing.assert_allclose(np.linalg.norm(marks, axis=1), size, rtol=1e-9)
    bodies = lines(figure, "body")
    assert len(bodies) > 1 and all(np.ptp(body, axis=0).max() > 0.1 * size for body in bodies)


def test_a_wrong_configuration_is_refused() -> None:
    with pytest.raises(InputError, match=r"q must have shape \(24,\)|q must have shape"):
        stp.viz.plot_chain(robot("stewart"), [0.0])
