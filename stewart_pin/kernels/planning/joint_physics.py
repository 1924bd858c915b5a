"""What joints do by themselves, as constants of a kernel: which of it has a graph, and whether it is still the model's.

Springs stand in the description, which does not change; armature, damping and dry friction stand in Pinocchio's model,
where anybody may set them.
"""

from __future__ import annotations

import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import physics_coordinates
from stewart_pin.model.joint_physics import read_fields
from stewart_pin.state.chain import ClosedChain

FIELDS = ("armature", "damping", "upperDryFrictionLimit", "lowerDryFrictionLimit")
"""Fields of the model that constants of kernels are read from."""


def fields_key(chain: ClosedChain) -> bytes:
    """Tell fields of the model that may be set by hand, as a key.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    bytes
        The same while they are.
    """
    return b"".join(getattr(chain.model, field).tobytes() for field in FIELDS)


def require_passive_joints(chain: ClosedChain) -> None:
    """Refuse damping, dry friction and springs, which have no graph.

    Parameters
    ----------
    chain
        Closed chain.

    Raises
    ------
    UnsupportedError
        Naming the joint and the quantity.
    """
    fields = read_fields(chain.model)
    for name in ("damping", "friction"):
        for k in np.flatnonzero(fields[name]):
            raise _unsupported(chain, f"'{chain.tangent_names[k]}' has {name} {fields[name][k]:g}")
    for joint in chain.mechanism.joints:
        if joint.physics.pushes:
            raise _unsupported(chain, f"joint '{joint.name}' has a spring or a force ({joint.physics})")
    for loop in chain.loops:
        for word, physics in zip(physics_coordinates(loop.kind), loop.physics, strict=False):
            if physics:
                raise _unsupported(chain, f"'{word}' of loop '{loop.name}' has {physics}")


def _unsupported(chain: ClosedChain, reason: str) -> UnsupportedError:
    return UnsupportedError(f"{chain.name} has no kernels: {reason}; use the verbs of one state")
