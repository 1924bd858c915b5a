"""Rules for docstrings and signatures: names match, arrays state a unit, defaults cannot change.

`problems` lists what is wrong with a function or class; `test_conventions.py` applies it to the package.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

ARRAY = re.compile(r"^(?!.*Callable).*\b(FloatArray|ArrayLike|NDArray|ndarray|Configuration|Tangent)\b")
"""Annotations of arrays, which carry units; a callable that gives arrays is described in words."""

# "[m/s]" and "[kg m²]", but not "[1]_", which is a citation, nor "[-π, π]" or "[v; ω]".
UNIT = re.compile(r"\[[^\[\]]*(?<![A-Za-z])(mm|m|rad|deg|s|Hz|N|kg|J|W|Pa|1)(?![A-Za-z])[^\[\]]*\](?!_)")
UNITLESS = re.compile(
    r"dimensionless|rotation|axes (of|in)|quaternion|unit vector|orthonormal|cosine|index|indices|mask"
    r"|boolean|(any|same) unit",
    re.IGNORECASE,
)
UNITLESS_NAME = re.compile(r"rotation|quaternion|ax[ie]s|normal|cosine|index")

WITHOUT_UNITS = {"stewart_pin.checks"}
"""Doors that check arrays of any meaning have no unit to state."""

WITHOUT_SECTIONS = re.compile(r"stewart_pin\.cli\b")
"""A command documents its options in the help text that its reader sees."""

MUTABLE = (list, dict, set, bytearray, np.ndarray)


def problems(thing: Any) -> list[str]:
    """List what is wrong with a function or class."""
    if WITHOUT_SECTIONS.match(thing.__module__):
        return [] if thing.__doc__ else ["no docstring"]
    check = problems_of_class if inspect.isclass(thing) else problems_of_function
    return list(check(thing, units=thing.__module__ not in WITHOUT_UNITS))


def problems_of_function(function: Callable[..., Any], *, units: bool) -> Iterator[str]:
    """Check docstring, parameters, return value and defaults of a function."""
    signature = inspect.signature(function)
    for name, parameter in signature.parameters.items():
        if isinstance(parameter.default, MUTABLE):
            yield f"default of {name!r} is mutable"
    if not function.__doc__:
        yield "no docstring"
        return
    found = sections(function.__doc__)
    actual = {n: p.annotation for n, p in signature.parameters.items() if n not in {"self", "cls"}}
    texts = described(found.get("Parameters", []))
    if list(texts) != list(actual):
        yield f"parameters documented {list(texts)}, actual {list(actual)}"
    returned = signature.return_annotation
    gives = found.get("Returns", []) + found.get("Yields", [])
    if returned not in {None, "None", "NoReturn"} and not gives:
        yield "what it returns is not documented"
    if units:
        yield from _arrays_without_unit(texts, actual)
        if ARRAY.search(str(returned)) and not any(has_unit(text) for _, text in gives):
            yield "a returned array has no [unit]"


def problems_of_class(cls: type, *, units: bool) -> Iterator[str]:
    """Check docstring, attributes and public methods of a class."""
    doc = vars(cls).get("__doc__")
    if not doc or doc.startswith(
        f"{cls.__name__}("
    ):  # a dataclass without a docstring is given its signature
        yield "no docstring"
        return
    found = sections(doc)
    texts = described(found.get("Parameters", []) + found.get("Attributes", []))
    annotations, own = _fields(cls)
    if annotations:
        listed = [n for n in texts if n in annotations or not hasattr(cls, n)]
        if listed not in (own, list(annotations)):
            yield f"attributes documented {listed}, actual {own}"
    else:
        annotations = _constructor_arguments(cls)
        if missing := [n for n in annotations if n not in texts]:
            yield f"constructor arguments {missing} are not documented"
    if units:
        yield from _arrays_without_unit(texts, annotations)
    if not getattr(cls, "_is_protocol", False):
        for name, member in vars(cls).items():
            if not name.startswith("_"):
                yield from (f"{name}: {p}" for p in _problems_of_member(member, units=units))


def sections(doc: str) -> dict[str, list[tuple[str, str]]]:
    """Split a numpydoc text into {section: [(head of an entry, its description)]}."""
    found: dict[str, list[tuple[str, str]]] = {}
    entries: list[tuple[str, str]] = []
    lines = inspect.cleandoc(doc).splitlines()
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if re.fullmatch("-{3,}", below):
            entries = found[line] = []
        elif line.startswith(" ") and entries:
            head, text = entries[-1]
            entries[-1] = (head, f"{text} {line.strip()}".strip())
        elif line and not re.fullmatch("-{3,}", line):
            entries.append((line, ""))
    return found


def described(entries: list[tuple[str, str]]) -> dict[str, str]:
    """Map each documented name to its description; ``a, b : float`` documents two names."""
    names = (
        (name.strip().lstrip("*"), text) for head, text in entries for name in head.split(" :")[0].split(",")
    )
    return dict(names)


def has_unit(text: str) -> bool:
    """Tell whether a description states a unit, or that there is none."""
    return bool(UNIT.search(text) or UNITLESS.search(text))


def _arrays_without_unit(texts: dict[str, str], annotations: dict[str, Any]) -> Iterator[str]:
    for name, text in texts.items():
        array = ARRAY.search(str(annotations.get(name, "")))
        if array and not has_unit(text) and not UNITLESS_NAME.search(name):
            yield f"array {name!r} has no [unit]: {text!r}"


def _fields(cls: type) -> tuple[dict[str, Any], list[str]]:
    """Return the annotations of a record's public fields, and the names that the class itself adds."""
    if dataclasses.is_dataclass(cls):
        annotations = {f.name: f.type for f in dataclasses.fields(cls)}
    else:
        annotations = {n: cls.__annotations__[n] for n in getattr(cls, "_fields", ())}  # a NamedTuple
    annotations = {n: a for n, a in annotations.items() if not n.startswith("_")}
    return annotations, [n for n in annotations if n in inspect.get_annotations(cls)]


def _constructor_arguments(cls: type) -> dict[str, Any]:
    if "__init__" not in vars(cls) or issubclass(cls, enum.Enum) or getattr(cls, "_is_protocol", False):
        return {}
    parameters = list(inspect.signature(vars(cls)["__init__"]).parameters.values())[1:]
    # An exception's message is its text; *args and **kwargs are documented by the class they are handed to.
    return {
        p.name: p.annotation
        for p in parameters
        if p.kind not in {p.VAR_POSITIONAL, p.VAR_KEYWORD}
        and not (issubclass(cls, Exception) and p.name == "message")
    }


def _problems_of_member(member: object, *, units: bool) -> Iterator[str]:
    if isinstance(member, (staticmethod, classmethod)):
        member = member.__func__
    getter = getattr(member, "fget", None) or getattr(member, "func", None)  # property, cached_property
    if getter is not None:
        if not getter.__doc__:
            yield "no docstring"
        elif (
            units
            and ARRAY.search(str(inspect.signature(getter).return_annotation))
            and not has_unit(getter.__doc__)
        ):
            yield "a returned array has no [unit]"
    elif inspect.isfunction(member):
        yield from problems_of_function(member, units=units)
