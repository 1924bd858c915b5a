"""The command line in this process: starting a new one takes longer than most commands."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from unittest.mock import patch

from stewart_pin.cli import main


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run one command and collect what a shell would see of it."""
    code, out, err = 0, io.StringIO(), io.StringIO()
    command = ["stewart_pin", *arguments]
    with patch.object(sys, "argv", command), redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    return subprocess.CompletedProcess(command, code, out.getvalue(), err.getvalue())
