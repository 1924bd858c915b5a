"""What tasks bring along to workers, where it arrives once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from stewart_pin.studies.answers import Answer
from stewart_pin.studies.points import Point


@dataclass(frozen=True)
class Carried:
    """Something that workers keep.

    Each task brings its study along, and the study its chain. A chain that was unpickled again would not be the chain
    whose kernels are compiled, so a worker goes on with the one that came first.

    Attributes
    ----------
    token
        Equal for what is the same, and for nothing else.
    value
        A study or a chain.
    """

    token: str
    value: Any = field(compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return _arrived, (self.token, self.value)

    def __call__(self, points: Sequence[Point]) -> list[Answer]:
        """Let a study answer points.

        Parameters
        ----------
        points
            Where.

        Returns
        -------
        list
            Answer of each.
        """
        return self.value(points)


def _arrived(token: str, value: Any) -> Carried:
    return _first(Carried(token, value))


@lru_cache(maxsize=8)
def _first(carried: Carried) -> Carried:
    """Hand out the one that came first of all that are equal."""
    return carried
