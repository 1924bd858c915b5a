"""The page without a browser: demands, and what is shown of them."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.viewer.steering import Step, move_joint

pytest.importorskip("viser", reason="viser is not installed")


@pytest.fixture
def viewer():
    with stp.view(stp.load("stewart")) as viewer:
        yield viewer


def test_home_is_shown_first(viewer):
    np.testing.assert_array_equal(viewer.state.q, viewer.chain.q_home)
    assert "49.99 N" in viewer.page._table.content


def test_controls_follow_a_demand(viewer):
    page = viewer.page
    page.ask("test", lambda: move_joint(page.hand, viewer.state, "leg1", 1.1))
    assert page.settle()
    assert stp.motor_positions(viewer.state)[0] == pytest.approx(1.1, abs=1e-12)
    assert page._sliders["joint leg1"][0].value == pytest.approx(1.1)
    assert page._sliders["platform vz"][0].value == pytest.approx(viewer.state.pose.translation[2])
    np.testing.assert_allclose(page._gizmo.position, viewer.state.pose.translation)
    assert page._message.content == ""


def test_what_cannot_be_met_is_told_and_the_slider_goes_back(viewer):
    page = viewer.page
    page.ask("test", lambda: move_joint(page.hand, viewer.state, "leg1", 2.5))
    assert page.settle()
    np.testing.assert_array_equal(viewer.state.q, viewer.chain.q_home)
    assert "leg1" in page._message.content
    page._sliders["platform vz"][0].value = 1.3
    page.ask("platform vz", page._to_sliders)
    page.ask("platform vx", page._to_sliders)
    assert page.settle()
    assert stp.limits_exceeded(viewer.state) == ()


def test_of_a_slider_in_motion_the_last_demand_counts(viewer):
    page, met, begun, go_on = viewer.page, [], threading.Event(), threading.Event()

    def wait() -> None:
        begun.set()
        go_on.wait(5)

    page.ask("first", wait)
    assert begun.wait(5)
    for k in range(100):
        page.ask("slider", lambda k=k: met.append(k))
    go_on.set()
    assert page.settle()
    assert met == [99]


def test_a_demand_that_fails_leaves_the_page_alive(viewer):
    page = viewer.page

    def fail() -> Step:
        raise RuntimeError("a fault of *ours*")

    page.ask("test", fail)
    assert page.settle()
    assert "RuntimeError" in page._message.content
    page.ask("test", lambda: move_joint(page.hand, viewer.state, "leg1", 1.1))
    assert page.settle()
    assert stp.motor_positions(viewer.state)[0] == pytest.approx(1.1)


def test_another_robot_from_the_menu():
    with stp.view() as viewer:
        page = viewer.page
        assert viewer.chain.name == "stewart"
        page.ask("robot", lambda: page._load("delta"))
        assert page.settle()
        assert viewer.chain.name == "delta"
        assert set(page._sliders) >= {"platform vx", "joint motor1"}
        assert "joint leg1" not in page._sliders


@pytest.mark.parametrize("robot", stp.robots())
@pytest.mark.slow
def test_every_robot_shows(robot):
    with stp.view(stp.load(robot)) as viewer:
        page = viewer.page
        for _ in range(3):
            page.ask("button", lambda: page._go("somewhere random"))
            assert page.settle()
            assert page._message.content == "", page._message.content
        assert np.abs(stp.loop_gap(viewer.chain, viewer.state.q)).max(initial=0.0) < 1e-9


def motion(chain: stp.ClosedChain, count: int = 40) -> stp.motions.PlatformSamples:
    return stp.motions.sinusoidal_motion(
        np.linspace(0.0, 1.0, count),
        home=stp.platform_pose(chain, chain.q_home),
    )


def test_a_motion_is_played_with_its_efforts():
    chain = stp.load("stewart")
    samples = motion(chain)
    demand = stp.motor_demand(chain, samples)
    with stp.view(chain, motion=samples) as viewer:
        page = viewer.page
        page.ask("time", lambda: page._at(samples.time[13] + 1e-4))
        assert page.settle()
        np.testing.assert_allclose(viewer.state.pose.translation, samples.position[13], atol=1e-10)
        shown = page.shown.readings
        np.testing.assert_allclose([motor.effort for motor in shown.motors], demand.efforts[13], rtol=1e-9)
        np.testing.assert_allclose([motor.rate for motor in shown.motors], demand.rates[13], atol=1e-9)
        assert "rate" in page._table.content
        page._speed.value = "5 ×"
        page._again.value = False
        page._playing.value = True
        for _ in range(100):
            if not page._playing.value:
                break
            threading.Event().wait(0.1)
        assert not page._playing.value
        assert page.settle()
        np.testing.assert_allclose(viewer.state.pose.translation, samples.position[-1], atol=1e-9)


def test_a_simulation_is_played():
    chain = stp.load("four_bar")
    run = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.05, dt=1e-3)
    with stp.view(chain, motion=run) as viewer:
        page = viewer.page
        page.ask("time", lambda: page._at(0.05))
        assert page.settle()
        np.testing.assert_array_equal(viewer.state.q, run.q[-1])
    with pytest.raises(stp.errors.InputError, match="pass view"):
        stp.view(stp.load("stewart"), motion=run)
    with pytest.raises(stp.errors.InputError, match="got list"):
        stp.view(chain, motion=[1, 2])  # type: ignore[arg-type]
    with pytest.raises(stp.errors.InputError, match="of a chain"):
        stp.view(motion=run)


def test_what_a_page_sends_is_not_trusted(viewer, tmp_path):
    page = viewer.page
    page._sliders["platform vx"][0].value = float("nan")
    page.ask("platform vx", page._to_sliders)
    assert page.settle()
    np.testing.assert_array_equal(viewer.state.q, viewer.chain.q_home)
    assert "values of the sliders" in page._message.content
    with stp.view() as other:
        path = tmp_path / "robot.urdf"
        stp.write_urdf(stp.load("delta"), path)
        other.page.ask("robot", lambda: other.page._load(str(path)))
        assert other.page.settle()
        assert other.chain.name == "stewart"
