"""Records that print in a few lines, whatever arrays they hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

_SHOWN = 8
"""Numbers of an array, and members of a tuple, that are printed whole."""


class Brief:
    """Base of records: long arrays are printed by shape and range, long tuples by their first members."""

    def __repr__(self) -> str:
        """Give each field in a few words."""
        known: Any = self
        told = (f"{f.name}={brief(getattr(self, f.name))}" for f in fields(known) if f.repr)
        return f"{type(self).__name__}({', '.join(told)})"


def brief(value: object) -> str:
    """Tell a value in a few words.

    Parameters
    ----------
    value
        Anything.

    Returns
    -------
    str
        One line.
    """
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, (str, bool, int, float, complex, type(None))):
        return repr(value)
    if isinstance(value, Mapping):
        told = [f"{brief(k)}: {brief(v)}" for k, v in list(value.items())[:_SHOWN]]
        return "{" + ", ".join([*told, *_more(len(value))]) + "}"
    if isinstance(value, (tuple, list, frozenset)):
        members = [brief(v) for v in list(value)[:_SHOWN]]
        return "(" + ", ".join([*members, *_more(len(value))]) + ")"
    if isinstance(value, Brief):
        name = getattr(value, "name", None)
        return (
            f"{type(value).__name__}({name!r})" if isinstance(name, str) else f"{type(value).__name__}(...)"
        )
    if callable(value):
        return getattr(value, "__qualname__", type(value).__name__)
    line = " ".join(repr(value).split())
    return line if len(line) <= 60 else f"{type(value).__name__}(...)"


def _array(value: np.ndarray) -> str:
    if value.size <= _SHOWN:
        return " ".join(np.array2string(value, precision=6, separator=", ").split())
    shape = " x ".join(str(n) for n in value.shape)
    if value.dtype == bool:
        return f"<{shape}: {np.count_nonzero(value)} true>"
    if value.dtype.kind not in "iuf":
        return f"<{shape} {value.dtype}>"
    finite = value[np.isfinite(value)]
    spread = f"{finite.min():.6g} to {finite.max():.6g}" if finite.size else "nothing finite"
    holes = f", {value.size - finite.size} not finite" if 0 < finite.size < value.size else ""
    return f"<{shape}: {spread}{holes}>"


def _more(count: int) -> list[str]:
    return [f"... {count - _SHOWN} more"] if count > _SHOWN else []
