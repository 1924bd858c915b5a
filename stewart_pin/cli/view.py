"""``view``: a robot in the browser, to be moved by hand, until Ctrl-C."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stewart_pin.building.loading import load
from stewart_pin.cli.output import console
from stewart_pin.viewer.server import LOOPBACK, is_loopback
from stewart_pin.viewer.view import view as open_view


def view(
    robot: Annotated[
        str | None, typer.Argument(help="Bundled robot or file; default: the bundled robots, in a menu.")
    ] = None,
    loops: Annotated[Path | None, typer.Option(help="File beside a URDF that declares its loops.")] = None,
    motors: Annotated[
        str | None, typer.Option(help="Motor joints, separated by commas; default: those of the file.")
    ] = None,
    platform: Annotated[str | None, typer.Option(help="Name of the platform link.")] = None,
    port: Annotated[int | None, typer.Option(help="Port; default: one that is free.")] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; others than this machine's own are told.")
    ] = (LOOPBACK),
    browser: Annotated[bool, typer.Option(help="Whether to open the page in a browser.")] = True,
) -> None:
    """Show a robot in the browser: drag its platform, motors and joints; ends on Ctrl-C."""
    named = None if motors is None else [name.strip() for name in motors.split(",")]
    chain = None if robot is None else load(robot, loops=loops, motors=named, platform=platform)
    with open_view(chain, host=host, port=port, browser=browser) as viewer:
        console.print(viewer.url, highlight=False, soft_wrap=True)
        if not is_loopback(host):
            console.print(
                f"anybody who reaches {host or 'this machine'} can look at this page and steer the robot",
                highlight=False,
                soft_wrap=True,
            )
        console.print("Ctrl-C ends it", highlight=False)
        viewer.wait()
