"""The page without a browser: demands, and what is shown of them."""

from __future__ import annotations

import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.viewer.steering import Step, move_joint, move_platform
from stewart_pin.viz.scene import link_placements
from tests.cable_robots import cables_8
from tests.small_urdf import ARM, MOTOR, home, joint
from tests.small_urdf import robot as robot_text

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
    page.ask("platform vz", lambda: page._to_coordinate("platform vz"))
    page.ask("platform vx", lambda: page._to_coordinate("platform vx"))
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


def test_cables_follow_and_take_the_colours_of_their_winches():
    chain = cables_8()
    with stp.view(chain) as viewer:
        page = viewer.page
        before = np.array(page._picture._cables["cable5"].points)
        page.ask("button", lambda: page._go("somewhere random"))
        assert page.settle()
        assert page._message.content == "", page._message.content
        cable = page._picture._cables["cable5"]
        frame = link_placements(chain, viewer.state.q)["platform"]
        end = frame.act(np.array(chain.loops[4].placement2.translation))
        np.testing.assert_allclose(cable.points[-1, 1], end, atol=1e-6)  # the page holds single precision
        assert np.abs(before[-1, 1] - end).max() > 1e-3
        assert len(np.unique(np.array(cable.colors).reshape(-1, 3), axis=0)) == 1


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
    page.ask("platform vx", lambda: page._to_coordinate("platform vx"))
    assert page.settle()
    np.testing.assert_array_equal(viewer.state.q, viewer.chain.q_home)
    assert "value of the slider" in page._message.content
    with stp.view() as other:
        path = tmp_path / "robot.urdf"
        stp.write_urdf(stp.load("delta"), path)
        other.page.ask("robot", lambda: other.page._load(str(path)))
        assert other.page.settle()
        assert other.chain.name == "stewart"


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(
    "limits", [(0.12345, 0.12345), (0.0, 0.0), (0.123451, 0.1234512), (1000.12345, 1000.12346), (-1e30, 1e30)]
)
def test_limits_of_any_width_have_a_slider(kind: str, limits: tuple[float, float], tmp_path: Path):
    low, high = limits
    middle = (low + high) / 2
    file = tmp_path / "stiff.urdf"
    limit = f'<limit lower="{low!r}" upper="{high!r}" effort="1" velocity="1"/>'
    first = joint("first", "base", "arm", kind, attributes=MOTOR, content=limit)
    file.write_text(robot_text(*ARM[:3], first, ARM[4], home(first=repr(middle))))
    with stp.view(stp.load(file)) as viewer:
        slider, grip = viewer.page._sliders["joint first"]
        unit = 1.0 if grip.is_length else 180 / np.pi
        assert slider.min < slider.max
        assert slider.value == pytest.approx(middle * unit, rel=1e-12)
        assert slider.disabled == (low == high)


def test_a_slider_of_the_platform_leaves_its_other_coordinates(viewer):
    """Beyond the reach of its slider, too, where that would pull it back."""
    page = viewer.page
    far = pin.SE3(np.eye(3), np.array([0.4, 0.0, 0.9]))
    page.ask("gizmo", lambda: move_platform(page.hand, viewer.state, far))
    assert page.settle()
    assert page._sliders["platform vx"][0].value == pytest.approx(0.4)
    page._sliders["platform vx"][0].value = 0.1  # what it would show if it ended there
    page._sliders["platform vz"][0].value = 0.95
    page.ask("platform vz", lambda: page._to_coordinate("platform vz"))
    assert page.settle()
    np.testing.assert_allclose(viewer.state.pose.translation, [0.4, 0.0, 0.95], atol=1e-9)


def test_whole_turns_are_shown():
    with stp.view(stp.load("arm_3r_spatial")) as viewer:
        page, chain = viewer.page, viewer.chain
        page.ask("test", lambda: Step(stp.State(chain, chain.q_home + np.array([0.0, 4.5, -7.5]))))
        assert page.settle()
        for name, at in zip(chain.motors, viewer.state.q, strict=True):
            assert page._sliders[f"joint {name}"][0].value == pytest.approx(np.degrees(at), rel=1e-12)


def test_a_demand_under_wrenches_is_played_with_its_efforts():
    chain = stp.load("stewart")
    wrenches = {"platform": [0.0, 0.0, -300.0, 0.0, 0.0, 20.0], "leg2_upper": [10.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    demand = stp.motor_demand(chain, motion(chain, 5), wrenches=wrenches)
    with stp.view(chain, motion=demand) as viewer:
        recording = viewer.page._recording
        assert recording is not None
        np.testing.assert_allclose(recording.tau_motor, demand.efforts, rtol=1e-8)


def test_a_page_that_is_closed_lets_go_of_the_gizmo(viewer):
    page = viewer.page
    at = SimpleNamespace(wxyz=[1.0, 0.0, 0.0, 0.0], position=[0.0, 0.0, 1.05])
    page._gizmo.position = np.array(at.position)
    page._on_gizmo(SimpleNamespace(phase="update", client_id=7, target=at))
    assert page.settle()
    page._let_go(SimpleNamespace(client_id=8))
    page.ask("button", lambda: page._go("home"))
    assert page.settle()
    assert page._gizmo.position[2] != pytest.approx(1.0)  # page 7 still has it
    page._let_go(SimpleNamespace(client_id=7))
    page.ask("button", lambda: page._go("home"))
    assert page.settle()
    np.testing.assert_allclose(page._gizmo.position, [0.0, 0.0, 1.0])


def test_closing_ends_a_motion_that_plays():
    chain = stp.load("stewart")
    with stp.view(chain, motion=motion(chain, 7)) as viewer:
        viewer.page._playing.value = True
    assert not viewer.page._player.is_alive()


def test_demands_on_a_robot_end_with_it():
    with stp.view() as viewer:
        page, begun, go_on = viewer.page, threading.Event(), threading.Event()

        def wait() -> None:
            begun.set()
            go_on.wait(5)

        page.ask("first", wait)
        assert begun.wait(5)
        page.ask("robot", lambda: page._load("delta"))
        page.ask("joint leg1", lambda: page._to_joint("joint leg1", "leg1"))
        go_on.set()
        assert page.settle()
        assert viewer.chain.name == "delta"
        assert page._message.content == ""
