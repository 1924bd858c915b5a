"""All public names: those at the top of the package, and those of its namespaces by topic."""

from __future__ import annotations

from types import ModuleType

import stewart_pin as stp


def namespaces() -> dict[str, ModuleType]:
    """Return the namespaces that the package shows."""
    found = {name: getattr(stp, name) for name in dir(stp)}
    return {name: value for name, value in found.items() if isinstance(value, ModuleType)}


def public() -> dict[str, object]:
    """Return every public object by its name behind ``stp.``, with its namespace."""
    spaces = namespaces()
    found = {name: getattr(stp, name) for name in dir(stp) if name not in spaces}
    for space, module in spaces.items():
        inside = {f"{space}.{k}": v for k, v in vars(module).items() if not k.startswith("_")}
        # A folder holds its modules beside its names.
        found |= {k: v for k, v in inside.items() if not isinstance(v, ModuleType)}
    return found
