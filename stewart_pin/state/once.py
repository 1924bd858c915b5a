"""Quantities that are computed when they are first asked for, and kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

from numpy import ndarray

T = TypeVar("T")


class once(Generic[T]):
    """A property that is computed once: `functools.cached_property` without its lock, which costs as much as the sums.

    Arrays are read-only from then on.

    Parameters
    ----------
    compute
        The property.
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self._compute, self._name = compute, compute.__name__
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> once[T]: ...
    @overload
    def __get__(self, instance: object, owner: type[Any]) -> T: ...
    def __get__(self, instance: object | None, owner: type[Any]) -> once[T] | T:
        """Compute the property; from then on the instance's own attribute stands before this one."""
        if instance is None:
            return self
        value = instance.__dict__[self._name] = self._compute(instance)
        if type(value) is ndarray:
            # What is kept is everybody's. ``write`` goes by place: by its name the call takes twice as long.
            value.setflags(False)  # pyright: ignore[reportCallIssue]
        return value
