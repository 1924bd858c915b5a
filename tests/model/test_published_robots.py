"""URDF files as they are published: every one is read, and what else they hold is said."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest

from stewart_pin.errors import MechanismError
from stewart_pin.model.formats.reading import read_mechanism
from stewart_pin.model.validation import validate


def published() -> list[Path]:
    """List the URDF files of example-robot-data (extra ``robots``)."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        return []
    return sorted(Path(str(f.locate())) for f in files if f.suffix == ".urdf")


@pytest.mark.slow
def test_every_published_urdf_is_read() -> None:
    files = published()
    if not files:
        pytest.skip("needs example-robot-data: pip install 'stewart_pin[robots]'")
    couplings, faults = 0, []
    for path in files:
        mechanism = read_mechanism(path)
        couplings += len(mechanism.couplings)
        try:
            validate(mechanism)
        except MechanismError as error:
            faults.append(str(error))
    assert couplings > 40  # hands and grippers: <mimic>, and plugins of Gazebo
    # Nothing but masses that no body has, and files of which xacro has to make robots first.
    assert all(
        any(w in fault for w in ("principal moment", "but no mass", "has no <link>")) for fault in faults
    )
