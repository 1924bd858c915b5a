"""The commands."""

from __future__ import annotations

import typer

from stewart_pin.cli.capability import capability, singularity
from stewart_pin.cli.inspect import inspect
from stewart_pin.cli.modes import modes
from stewart_pin.cli.simulate import shake, simulate
from stewart_pin.cli.sweep import compare, sweep
from stewart_pin.cli.view import view

app = typer.Typer(
    name="stewart_pin",
    help="Closed-chain (parallel-robot) dynamics on Pinocchio.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (compare, inspect, modes, capability, singularity, simulate, shake, sweep, view):
    app.command()(command)
