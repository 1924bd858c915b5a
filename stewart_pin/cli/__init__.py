"""Command line: every command writes with --json what it printed.

Its start has a clear message where packages are missing, and one line for every typed error.
"""

from __future__ import annotations

import sys

from stewart_pin.errors import MissingExtraError, StewartPinError


def main() -> None:
    """Run the command line.

    Bad input ends in one readable line on standard error and exit code 2.
    """
    try:
        _run()
    except StewartPinError as error:
        sys.stderr.write(f"error: {error}\n")
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        raise SystemExit(130) from None


def _run() -> None:
    try:
        from stewart_pin.cli.app import app  # noqa: PLC0415 - needs the extra "cli"
    except ImportError as error:
        raise MissingExtraError(error.name or "typer", "cli") from None
    app()
