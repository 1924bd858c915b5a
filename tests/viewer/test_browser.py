"""The page in a real browser: sliders, buttons, the gizmo, two clients, a page loaded again."""

from __future__ import annotations

import io
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp

pytest.importorskip("viser", reason="viser is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed"),
]
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--disable-quic"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
_INPUTS = 60
"""Random inputs in a row."""
SIZE = {"width": 1200, "height": 800}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def viewer() -> Iterator[Any]:
    with stp.view() as viewer:
        yield viewer


@pytest.fixture(scope="module")
def opened_once(browser: Any, viewer: Any) -> Any:
    return opened(browser, viewer)


@pytest.fixture
def page(opened_once: Any, viewer: Any) -> Any:
    """Put the robot of the module's one page at home: to load one takes seconds without a graphics card."""
    viewer.page.ask("test", lambda: viewer.page._go("home"))
    assert viewer.page.settle()
    return opened_once


def opened(browser: Any, viewer: Any) -> Any:
    """Open the page and wait for its controls, at a fixed resolution so that equal states give equal pictures."""
    page = browser.new_page(viewport=SIZE)
    page.goto(f"{viewer.url}/?fixedDpr=1")
    page.wait_for_selector("[role=slider]", timeout=120_000)
    page.get_by_text("effort at rest").wait_for(timeout=120_000)
    # A notice that WebGL is computed in software covers a part of the picture.
    notice = page.get_by_text("Software WebGL rendering")
    try:
        notice.wait_for(timeout=4000)
        page.locator(".mantine-Notification-closeButton").first.click()
        notice.wait_for(state="hidden", timeout=4000)
    except playwright.TimeoutError:
        pass
    return page


