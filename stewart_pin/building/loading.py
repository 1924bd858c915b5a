"""From a file to a closed chain."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stewart_pin.building.printed_digits import settle_printed
from stewart_pin.building.resources import find_robot
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError, MechanismError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.model.description import JointKind, Mechanism
from stewart_pin.model.formats.precision import Precision, printed_precision
from stewart_pin.model.formats.reading import read_mechanism
from stewart_pin.model.roles import platform_candidates
from stewart_pin.model.tree import build_tree
from stewart_pin.model.validation import keep_odd_inertias, validate
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike


def load(
    name_or_path: str | Path,
    *,
    loops: str | Path | None = None,
    motors: Sequence[str] | None = None,
    platform: str | None = None,
    gravity: ArrayLike | None = None,
    odd_inertias: bool = False,
    closure_tolerance: float | None = None,
) -> ClosedChain:
    """Read a robot with its loops, motors and platform.

    A link with an ``<inertial>`` is a body; the joints around a link without one act as one joint.

    Parameters
    ----------
    name_or_path
        Name of a bundled robot (see `robots`), or path of a URDF with loops in any dialect (README, "Loops in files"),
        an MJCF or an SDFormat file.
    loops
        Gepetto YAML that declares the loops of a URDF; default: one of the URDF's name beside it, if there is any.
    motors
        Names of the motor joints, in order; default: the joints that the file marks ``independent="true"`` or lists,
        that its transmissions name without doubt, or that an MJCF file drives by actuators; none where there are none.
    platform
        Name of the platform link; default: the parent link of the ``<end_effector name="platform">``, or else the
        link (in MJCF: body or site) called ``platform``; None where there is none. Verbs that need a platform or motors
        then raise `MissingRoleError`, which names the candidates.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²]; None: what the file states, or else
        (0, 0, -9.81).
    odd_inertias
        Whether to keep, with a note in the report, inertias that no real body has, one principal moment being above the
        sum of the others. SDFormat's are always kept, as its simulators keep them.
    closure_tolerance
        Largest gap of loops, and singular value of their rows, that is taken for rounding, in robot sizes and radians:
        joints and loops are then moved by it, so that the mechanism has the freedom that was meant, and the report
        tells it. Default: what the digits of the file explain.

    Returns
    -------
    ClosedChain
        The robot, validated, its home configuration closed; ``print(chain.report)`` tells what was made of the file.

    Raises
    ------
    InputError
        If an argument has the wrong type or shape.
    FileFormatError
        If the file is missing, broken or of an unknown dialect.
    MechanismError
        If masses, joints or loops make no mechanism, or motors or platform are none of it.

    Examples
    --------
    >>> chain = load("stewart")
    >>> chain.nv, chain.nu, chain.nc
    (24, 6, 18)
    """
    if not isinstance(loops, str | Path | None):
        raise InputError(f"loops must be a path, got {loops!r}")
    side_car = None if loops is None else Path(loops)
    mechanism = read_mechanism(find_robot(name_or_path), loops=side_car)
    if odd_inertias:
        mechanism = keep_odd_inertias(mechanism)
    if closure_tolerance is None:
        forgiven = printed_precision(Path(mechanism.source), side_car)
    else:
        forgiven = as_positive("closure_tolerance", closure_tolerance)
    return build_chain(mechanism, motors=motors, platform=platform, gravity=gravity, forgiven=forgiven)


def build_chain(
    mechanism: Mechanism,
    *,
    motors: Sequence[str] | None = None,
    platform: str | None = None,
    gravity: ArrayLike | None = None,
    forgiven: float | Precision = 0.0,
) -> ClosedChain:
    """Validate a description and build the closed chain.

    Parameters
    ----------
    mechanism
        Links, joints and loops.
    motors
        Names of the motor joints, in order; default: the joints marked independent, if any.
    platform
        Name of the platform link; default: the one the description names, if any.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²]; None: what the description states, or else
        (0, 0, -9.81).
    forgiven
        What digits may have left open, see `settle_printed`.

    Returns
    -------
    ClosedChain
        The chain, its home configuration closed.

    Raises
    ------
    MechanismError
        If it is no mechanism.
    """
    if gravity is None:
        gravity = STANDARD_GRAVITY if mechanism.gravity is None else mechanism.gravity
    gravity = as_array("gravity", gravity, (3,))
    validate(mechanism)
    # Pinocchio 4.1 crashes on frame Jacobians of a model without freedoms.
    if all(joint.kind is JointKind.FIXED for joint in mechanism.joints):
        raise MechanismError(
            f"robot '{mechanism.name}' has no joint that moves; a chain needs one, floating links count",
            path=mechanism.source,
            culprit=mechanism.name,
        )
    model = build_tree(mechanism, gravity)
    chain = ClosedChain(
        mechanism=mechanism,
        model=model,
        motors=_motors(mechanism, motors),
        platform=_platform(mechanism, platform),
        q_home=np.zeros(model.nq),
    )
    return settle_printed(chain, forgiven)


def _motors(mechanism: Mechanism, motors: Sequence[str] | None) -> tuple[str, ...]:
    movable = [joint.name for joint in mechanism.joints if joint.has_axis]
    if motors is None:
        return tuple(joint.name for joint in mechanism.joints if joint.independent)
    if isinstance(motors, str) or not isinstance(motors, Sequence):
        raise InputError(f"motors must be a sequence of joint names, got {motors!r}")
    for name in motors:
        if name in [loop.name for loop in mechanism.loops]:
            raise MechanismError(
                f"motors name the joint '{name}', which closes a loop, and has no coordinate; cut the "
                "loop at a passive joint (of two parents of a link, the joint that stands last in the file is cut)",
                path=mechanism.source,
                culprit=name,
            )
        if name not in movable:
            raise MechanismError(
                f"motors name the joint '{name}', which is missing or has not one freedom; "
                f"the candidates are: {', '.join(movable)}",
                path=mechanism.source,
                culprit=str(name),
            )
    if len(set(motors)) != len(motors):
        raise InputError(f"motors name a joint twice: {list(motors)}")
    return tuple(motors)


def _platform(mechanism: Mechanism, platform: str | None) -> str | None:
    chosen = mechanism.platform if platform is None else platform
    links = [link.name for link in mechanism.links if link.name != mechanism.root]
    if chosen is not None and chosen not in links:
        raise MechanismError(
            f"there is no moving link '{chosen}'; pass platform=...; the candidates are: "
            f"{', '.join(platform_candidates(mechanism))}",
            path=mechanism.source,
            culprit=str(chosen),
        )
    return chosen
