"""Every public object says what it takes and gives, with units; nothing is printed or shared by accident.

A check that cannot fail is none, so there is one broken sample per rule.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import importlib
import inspect
import pkgutil
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.typing import ArrayLike, FloatArray
from tests.docstring_rules import has_unit, problems

PACKAGE = Path(stp.__file__).parent


def _modules() -> list[ModuleType]:
    names = [m.name for m in pkgutil.walk_packages([str(PACKAGE)], "stewart_pin.")]
    return [stp, *(importlib.import_module(n) for n in names if not n.endswith("__main__"))]


def _public_objects() -> dict[str, Any]:
    """Return every public function and class where it is defined, and all that the package exports."""
    found = {}
    for module in MODULES:
        for name, value in vars(module).items():
            # Decorators and compilers keep the function they wrap.
            thing = inspect.unwrap(getattr(value, "py_func", value)) if callable(value) else value
            home = getattr(thing, "__module__", None) or ""
            ours = home == module.__name__ or (module is stp and home.startswith("stewart_pin."))
            if ours and not name.startswith("_") and (inspect.isclass(thing) or inspect.isfunction(thing)):
                found[f"{home}.{thing.__qualname__}"] = thing
    return found


MODULES = _modules()
PUBLIC = _public_objects()


def test_the_walk_finds_the_package() -> None:
    expected = {
        "geometry.hexapod.Hexapod",
        "geometry.hexapod.leg_lengths",
        "errors.InputError",
        "checks.as_array",
    }
    assert {f"stewart_pin.{name}" for name in expected} <= set(PUBLIC)


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_public_object_keeps_the_conventions(name: str) -> None:
    assert problems(PUBLIC[name]) == []


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__)
def test_module_says_what_it_is_for(module: ModuleType) -> None:
    assert module.__doc__
    assert module.__doc__.strip()
    assert [name for name in getattr(module, "__all__", ()) if not hasattr(module, name)] == []


def _talking_lines(source: str) -> list[int]:
    calls = (n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Call))
    return [c.lineno for c in calls if isinstance(c.func, ast.Name) and c.func.id in {"print", "input"}]


def test_only_the_command_line_talks() -> None:
    files = [p for p in PACKAGE.rglob("*.py") if "cli" not in p.relative_to(PACKAGE).parts]
    assert {str(p): lines for p in files if (lines := _talking_lines(p.read_text(encoding="utf-8")))} == {}
    assert _talking_lines("x = 1\nprint(x)\ninput()\n") == [2, 3]


# One broken sample per rule


def good(position: ArrayLike, *, mass: float) -> FloatArray:
    """Push.

    Parameters
    ----------
    position
        (3,) where [m].
    mass
        How much [kg].

    Returns
    -------
    numpy.ndarray
        (3,) force [N].

    References
    ----------
    .. [1] A book.
    """
    return np.asarray(position) * mass


@dataclasses.dataclass(frozen=True)
class GoodRecord:
    """A record.

    Attributes
    ----------
    q
        (n,) configuration [m, rad].
    success
        Whether it worked.
    """

    q: FloatArray
    success: bool

    @property
    def twist(self) -> FloatArray:
        """(6,) velocity [m/s, rad/s]."""
        return self.q


def _with_docstring(old: str, new: str) -> Any:
    """Return `good` with another docstring."""

    def changed(position: ArrayLike, *, mass: float) -> FloatArray:
        return good(position, mass=mass)

    doc = inspect.cleandoc(good.__doc__ or "")
    assert old in doc
    changed.__doc__ = doc.replace(old, new)
    return changed


def _bare(x: float) -> float:
    return x


def _mutable_default(x: list[float] = []) -> None:  # noqa: B006
    """Keep.

    Parameters
    ----------
    x
        Kept.
    """


class _UnitlessProperties:
    """A class."""

    @property
    def twist(self) -> FloatArray:
        """(6,) velocity."""
        return np.zeros(6)

    @functools.cached_property
    def wrench(self) -> FloatArray:
        """(6,) effort."""
        return np.zeros(6)


class _SilentConstructor:
    """A class."""

    def __init__(self, stroke: float) -> None:
        self.stroke = stroke


class _BareMethod:
    """A class."""

    @classmethod
    def build(cls) -> _BareMethod:
        return cls()


@dataclasses.dataclass
class _BareRecord:
    q: FloatArray


@dataclasses.dataclass
class _StaleRecord:
    """A record.

    Attributes
    ----------
    qq
        Renamed since.
    """

    q: FloatArray


@dataclasses.dataclass
class _UnitlessRecord:
    """A record.

    Attributes
    ----------
    q
        (n,) configuration, in [-π, π], see [1]_.
    """

    q: FloatArray


BROKEN = [
    (_with_docstring("mass\n", "masses\n"), "parameters documented ['position', 'masses']"),
    (_with_docstring("mass\n    How much [kg].\n", ""), "parameters documented ['position']"),
    (_with_docstring("[m]", "in the base frame [1]_"), "array 'position' has no [unit]"),
    (_with_docstring("force [N]", "force"), "a returned array has no [unit]"),
    (_with_docstring("Returns\n-------", "Gives\n-----"), "what it returns is not documented"),
    (_bare, "no docstring"),
    (_mutable_default, "default of 'x' is mutable"),
    (_UnitlessProperties, "twist: a returned array has no [unit]"),
    (_UnitlessProperties, "wrench: a returned array has no [unit]"),
    (_SilentConstructor, "constructor arguments ['stroke'] are not documented"),
    (_BareMethod, "build: no docstring"),
    (_BareRecord, "no docstring"),
    (_StaleRecord, "attributes documented ['qq'], actual ['q']"),
    (_UnitlessRecord, "array 'q' has no [unit]"),
]


@pytest.mark.parametrize("thing", [good, GoodRecord], ids=["function", "record"])
def test_a_good_sample_passes(thing: Any) -> None:
    assert problems(thing) == []


@pytest.mark.parametrize(("thing", "complaint"), BROKEN, ids=[c for _, c in BROKEN])
def test_a_broken_sample_is_caught(thing: Any, complaint: str) -> None:
    assert any(p.startswith(complaint) for p in problems(thing)), problems(thing)


@pytest.mark.parametrize(
    "text", ["[m]", "[m/s, rad/s]", "[kg m²]", "[1/m]", "per s [N]", "rotation", "of any unit"]
)
def test_a_unit_is_recognised(text: str) -> None:
    assert has_unit(text)


@pytest.mark.parametrize("text", ["(3,) force", "see [1]_", "in [-π/2, π/2]", "[v; ω]", "[metres]"])
def test_a_missing_unit_is_noticed(text: str) -> None:
    assert not has_unit(text)
