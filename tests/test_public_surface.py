"""The front door: few names at the top, the others once, by topic, and nothing loaded before it is used."""

from __future__ import annotations

import contextlib
import io
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.brief import brief
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


def test_a_first_script_runs() -> None:
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        runpy.run_path(str(Path(__file__).parent / "typed" / "user_script.py"))
    assert "stewart: 20 links" in printed.getvalue()


@pytest.mark.parametrize("name", stp.robots())
def test_a_chain_tells_what_it_is(name: str) -> None:
    chain = stp.load(name)
    told = str(chain).splitlines()
    assert len(told) <= 30 and max(map(len, told)) <= 110
    assert told[0].startswith(f"{name}: ") and told[1].startswith(f"freedoms: {chain.generic.count.dof}")
    assert all(motor in str(chain) for motor in chain.motors)
    last = chain.model.joints[len(chain.model.joints) - 1]
    entry = f"{last.idx_q}-{last.idx_q + last.nq - 1}" if last.nq > 1 else f"{last.idx_q}"
    assert f"{entry} {chain.model.names[chain.model.njoints - 1]}" in " ".join(told)
    assert len(repr(chain)) < 120


def test_records_print_in_a_few_lines() -> None:
    chain = stp.load("stewart")
    run = stp.simulate(chain, chain.q_home, chain.rest, duration=0.3)
    records = [run, chain.limits, chain.mechanism, stp.mobility(chain), run.platform, run.final_state]
    records += [stp.motor_demand(chain, run.platform), stp.linearise(chain, chain.q_home)]
    records += [stp.compile_kernels(chain, engine="numpy"), stp.close_loops(chain, chain.q_home)]
    for record in records:
        assert len(repr(record)) < 1500 and "\n" not in repr(record), type(record)
    assert "time=<301: 0 to 0.3>" in repr(run) and "success=True" in repr(run)
    assert brief(np.array([1.0, np.nan, *range(20)])) == "<22: 0 to 19, 1 not finite>"
    assert brief(tuple(range(20))) == "(0, 1, 2, 3, 4, 5, 6, 7, ... 12 more)"
