"""Values of a parameter, as they are written on the command line."""

from __future__ import annotations

import numpy as np

from stewart_pin.errors import InputError

_MOST = 1_000_000


def parse_range(option: str, text: str, *, linear: bool) -> np.ndarray:
    """Read ``LOW:HIGH:COUNT``, or numbers separated by commas.

    Parameters
    ----------
    option
        Name of the option, for the message.
    text
        What the user wrote.
    linear
        Whether a range has equal steps; otherwise equal ratios.

    Returns
    -------
    numpy.ndarray
        (n,) values [any unit].

    Raises
    ------
    InputError
        If it is neither, or a range of equal ratios does not stay above zero.
    """
    try:
        if ":" not in text:
            values = np.array([float(word) for word in text.split(",")])
        else:
            low, high, count = text.split(":")
            ends, steps = (float(low), float(high)), int(count)
            if not 1 <= steps <= _MOST:
                raise InputError(f"{option}: a range has 1 to {_MOST} values, got {steps}")
            if not linear and min(ends) <= 0:
                raise InputError(
                    f"{option}: equal ratios need values above zero, got {text!r}; or add --linear"
                )
            values = (np.linspace if linear else np.geomspace)(*ends, steps)
    except InputError:
        raise
    except ValueError:
        raise InputError(
            f"{option} must be LOW:HIGH:COUNT or numbers separated by commas, got {text!r}"
        ) from None
    if not np.isfinite(values).all():
        raise InputError(f"{option} must be finite, got {text!r}")
    return values
