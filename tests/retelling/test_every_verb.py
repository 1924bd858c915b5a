"""No public verb that takes a chain is forgotten by the retellings: each is asked, or its exception has a reason."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from types import ModuleType

import pytest

import stewart_pin as stp
from tests.retelling.verbs.everything import VERBS

EXCEPTIONS = {
    "constraint_models": "Pinocchio's own models of the loops, which forward dynamics is asked through",
    "displace_geometry": "displaces along the axes of links, which a telling turns",
    "geometry_parameters": "names the axes of links, which a telling turns",
    "viz.build_scene": "a picture",
    "viz.plot_chain": "a picture",
    "viz.plot_scene": "a picture",
    "viz.plot_singularity_map": "a picture",
}


def public() -> Iterator[tuple[str, object]]:
    """Walk the names of the package and of its public namespaces."""
    for name, value in vars(stp).items():
        if name.startswith("_"):
            continue
        if not isinstance(value, ModuleType):
            yield name, value
        elif value.__name__.startswith(stp.__name__):
            # Folders hold modules alone; a namespace holds verbs.
            members = ((k, v) for k, v in vars(value).items() if not k.startswith("_"))
            yield from ((f"{name}.{k}", v) for k, v in members if not isinstance(v, ModuleType))


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
    for name, value in public():
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
    for name in VERBS:
        found: object = stp
        for part in name.split("."):
            found = getattr(found, part)
        assert callable(found)
