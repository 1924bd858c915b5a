"""Which joints of a description are motors, and in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stewart_pin.model.description import Mechanism


def mark_motors(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """Mark joints as the motors, in an order.

    Parameters
    ----------
    mechanism
        Description; which motors it had does not matter.
    names
        Existing joints, in the order of motor coordinates and efforts.

    Returns
    -------
    Mechanism
        The same machine; the motors stand in their order, each where the description had one of them.
    """
    in_order = iter([mechanism.joint(name) for name in names])
    motors = set(names)
    joints = tuple(
        replace(next(in_order), independent=True)
        if joint.name in motors
        else replace(joint, independent=False)
        for joint in mechanism.joints
    )
    return replace(mechanism, joints=joints)
