"""From a file to a closed chain: the bundled robots, and the roles of motors and platform as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from stewart_pin.building.home import settle_home
from stewart_pin.building.joints import with_physics_fields_of
from stewart_pin.building.printed_digits import settle_printed
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import FileMissingError, InputError, MechanismError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from stewart_pin.model.formats.precision import Precision, printed_precision
from stewart_pin.model.formats.reading import read_mechanism
from stewart_pin.model.formats.words import telling_strangers
from stewart_pin.model.formats.xml import expanding_once
from stewart_pin.model.roles import platform_candidates
from stewart_pin.model.shapes import DRAWN
from stewart_pin.model.tree import build_tree
from stewart_pin.model.validation import keep_odd_inertias, validate, with_unit_quaternions
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike


def load(
    name_or_path: str | Path,
    *,
    loops: str | Path | None = None,
    motors: Sequence[str] | None = None,
    platform: str | None = None,
    gravity: ArrayLike | None = None,
    odd_inertias: bool = True,
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
        sum of the others, or mass absent; False: they are refused, but for SDFormat's.
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
    with expanding_once():
        mechanism = _without_drawn(read_mechanism(find_robot(name_or_path), loops=side_car))
        if odd_inertias:
            mechanism = keep_odd_inertias(mechanism)
        forgiven: float | Precision
        if closure_tolerance is None and mechanism.digits is not None:
            forgiven = Precision(*mechanism.digits)
        elif closure_tolerance is None:
            forgiven = printed_precision(Path(mechanism.source), side_car)
        else:
            forgiven = as_positive("closure_tolerance", closure_tolerance)
    with telling_strangers(mechanism.notes):
        return build_chain(mechanism, motors=motors, platform=platform, gravity=gravity, forgiven=forgiven)


def _without_drawn(mechanism: Mechanism) -> Mechanism:
    """Take off the shapes that `export` drew where a robot had none."""

    def seen(link: Link) -> Link:
        kept = tuple(shape for shape in link.visuals if not shape.name.startswith(DRAWN))
        return link if len(kept) == len(link.visuals) else replace(link, visuals=kept)

    return replace(mechanism, links=tuple(seen(link) for link in mechanism.links))


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
    chain = open_chain(mechanism, motors=motors, platform=platform, gravity=gravity)
    return settle_printed(chain, forgiven) if forgiven else settle_home(chain)


def open_chain(
    mechanism: Mechanism,
    *,
    motors: Sequence[str] | None = None,
    platform: str | None = None,
    gravity: ArrayLike | None = None,
) -> ClosedChain:
    """Validate a description and build the chain as it is told, its loops perhaps open: to be looked at.

    Parameters
    ----------
    mechanism
        Links, joints and loops.
    motors, platform
        As for `build_chain`.
    gravity
        (3,) as for `build_chain` [m/s²].

    Returns
    -------
    ClosedChain
        The chain, all joints at zero.

    Raises
    ------
    MechanismError
        If it is no mechanism.
    """
    if gravity is None:
        gravity = mechanism.gravity
    gravity = STANDARD_GRAVITY if gravity is None else as_array("gravity", gravity, (3,))
    validate(mechanism)
    mechanism = with_unit_quaternions(mechanism)
    # Pinocchio 4.1 crashes on frame Jacobians of a model without freedoms.
    if all(joint.kind is JointKind.FIXED for joint in mechanism.joints):
        raise MechanismError(
            f"robot '{mechanism.name}' has no joint that moves; a chain needs one, floating links count",
            path=mechanism.source,
            culprit=mechanism.name,
        )
    model = build_tree(mechanism, gravity)
    return ClosedChain(
        mechanism=mechanism,
        model=model,
        motors=_motors(mechanism, motors),
        platform=_platform(mechanism, platform),
        q_home=np.zeros(model.nq),
    )


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


# ----------------------------------------------------------------------------------------------------
# Bundled robots: one folder each, in the repository and in the wheel
# ----------------------------------------------------------------------------------------------------

_LONGEST_NAME = 200
"""Characters of a name that a message repeats."""
_PACKAGE = Path(__file__).resolve().parent.parent


@cache
def urdf_root() -> Path:
    """Find the folder of the bundled robots.

    Returns
    -------
    pathlib.Path
        ``stewart_pin/urdf`` of an installed wheel, or ``urdf`` of the repository.

    Raises
    ------
    FileMissingError
        If neither exists: the installation is broken.
    """
    for root in (_PACKAGE / "urdf", _PACKAGE.parent / "urdf"):
        if root.is_dir():
            return root
    raise FileMissingError(
        "the folder of the bundled robots is missing; reinstall stewart_pin", path=str(_PACKAGE)
    )


def robots() -> tuple[str, ...]:
    """List the bundled robots.

    Returns
    -------
    tuple of str
        Names that `load` accepts.
    """
    return tuple(
        sorted(folder.name for folder in urdf_root().iterdir() if (folder / f"{folder.name}.urdf").is_file())
    )


def find_robot(name_or_path: str | Path) -> Path:
    """Find the file of a robot.

    Parameters
    ----------
    name_or_path
        Name of a bundled robot, or path of a file.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If it is neither text nor a path.
    FileMissingError
        If there is neither a bundled robot nor a file of that name.
    """
    if not isinstance(name_or_path, str | Path):
        raise InputError(
            f"name_or_path must be a robot's name or a file's path, got {type(name_or_path).__name__}"
        )
    if name_or_path in robots():
        return urdf_root() / name_or_path / f"{name_or_path}.urdf"
    path = Path(name_or_path)
    try:
        found, is_folder = path.is_file(), path.is_dir()
    except OSError:  # a name longer than the file system allows, such as the text of a file
        found = is_folder = False
    if found:
        return path
    shown = str(name_or_path)
    raise FileMissingError(
        "this is a folder; pass the file inside"
        if is_folder
        else f"no such file, and no bundled robot of that name; the bundled robots are: {', '.join(robots())}",
        path=shown if len(shown) <= _LONGEST_NAME else shown[:_LONGEST_NAME] + "...",
        culprit=shown,
    )


# ----------------------------------------------------------------------------------------------------
# The same mechanism with other roles: other motors, another platform
# ----------------------------------------------------------------------------------------------------


def with_motors(chain: ClosedChain, motors: Sequence[str]) -> ClosedChain:
    """Drive a chain by other joints.

    Parameters
    ----------
    chain
        Closed chain.
    motors
        Names of joints with one freedom, in the order of motor positions and efforts; `mobility` suggests a set.

    Returns
    -------
    ClosedChain
        Same links, joints, loops, platform and home.

    Raises
    ------
    InputError
        If a name stands twice, or `motors` is no sequence of names.
    MechanismError
        If a name is not that of a joint with one freedom; lists those that are.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.with_motors(stp.load("five_bar"), ["left_hip", "left_knee"])
    >>> stp.mobility(chain).motors_sufficient
    True
    """
    as_chain(chain)
    rebuilt = build_chain(chain.described(), motors=motors, platform=chain.platform, gravity=chain.gravity)
    return with_physics_fields_of(chain, rebuilt)


def with_platform(
    chain: ClosedChain, link: str, *, placement: pin.SE3 | None = None, name: str | None = None
) -> ClosedChain:
    """Take another link, or a frame on a link, as the platform.

    Parameters
    ----------
    chain
        Closed chain.
    link
        Name of a link that moves.
    placement
        Platform frame in the link; default: the link's own frame.
    name
        Name of the frame, with `placement`; default: the link's name with ``_frame``.

    Returns
    -------
    ClosedChain
        Same joints, loops, motors and home; with `placement`, a link without inertia is fixed on `link`.

    Raises
    ------
    InputError
        If there is no such link, the name is taken, or a name is given without a placement.
    MechanismError
        If the link is the ground.

    Examples
    --------
    >>> import numpy as np, pinocchio as pin, stewart_pin as stp
    >>> tool = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1]))
    >>> chain = stp.with_platform(stp.load("stewart"), "platform", placement=tool, name="tool")
    >>> stp.platform_pose(chain, chain.q_home).translation
    array([0. , 0. , 1.1])
    """
    as_chain(chain)
    mechanism = chain.described()
    require_link(mechanism, "link", link)
    if placement is None:
        if name is not None:
            raise InputError(
                f"name {name!r} needs a placement=: without one, the platform is link '{link}' itself"
            )
        rebuilt = build_chain(mechanism, motors=chain.motors, platform=link, gravity=chain.gravity)
        return with_physics_fields_of(chain, rebuilt)
    name = f"{link}_frame" if name is None else name
    mechanism = with_fixed_link(mechanism, Link(name), link, as_pose("placement", placement))
    rebuilt = build_chain(mechanism, motors=chain.motors, platform=name, gravity=chain.gravity)
    return with_physics_fields_of(chain, rebuilt)


def with_fixed_link(mechanism: Mechanism, link: Link, carrier: str, placement: pin.SE3) -> Mechanism:
    """Fix a new link on another.

    Parameters
    ----------
    mechanism
        Description.
    link
        The new link; the joint that fixes it gets its name, or one made of it.
    carrier
        Name of the link that carries it.
    placement
        New link in the carrier.

    Returns
    -------
    Mechanism
        Description with one more link and joint.

    Raises
    ------
    InputError
        If a link has this name already, or it is empty.
    """
    if not link.name or link.name in {part.name for part in mechanism.links}:
        said = "taken" if link.name else "empty"
        raise InputError(f"name {link.name!r} is {said} in {mechanism.name}; choose another for the new link")
    joint_name, taken = link.name, {part.name for part in mechanism.joints}
    while joint_name in taken:
        joint_name += "_fixed"
    joint = Joint(joint_name, JointKind.FIXED, carrier, link.name, placement)
    return replace(mechanism, links=(*mechanism.links, link), joints=(*mechanism.joints, joint))


def require_link(mechanism: Mechanism, argument: str, link: str) -> None:
    """Check the name of a link.

    Parameters
    ----------
    mechanism
        Description.
    argument
        Name of the argument, for the message.
    link
        Name that the caller passed.

    Raises
    ------
    InputError
        If there is no such link; lists those that there are.
    """
    links = [part.name for part in mechanism.links]
    if link not in links:
        raise InputError(
            f"{argument} {link!r} is no link of {mechanism.name}; the links are: {', '.join(links)}"
        )
