"""From expressions to functions."""

from __future__ import annotations

import casadi as ca


def shared(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """Make a function, in which equal expressions are computed once.

    Parameters
    ----------
    name
        Of the function.
    inputs, outputs
        By name, in order.

    Returns
    -------
    casadi.Function
        The function.
    """
    results = ca.cse(list(outputs.values()))
    return ca.Function(name, list(inputs.values()), results, list(inputs), list(outputs))
