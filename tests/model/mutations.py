"""Damaged robot files: one mutator for every dialect, and the promise that each of them is answered in words."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import stewart_pin as stp
from stewart_pin.errors import StewartPinError

hypothesis = pytest.importorskip("hypothesis")
st = hypothesis.strategies

# Values that are at home in robot files, and values that are not.
VALUES = (
    "", "0", "-1", "1e30", "1e400", "nan", "0 0", "0 0 0", "1 2 3", "0 0 0 0 0 0 0", "1e-9 0 1e9", "base",
    "world", "platform", "floating", "fixed", "distance", "ball", "true", "\u0663", "x" * 300,
)  # fmt: skip
ACTIONS = ("value", "borrow", "text", "delete", "duplicate", "move", "rename", "forget")


def quick(max_examples: int = 60):
    """Return the settings of a bounded run, the same every time."""
    return hypothesis.settings(
        max_examples=max_examples,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture],
    )


def damaged(root: etree._Element):
    """Return a strategy of damaged copies of a file, as bytes: one to three changes of any kind, anywhere."""
    size = len(list(root.iter(etree.Element)))
    step = st.tuples(
        st.sampled_from(ACTIONS),
        st.integers(0, size - 1),
        st.integers(0, size - 1),
        st.integers(0, 3),
        st.sampled_from(VALUES),
    )
    return st.lists(step, min_size=1, max_size=3).map(lambda steps: _apply(root, steps))


def _apply(root: etree._Element, steps: list) -> bytes:
    root = copy.deepcopy(root)
    for step in steps:
        change(root, *step)
    return etree.tostring(root)


def change(root: etree._Element, action: str, number: int, other: int, attribute: int, value: str) -> None:
    """Damage an element in place: its values, its text, its tag, its presence or its place."""
    elements = list(root.iter(etree.Element))
    element, model = elements[number % len(elements)], elements[other % len(elements)]
    parent = element.getparent()
    names = list(element.attrib)
    if action == "value" and names:
        element.set(names[attribute % len(names)], value)
    elif action == "borrow" and names and model.attrib:
        element.set(names[attribute % len(names)], list(model.attrib.values())[-1])
    elif action == "forget" and names:
        del element.attrib[names[attribute % len(names)]]
    elif action == "text":
        element.text = value
    elif parent is None:
        return
    elif action == "delete":
        parent.remove(element)
    elif action == "duplicate":
        parent.append(copy.deepcopy(element))
    elif action == "move":
        root.append(element)
    elif action == "rename":
        # Tags of the same file: the wrong word in the right language.
        element.tag = model.tag


def assert_loads_or_says_why(path: Path, **options) -> None:
    """Load a file: a chain that closes at home, or one of our errors; never anything else."""
    try:
        chain = stp.load(path, **options)
    except StewartPinError as error:
        assert str(error)
        return
    assert np.isfinite(chain.q_home).all()
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max(initial=0.0) < 1e-9 * chain.length_scale
