"""Checks at the door: arrays of stated shape, finite, float64, or an `InputError` that names the argument."""

from __future__ import annotations

import math
import operator

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.typing import ArrayLike, FloatArray


def as_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Convert to a finite float64 array of a fixed shape.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed.
    shape
        Required shape; None stands for any length.

    Returns
    -------
    numpy.ndarray
        The value as float64; no copy when it is one already.

    Raises
    ------
    InputError
        If the value is not numeric, has another shape, or is not finite.
    """
    # The usual case at a third of the cost: a sum of squares is finite only if every entry is.
    if (
        type(value) is np.ndarray
        and value.dtype == np.float64
        and value.shape == shape
        and math.isfinite(np.vdot(value, value))
    ):
        return value
    array = _as_float(name, value)
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=False)
    ):
        wanted = (
            "("
            + ", ".join("n" if n is None else str(n) for n in shape)
            + ("," if len(shape) == 1 else "")
            + ")"
        )
        raise InputError(f"{name} must have shape {wanted}, got {array.shape}")
    return _require_finite(name, array)


def as_batch(name: str, value: ArrayLike, trailing: tuple[int, ...]) -> FloatArray:
    """Convert to a finite float64 array with any leading shape and fixed trailing shape.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed.
    trailing
        Required trailing shape.

    Returns
    -------
    numpy.ndarray
        The value as float64, shape ``(..., *trailing)``.

    Raises
    ------
    InputError
        If the value is not numeric, has another trailing shape, or is not finite.
    """
    array = _as_float(name, value)
    if array.ndim < len(trailing) or array.shape[array.ndim - len(trailing) :] != trailing:
        wanted = "(..., " + ", ".join(map(str, trailing)) + ")"
        raise InputError(f"{name} must have shape {wanted}, got {array.shape}")
    return _require_finite(name, array)


def as_number(name: str, value: float) -> float:
    """Return a finite number; text and truth values are none.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed.

    Returns
    -------
    float
        The value.

    Raises
    ------
    InputError
        If it is not a finite number.
    """
    wrong = isinstance(value, (str, bytes, bool, np.bool_)) or np.ndim(value) or np.iscomplexobj(value)
    try:
        number = math.nan if wrong else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} must be a finite number, got {value!r}")
    return number


def as_positive(name: str, value: float) -> float:
    """Return a finite number above zero.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed.

    Returns
    -------
    float
        The value.

    Raises
    ------
    InputError
        If it is not a finite number above zero.
    """
    try:
        number = float(value) if np.ndim(value) == 0 else np.nan
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be a number above zero, got {value!r}") from None
    if not np.isfinite(number) or number <= 0.0:
        raise InputError(f"{name} must be a finite number above zero, got {value}")
    return number


MOST = 1_000_000
"""Iterations, starts or samples beyond which a count is a slip: at the usual millisecond each, a quarter of an hour."""


def as_count(name: str, value: int, least: int = 0, most: int | None = MOST) -> int:
    """Return a whole number within bounds.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed.
    least, most
        Smallest and largest that are allowed; None: of any size.

    Returns
    -------
    int
        The value.

    Raises
    ------
    InputError
        If it is no whole number, smaller or larger.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise InputError(f"{name} must be a whole number, {least} or more, got {value!r}") from None
    if number < least:
        raise InputError(f"{name} must be {least} or more, got {_told(number)}")
    if most is not None and number > most:
        raise InputError(f"{name} must be {most} or less, got {_told(number)}")
    return number


def _told(number: int) -> str:
    # Python refuses to write out some thousand digits.
    return str(number) if number.bit_length() < 100 else f"one of {number.bit_length()} bits"


def as_spread(name: str, value: ArrayLike, count: int) -> FloatArray:
    """Spread one number, or take one for each, none below zero.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed.
    count
        How many are wanted.

    Returns
    -------
    numpy.ndarray
        (count,) the values [any unit]; infinity is one.

    Raises
    ------
    InputError
        If the shape is another, or an entry no number or below zero.
    """
    try:
        array = _as_float(name, value)
    except InputError:
        raise InputError(f"{name} must be a number or have shape ({count},), got {value!r}") from None
    if array.shape not in ((), (count,)):
        raise InputError(f"{name} must be a number or have shape ({count},), got {array.shape}")
    if not (array >= 0).all():
        raise InputError(f"{name} must be 0 or more, got {value!r}")
    return np.array(np.broadcast_to(array, (count,)))


def require_broadcast(**shapes: tuple[int, ...]) -> None:
    """Check that batch shapes fit each other.

    Parameters
    ----------
    **shapes
        Batch shape of each argument, by its name.

    Raises
    ------
    InputError
        If they cannot be broadcast together.
    """
    try:
        np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise InputError(f"batch shapes do not fit each other: {listed}") from None


def _as_float(name: str, value: ArrayLike) -> FloatArray:
    try:
        if np.iscomplexobj(value):  # NumPy would drop the imaginary parts
            raise TypeError
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be an array of real numbers, got {type(value).__name__}") from None


def _require_finite(name: str, array: FloatArray) -> FloatArray:
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name} must be finite, got {array[where]} at index {where}")
    return array