def until(holds: Callable[[], bool], seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if holds():
            return True
        time.sleep(0.05)
    return False


def box(page: Any, label: str) -> Any:
    """Find the number box beside a slider."""
    row = page.get_by_text(label, exact=True).locator("xpath=ancestor::*[.//input][1]")
    return row.locator("input").last


def typed(page: Any, label: str, value: float) -> None:
    field = box(page, label)
    field.click()
    field.press("Control+a")
    field.press_sequentially(str(value))
    field.press("Enter")


def pixels(page: Any) -> np.ndarray:
    """Take a picture of the scene, left of the controls."""
    from PIL import Image

    picture = Image.open(io.BytesIO(page.screenshot(clip={"x": 0, "y": 0, "width": 780, "height": 800})))
    return np.asarray(picture.convert("RGB"), dtype=int)


def changed(before: np.ndarray, after: np.ndarray) -> int:
    return int(np.count_nonzero(np.abs(before - after).max(axis=2) > 12))


def test_a_slider_moves_the_platform_and_the_picture(page, viewer):
    before = pixels(page)
    typed(page, "z [m]", 1.1)
    assert until(lambda: abs(viewer.state.pose.translation[2] - 1.1) < 1e-9)
    time.sleep(1)
    assert changed(before, pixels(page)) > 2000
    assert "49.99 N" not in page.content()
    typed(page, "roll [°]", 10)
    assert until(lambda: abs(viewer.state.pose.rotation[2, 1] - np.sin(np.radians(10))) < 1e-9)


def test_motors_and_home(page, viewer):
    typed(page, "leg1 [m]", 1.1)
    assert until(lambda: abs(stp.motor_positions(viewer.state)[0] - 1.1) < 1e-9)
    page.get_by_text("home", exact=True).click()
    assert until(lambda: np.array_equal(viewer.state.q, viewer.chain.q_home))
    page.get_by_text("somewhere random", exact=True).click()
    assert until(lambda: not np.array_equal(viewer.state.q, viewer.chain.q_home))
    assert stp.limits_exceeded(viewer.state) == ()


def test_out_of_reach_is_held_and_told(page, viewer):
    typed(page, "leg1 [m]", 1.8)  # alone: the other legs do not let the platform go so far
    page.get_by_text("Held here:").wait_for(timeout=60_000)
    assert "leg1" in page.get_by_text("Held here:").locator("xpath=..").inner_text()
    assert viewer.page.settle()
    held = stp.motor_positions(viewer.state)[0]  # at home, or at the "1" of "1.8"
    assert held < 1.1
    assert np.abs(stp.loop_gap(viewer.chain, viewer.state.q)).max() < 1e-10
    assert until(lambda: abs(float(box(page, "leg1 [m]").input_value()) - held) < 1e-3)


def test_two_clients_see_one_robot_and_a_reload_keeps_it(browser, page, viewer):
    two = opened(browser, viewer)
    page.bring_to_front()  # a browser lets pages in the background rest
    typed(page, "z [m]", 1.08)
    assert until(lambda: abs(viewer.state.pose.translation[2] - 1.08) < 1e-9)
    two.bring_to_front()
    assert until(lambda: float(box(two, "z [m]").input_value()) == 1.08)
    two.reload()
    two.wait_for_selector("[role=slider]", timeout=120_000)
    assert until(lambda: float(box(two, "z [m]").input_value()) == 1.08)
    assert abs(viewer.state.pose.translation[2] - 1.08) < 1e-9
    two.close()
    page.bring_to_front()


def test_the_gizmo_drags_the_platform(page, viewer):
    before = viewer.state.pose.translation.copy()
    # The blue arrow up from the platform's origin, in the middle of the picture of home.
    at = _blue_arrow(page)
    page.mouse.move(*at)
    page.mouse.down()
    for k in range(1, 16):
        page.mouse.move(at[0], at[1] - 3 * k)
        time.sleep(0.03)
    page.mouse.up()
    assert until(lambda: viewer.state.pose.translation[2] > before[2] + 0.01)
    np.testing.assert_allclose(viewer.state.pose.translation[:2], before[:2], atol=1e-6)
    assert np.abs(stp.loop_gap(viewer.chain, viewer.state.q)).max() < 1e-10


def _blue_arrow(page: Any) -> tuple[float, float]:
    """Find the head of the arrow along z: the highest patch of its blue."""
    image = pixels(page)
    red, green, blue = image[:, :, 0], image[:, :, 1], image[:, :, 2]
    rows, columns = np.nonzero((blue > 200) & (red < 90) & (green > 100) & (green < 170))
    top = rows.min()
    near = rows < top + 12
    return float(columns[near].mean()), float(rows[near].mean())


def test_random_input_never_opens_a_loop(page, viewer, rng):
    labels = ["x [m]", "y [m]", "z [m]", "roll [°]", "pitch [°]", "yaw [°]"]
    labels += [f"leg{k} [m]" for k in range(1, 7)]
    for count in range(_INPUTS):
        label = labels[rng.integers(len(labels))]
        low, high = {"m": (-0.3, 0.3), "°": (-57.0, 57.0)}[label[-2]]
        low, high = (
            (0.7, 1.3) if label.startswith("z") else (0.5, 1.8) if label.startswith("leg") else (low, high)
        )
        typed(page, label, round(float(rng.uniform(low, high)), 3))
        if count % 10 == 9:
            assert viewer.page.settle()
            assert stp.limits_exceeded(viewer.state) == ()
            assert np.abs(stp.loop_gap(viewer.chain, viewer.state.q)).max() < 1e-10


def test_screenshot(page, viewer, tmp_path: Path):
    typed(page, "roll [°]", 12)
    typed(page, "x [m]", 0.12)
    assert viewer.page.settle()
    time.sleep(2)
    path = Path(os.environ.get("STEWART_PIN_SCREENSHOT", tmp_path / "viewer.png"))
    page.screenshot(path=path)
    assert path.stat().st_size > 40_000


def test_other_robots_from_the_menu_are_drawn(page, viewer):
    for robot in ("delta", "five_bar", "agile_eye"):
        viewer.page.ask("robot", lambda robot=robot: viewer.page._load(robot))
        assert viewer.page.settle()
        page.get_by_text("Platform 'platform'").wait_for(timeout=120_000)
        time.sleep(2)
        with_it = pixels(page)
        viewer.page._picture._root.visible = False
        time.sleep(1)
        assert changed(with_it, pixels(page)) > 400, robot
