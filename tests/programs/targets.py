"""Machines whose code this one can run."""

from __future__ import annotations

import pytest

from stewart_pin.programs.llvm.machine_code import Target, host_target, narrow_target

pytest.importorskip("llvmlite")


def _targets() -> dict[str, Target]:
    host = host_target()
    found = {"host": host}
    if host.triple.startswith("x86_64"):  # code for narrower registers runs as well
        found |= {f"{8 * n} bits": narrow_target(n) for n in (16, 32, 64) if n <= host.vector_bytes}
    return found


TARGETS = _targets()
