"""No public verb that takes a chain is forgotten by the retellings: each is asked, or its exception has a reason."""

from __future__ import annotations

import inspect
import re

import pytest

from tests.public_names import public
from tests.retelling.verbs.everything import VERBS

EXCEPTIONS = {
    "cables.cable_lengths": "no bundled robot has cables; tests/mechanics/test_cables.py asks their verbs",
    "loops.constraint_models": "Pinocchio's own models of the loops, which forward dynamics is asked through",
    "build.displace_geometry": "displaces along the axes of links, which a telling turns",
    "build.geometry_parameters": "names the axes of links, which a telling turns",
    "view": "a page in the browser",
    "viz.build_scene": "a picture",
    "viz.plot_chain": "a picture",
    "viz.plot_mode_shapes": "a picture",
    "viz.plot_scene": "a picture",
    "viz.plot_singularity_map": "a picture",
}


def takes_a_chain(value: object) -> bool:
    """Tell whether the first parameter is a chain or a state."""
    if not callable(value):
        return False
    try:
        parameters = list(inspect.signature(value).parameters.values())
    except (TypeError, ValueError):
        return False
    return bool(parameters) and bool(re.search(r"\b(ClosedChain|State)\b", str(parameters[0].annotation)))


def verbs() -> dict[str, object]:
    """Find public verbs that take a chain; where one stands under several names, the first."""
    found: dict[str, object] = {}
    for name, value in public().items():
        if takes_a_chain(value) and value not in found.values():
            found[name] = value
    return found


def test_the_search_finds_verbs() -> None:
    assert {"inverse_dynamics", "motor_demand", "assembly_modes", "State", "viz.plot_chain"} <= set(verbs())
    assert "leg_lengths" not in verbs()


@pytest.mark.parametrize("name", sorted(verbs()))
def test_every_verb_is_asked(name: str) -> None:
    asked = name in VERBS or name.rsplit(".", 1)[-1] in VERBS
    assert asked != (name in EXCEPTIONS), f"{name} takes a chain: ask it in tests/retelling/verbs/"


def test_no_exception_is_left_over() -> None:
    assert set(EXCEPTIONS) <= set(verbs())


def test_only_public_names_are_asked() -> None:
    known = {name.rsplit(".", 1)[-1]: value for name, value in public().items()}
    for name in VERBS:
        first, *rest = name.removeprefix("viz.").split(".")
        found = known[first]
        for part in rest:
            found = getattr(found, part)
        assert callable(found)
