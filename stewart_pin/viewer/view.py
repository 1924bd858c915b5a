"""Open a robot in the browser, from Python, from a notebook cell or from the command line."""

from __future__ import annotations

import html
import time
import webbrowser
from typing import Any

from stewart_pin.errors import InputError
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_chain
from stewart_pin.viewer.page import Page
from stewart_pin.viewer.recording import Motion, record
from stewart_pin.viewer.server import LOOPBACK, start_server, stop_server


class Viewer:
    """A robot in a page, until it is closed; made by `view`.

    Parameters
    ----------
    page
        Controls and picture.
    host, port
        Where it listens.
    """

    def __init__(self, page: Page, host: str, port: int) -> None:
        self.page, self._host, self._port = page, host, port

    @property
    def url(self) -> str:
        """Address of the page."""
        shown = LOOPBACK if self._host in ("", "0.0.0.0", "::") else self._host
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{self._port}"

    @property
    def chain(self) -> ClosedChain:
        """The robot shown."""
        return self.page.chain

    @property
    def state(self) -> State:
        """Where it stands, a state of the caller's own: one thread at a time may ask it."""
        shown = self.page.shown.state
        return State(shown.chain, shown.q, shown.v)

    def wait(self) -> None:
        """Serve the page until Ctrl-C."""
        while True:
            time.sleep(3600)

    def close(self) -> None:
        """End the page and its server."""
        self.page.end()
        stop_server(self.page.server)

    def __enter__(self) -> Viewer:
        """Serve the page until the block is left."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Close it."""
        self.close()

    def __repr__(self) -> str:
        return f"<Viewer of {self.chain.name!r} at {self.url}>"

    def _repr_html_(self) -> str:
        """Show the page inside a notebook."""
        return f'<iframe src="{html.escape(self.url)}" width="100%" height="600" style="border: 0"></iframe>'


def view(
    chain: ClosedChain | None = None,
    *,
    motion: Motion | None = None,
    host: str = LOOPBACK,
    port: int | None = None,
    browser: bool = False,
) -> Viewer:
    """Show a robot in the browser, to be moved by hand.

    Platform (gizmo and sliders, of the freedoms that it has), motors and passive joints are dragged; loops stay closed,
    and what cannot be met, or would pass a limit, leaves the robot where it is and says why. Beside it stand motor
    positions, efforts at rest, strokes left, condition and distance to singularities.

    Parameters
    ----------
    chain
        Closed chain; default: the bundled robots, in a menu.
    motion
        What to play: a motion of the platform (as from `sinusoidal_motion` or `earthquake_motion`), a `MotorDemand`, or
        a `Simulation`; with time, speed, rates and efforts of the motion.
    host
        Address to listen on. Default: this machine alone; another one lets anybody who reaches it steer the robot.
    port
        Port; default: one that is free.
    browser
        Whether to open the page in a browser.

    Returns
    -------
    Viewer
        With its address; the last value of a notebook cell shows the page there. It serves until it is closed or the
        process ends.

    Raises
    ------
    MissingExtraError
        If viser or yourdfpy is not installed.
    ClosureError
        If the chain cannot follow the motion.
    InputError
        If the motion is none, or one of another chain, the port is taken, or the address cannot be had.
    """
    if chain is not None:
        as_chain(chain)
    elif motion is not None:
        raise InputError("motion is one of a chain; pass view(chain, motion=motion)")
    recording = None if chain is None or motion is None else record(chain, motion)
    server = start_server(host, port)
    try:
        viewer = Viewer(Page(server, chain, recording), host, server.get_port())
    except BaseException:
        stop_server(server)
        raise
    if browser:
        webbrowser.open(viewer.url)
    return viewer
