"""How many times a second the page of the viewer follows a hand: closure, efforts, singularities, and what is sent.

``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m tests.benchmarks.viewer`` leads platform, or motors, of some robots
back and forth, one demand after the other, and prints medians. Where Playwright and Chromium are installed, one page is
open meanwhile, and the updates that arrive there are counted as well.
"""

from __future__ import annotations

import shutil
import statistics
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.viewer.page import Page
from stewart_pin.viewer.steering import Step, move_joint, move_platform

SECONDS = 8.0
FLAGS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader"]
COUNTING = """
window.updates = 0; window.last = '';
const look = () => {
  const told = Array.from(document.querySelectorAll('td')).map(cell => cell.textContent).join();
  if (told !== window.last) { window.last = told; window.updates += 1; }
  requestAnimationFrame(look);
};
look();
"""
"""Counts the frames of the browser on which the table has changed."""


def cassie() -> stp.ClosedChain | None:
    """Cassie as example-robot-data ships it, both legs."""
    from stewart_pin.building.loading import find_robot

    for name in ("cassie_v2.sdf", "cassie.sdf"):
        for folder in Path(pin.__file__).parents:
            found = (
                sorted(folder.glob(f"**/cassie_description/robots/{name}"))
                if folder.name == "cmeel.prefix"
                else []
            )
            if found:
                return stp.load(find_robot(str(found[0])))
    return None


@contextmanager
def opened(url: str):
    """Yield a page of Chromium, or None."""
    chromium = shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        chromium = None
    if chromium is None:
        yield None
        return
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport={"width": 900, "height": 600})
        page.goto(f"{url}/?fixedDpr=1")
        page.wait_for_selector("[role=slider]", timeout=120_000)
        time.sleep(3)
        yield page
        browser.close()


def led(page: Page, phase: float) -> Step:
    """Lead the platform up or down, or else a motor back or forth."""
    chain, home = page.chain, page.chain.home_state()
    if chain.platform is not None:
        shift = 0.05 * chain.length_scale * np.sin(phase)
        aim = pin.SE3(home.pose.rotation, home.pose.translation + [0.0, 0.0, shift])
        return move_platform(page.hand, page.shown.state, aim)
    grip = (page.hand.motors or page.hand.joints)[0]
    joint = chain.model.joints[chain.model.getJointId(grip.name)]
    return move_joint(page.hand, page.shown.state, grip.name, home.q[joint.idx_q] + 0.05 * np.sin(phase))


def measured(chain: stp.ClosedChain) -> tuple[float, float, float]:
    """Count updates a second here, with their median [ms], and those that a browser has shown."""
    with stp.view(chain) as viewer, opened(viewer.url) as browser:
        if browser is not None:
            browser.evaluate(COUNTING)
        begin, times = time.perf_counter(), []
        while time.perf_counter() - begin < SECONDS:
            before = time.perf_counter()
            phase = 2 * np.pi * (before - begin) / 4
            viewer.page.ask("hand", lambda phase=phase: led(viewer.page, phase))
            viewer.page.settle(60)
            times.append(time.perf_counter() - before)
        lasted = time.perf_counter() - begin
        shown = float("nan") if browser is None else browser.evaluate("window.updates") / lasted
        return len(times) / lasted, 1e3 * statistics.median(times), shown


def main() -> None:
    """Print the table."""
    print(f"{'robot':12} {'updates/s here':>15} {'median ms':>10} {'updates/s in the browser':>25}")
    two_legs = cassie()
    chains = [stp.load(name) for name in ("stewart", "delta", "hexapod_rss")]
    for chain in [*chains, *([two_legs] if two_legs is not None else [])]:
        here, median, shown = measured(chain)
        print(f"{chain.name:12} {here:15.0f} {median:10.1f} {shown:25.0f}", flush=True)


if __name__ == "__main__":
    main()
