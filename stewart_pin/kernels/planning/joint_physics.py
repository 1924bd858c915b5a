"""What joints do by themselves, as constants of a kernel: which of it has a graph, and whether it is still the model's.

Springs stand in the description, which does not change; armature, damping and dry friction stand in Pinocchio's model,
where anybody may set them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from stewart_pin.model.description import physics_coordinates

if TYPE_CHECKING:
    from stewart_pin.kernels.planning.tree import Tree, TreeJoint


def is_passive(tree: Tree) -> bool:
    """Tell whether joints do nothing by themselves, but for their rotors.

    Parameters
    ----------
    tree
        Constants of a chain.

    Returns
    -------
    bool
        Whether there is neither spring nor damping nor dry friction.
    """
    return first_effect(tree) is None


def are_passive(joints: Sequence[TreeJoint]) -> bool:
    """Tell whether joints of a tree do nothing by themselves, but for their rotors.

    Parameters
    ----------
    joints
        The joints.

    Returns
    -------
    bool
        Whether none has a spring, damping or dry friction.
    """
    return not any(joint.physics.pushes or joint.damping.any() or joint.friction.any() for joint in joints)


def has_friction(tree: Tree) -> bool:
    """Tell whether there is dry friction.

    Parameters
    ----------
    tree
        Constants of a chain.

    Returns
    -------
    bool
        Whether a joint of the tree or of a loop has it.
    """
    of_loops = any(physics.friction for loop in tree.loops for physics in loop.physics)
    return of_loops or any(joint.friction.any() for joint in tree.joints)


def first_effect(tree: Tree) -> str | None:
    """Name a joint that does something by itself, but for its rotor.

    Parameters
    ----------
    tree
        Constants of a chain.

    Returns
    -------
    str or None
        The joint, and what it has.
    """
    for joint in tree.joints:
        for name in ("damping", "friction"):
            values = getattr(joint, name)
            if values.any():
                return f"joint '{joint.name}' has {name} {values.max():g}"
        if joint.physics.pushes:
            return f"joint '{joint.name}' has a spring or a force ({joint.physics})"
    for loop in tree.loops:
        for word, physics in zip(physics_coordinates(loop.kind), loop.physics, strict=False):
            if physics:
                return f"'{word}' of loop '{loop.name}' has {physics}"
    return None
