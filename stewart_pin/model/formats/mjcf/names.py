"""Names for the parts of MuJoCo's compiled model, also for those that the file leaves without one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class Names:
    """Hands out names of one kind that no other part bears.

    Attributes
    ----------
    taken
        Names that are in use.
    """

    def __init__(self, taken: Iterable[str]) -> None:
        self.taken = {name for name in taken if name}

    def fresh(self, wanted: str) -> str:
        """Invent a name.

        Parameters
        ----------
        wanted
            The name, unless it is in use; then a number is added.

        Returns
        -------
        str
            A name that is in use from now on.
        """
        name, number = wanted, 2
        while name in self.taken:
            name, number = f"{wanted}_{number}", number + 1
        self.taken.add(name)
        return name


def given_names(model: Any, part: str, count: int) -> list[str]:
    """List the names that a file gives to its bodies, joints or other parts.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    part
        ``body``, ``joint``, ``site``, ``equality``, ``actuator``, ``tendon`` or ``key``.
    count
        How many there are.

    Returns
    -------
    list of str
        In MuJoCo's order; empty where the file gives none.
    """
    access = getattr(model, part)
    return [str(access(k).name) for k in range(count)]
