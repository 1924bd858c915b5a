"""Print the oldest version of each dependency that pyproject.toml allows, one pip constraint a line."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).parent.parent / "pyproject.toml"
LOWER_BOUND = re.compile(r"(?P<name>[\w.-]+)(?:\[[\w,-]+\])?>=(?P<version>[\w.]+)")


def oldest_allowed(project: dict) -> list[str]:
    """Turn every ``name>=version`` of the dependencies and extras into ``name==version``.

    Parameters
    ----------
    project
        Table ``[project]`` of pyproject.toml.

    Returns
    -------
    list of str
        Constraints, sorted and without repetition.

    Raises
    ------
    ValueError
        If a dependency has no lower bound.
    """
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    pinned = set()
    for requirement in (r for group in groups for r in group if not r.startswith(f"{project['name']}[")):
        found = LOWER_BOUND.match(requirement)
        if found is None:
            raise ValueError(f"{requirement!r} has no lower bound; write name>=version")
        pinned.add(f"{found['name']}=={found['version']}")
    return sorted(pinned)


if __name__ == "__main__":
    sys.stdout.write("\n".join(oldest_allowed(tomllib.loads(PYPROJECT.read_text())["project"])) + "\n")
