"""One thread at a time works with CasADi's expressions.

Equal constants are one node to CasADi, and nodes are counted without a lock. From 3.8 on its functions let go of
Python's lock as well, so that two threads that write expressions, or drop them, end the process.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar, overload

T = TypeVar("T")

_LOCK = threading.RLock()
_LEFT: deque[dict[str, Any]] = deque()
"""What nobody needs any more, by threads that did not have the lock: the next one that has it drops it."""


@contextlib.contextmanager
def writing() -> Iterator[None]:
    """Keep other threads from CasADi while this one writes, reads or drops expressions.

    Yields
    ------
    None
        May be entered again inside.
    """
    with _LOCK:
        _LEFT.clear()
        yield


def drop(holder: object) -> None:
    """Let go of the expressions that an object holds; for ``__del__``, which may run in any thread, inside any lock.

    Parameters
    ----------
    holder
        The object; its attributes are gone then.
    """
    _LEFT.append(dict(vars(holder)))
    vars(holder).clear()
    if _LOCK.acquire(blocking=False):  # a finaliser that waits may wait for its own thread
        try:
            _LEFT.clear()
        finally:
            _LOCK.release()


class written_once(Generic[T]):
    """A property that is written when it is first asked for, by one thread, and kept.

    `functools.cached_property` has a lock of its own in Python 3.11, which two threads could take in two orders.

    Parameters
    ----------
    write
        The property.
    """

    def __init__(self, write: Callable[[Any], T]) -> None:
        self._write, self._name = write, write.__name__
        self.__doc__ = write.__doc__

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> written_once[T]: ...
    @overload
    def __get__(self, instance: object, owner: type[Any]) -> T: ...
    def __get__(self, instance: object | None, owner: type[Any]) -> written_once[T] | T:
        """Write the property; from then on the instance's own attribute stands before this one."""
        if instance is None:
            return self
        own = vars(instance)
        with writing():
            if self._name not in own:
                own[self._name] = self._write(instance)
            return own[self._name]
