"""The front door: few names at the top, the others once, by topic, and nothing loaded before it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import stewart_pin as stp
from tests.public_names import namespaces, public


def test_the_top_holds_what_a_first_hour_needs() -> None:
    names = set(dir(stp)) - set(namespaces())
    assert len(names) <= 60
    assert {"load", "inverse_dynamics", "simulate", "ClosedChain"} <= names
    assert {"hexapods", "polytopes", "singularities", "viz", "errors"} <= set(namespaces())


def test_every_name_stands_once() -> None:
    ends = [name.rsplit(".", 1)[-1] for name in public()]
    assert len(ends) > 180
    assert sorted({name for name in ends if ends.count(name) > 1}) == []
    objects = [
        id(value) for name, value in public().items() if callable(value) and not name.startswith("errors.")
    ]
    assert len(objects) == len(set(objects))


def test_importing_loads_nothing_but_the_door() -> None:
    heavy = "{'pinocchio', 'scipy', 'numpy', 'matplotlib', 'casadi', 'stewart_pin.hexapods'}"
    looks = f"print(sorted({heavy} & set(sys.modules))); stp.load; print('pinocchio' in sys.modules)"
    code = f"import sys, stewart_pin as stp; {looks}"
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert answer.stdout.split("\n")[:2] == ["[]", "True"]


def test_a_name_that_does_not_exist_is_said() -> None:
    with pytest.raises(AttributeError, match="no_such_verb"):
        _ = stp.no_such_verb  # pyright: ignore[reportAttributeAccessIssue]
