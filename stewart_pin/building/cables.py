"""Cable robots from the points where cables leave the ground and where they hold the platform; lengths of cables."""

from __future__ import annotations

from math import inf

import numpy as np
import pinocchio as pin

from stewart_pin.building.loading import build_chain
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.model.description import Cable, Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.model.joint_physics import JointPhysics
from stewart_pin.state.cable_paths import cable_paths
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.state.state import State, as_state
from stewart_pin.typing import ArrayLike, FloatArray

_X, _Y, _Z = np.eye(3)


def cable_robot(
    exits: ArrayLike,
    attachments: ArrayLike,
    *,
    platform: pin.Inertia,
    home: pin.SE3 | ArrayLike,
    pulleys: ArrayLike = 0.0,
    swivels: ArrayLike = (0.0, 0.0, 1.0),
    tension: tuple[float, float] = (0.0, inf),
    lengths: tuple[float, float] = (0.0, inf),
    speed: float = inf,
    drum: float = 0.0,
    name: str = "cable_robot",
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> ClosedChain:
    """Build a platform on cables, without mass and straight between pulley and platform.

    Parameters
    ----------
    exits
        (n, 3) points at which the cables leave the ground; of a planar robot (n, 2) x and z [m].
    attachments
        (n, 3), or (n, 2), points at which they hold the platform, in its frame [m].
    platform
        Inertia in the platform frame [kg, m, kg m²].
    home
        Platform frame in the world at home; of a planar robot x, z and the turn from x to z, too [m, rad].
    pulleys
        Radius of the pulley at each exit, or (n,) of each; 0: the cable leaves from a point [m].
    swivels
        (3,) or (n, 3) directions in which the cables come to their exits, about which the pulleys swivel
        (dimensionless). The cable touches the pulley at the exit.
    tension
        Least and greatest tension, which are the limits of the winches' efforts [N].
    lengths
        Least and greatest length of a cable, from its exit to the platform [m].
    speed
        Largest rate of a cable [m/s].
    drum
        What a winch adds to the inertia of its cable, moment of inertia / radius² of the drum [kg].
    name
        Name of the robot.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].

    Returns
    -------
    ClosedChain
        Motors ``winch1``, ..., whose positions are the lengths that are wound in since home and whose efforts are the
        tensions [m, N], in the order of the exits; loops ``cable1``, .... The platform is free in space, or slides
        along x and z and turns about -y, from x to z.

    Raises
    ------
    InputError
        If the points do not match, limits are empty or tensions below zero, or an argument has the wrong shape.
    SingularityError
        If a cable has no direction at home.
    MechanismError
        If the inertia is unphysical, or a cable at home is shorter or longer than it may be.

    Examples
    --------
    >>> import numpy as np, pinocchio as pin, stewart_pin as stp
    >>> frame, corners = [[0, 0], [4, 0], [4, 3], [0, 3]], [[-0.1, 0.1], [0.1, 0.1], [0.1, -0.1], [-0.1, -0.1]]
    >>> body = pin.Inertia(5.0, np.zeros(3), 0.05 * np.eye(3))
    >>> robot = stp.cables.cable_robot(frame, corners, platform=body, home=[2, 1.5, 0], tension=(5, 500))
    >>> robot.motors
    ('winch1', 'winch2', 'winch3', 'winch4')
    """
    exits, ends, planar = _points(exits, attachments)
    count = len(exits)
    radii = _numbers("pulleys", pulleys)
    if radii.shape not in ((), (count,)) or (radii < 0).any():
        raise InputError(f"pulleys must be one radius or {count}, none below zero [m], got {pulleys!r}")
    radii = np.broadcast_to(radii, (count,))
    axes = _directions(swivels, count)
    _require_spans(tension=tension, lengths=lengths)
    if not isinstance(platform, pin.Inertia):
        raise InputError(f"platform must be a pinocchio.Inertia, got {type(platform).__name__}")
    if not (np.isfinite(drum) and drum >= 0):
        raise InputError(f"drum must be an inertia of zero or more [kg], got {drum!r}")
    pose, coordinates = _home(home, planar)
    apart = np.array([pose.act(end) for end in ends]) - exits
    paths = cable_paths(apart, axes, radii)
    for k in range(count):
        if paths.free[k] == 0.0:
            raise InputError(
                f"cable {k + 1} has no direction at home: its end is at its exit, on the axis or in the circle of its "
                "pulley; move home, the exit or the attachment"
            )
    links, joints = _platform(platform, planar)
    loops = []
    for k, (leaves, end, length) in enumerate(zip(exits, ends, paths.length, strict=True), start=1):
        links.append(Link(f"drum{k}"))
        joints.append(_winch(k, leaves, axes[k - 1], float(length), tension, lengths, speed, drum))
        loops.append(
            Loop(
                f"cable{k}", JointKind.CABLE, "base", "platform",
                pin.SE3(np.eye(3), leaves), pin.SE3(np.eye(3), end),
                axis=axes[k - 1], length=float(length),
                cable=Cable(f"winch{k}", 1.0, float(radii[k - 1])),
            )
        )  # fmt: skip
    mechanism = Mechanism(
        name, tuple(links), tuple(joints), tuple(loops), platform="platform", home=coordinates
    )
    return build_chain(mechanism, gravity=gravity)


def cable_lengths(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    """Measure the cables from their exits over the pulleys to their ends.

    Parameters
    ----------
    chain
        Closed chain with cables, or a state of it.
    q
        (nq,) configuration, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (n,) in the order of the loops that are cables, by the places of their ends, whether the loops are closed or
        open [m].

    Raises
    ------
    UnsupportedError
        If the chain has no cable.
    """
    state = as_state(chain, q)
    table = state.chain.loop_table
    cables = [k for k, loop in enumerate(state.chain.loops) if loop.kind is JointKind.CABLE]
    if not cables:
        raise UnsupportedError(
            f"{state.chain.name} has no cables; stewart_pin.cables.cable_robot builds some"
        )
    return state.loops.reach[[list(table.rod.loop).index(k) for k in cables]]


def _numbers(name: str, value: ArrayLike) -> FloatArray:
    """Any array of finite numbers."""
    try:
        shape = np.shape(value)
    except ValueError:  # rows of different lengths, which as_array names
        shape = (None, None)
    return as_array(name, value, shape)


def _points(exits: ArrayLike, attachments: ArrayLike) -> tuple[FloatArray, FloatArray, bool]:
    """(n, 3) points on the ground and in the platform frame, and whether the robot is planar."""
    found = [_numbers(name, points) for name, points in (("exits", exits), ("attachments", attachments))]
    for name, points in zip(("exits", "attachments"), found, strict=True):
        if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
            raise InputError(
                f"{name} must be (n, 3) points, or (n, 2) x and z of a planar robot [m], got shape {points.shape}"
            )
    if found[0].shape != found[1].shape:
        raise InputError(
            f"exits and attachments must be as many points, got shapes {found[0].shape} and {found[1].shape}"
        )
    planar = found[0].shape[1] == 2
    if planar:
        found = [np.insert(points, 1, 0.0, axis=1) for points in found]
    return found[0], found[1], planar


def _directions(swivels: ArrayLike, count: int) -> FloatArray:
    """(n, 3) unit vectors."""
    given = _numbers("swivels", swivels)
    if given.shape not in ((3,), (count, 3)):
        raise InputError(f"swivels must be one direction (3,) or ({count}, 3), got shape {given.shape}")
    sizes = np.linalg.norm(given, axis=-1, keepdims=True)
    if not sizes.all():
        raise InputError(
            "swivels hold a direction of length zero; give the way in which the cable comes to its exit"
        )
    return np.broadcast_to(given / sizes, (count, 3))


def _require_spans(**spans: tuple[float, float]) -> None:
    for argument, (least, greatest) in spans.items():
        if not 0 <= least < greatest:
            raise InputError(
                f"{argument} must be (least, greatest) with 0 <= least < greatest, got ({least}, {greatest})"
            )


def _home(home: pin.SE3 | ArrayLike, planar: bool) -> tuple[pin.SE3, dict[str, FloatArray]]:
    """Pose of the platform, and the values of its joints."""
    if not planar:
        pose = as_pose("home", home)
        return pose, {"platform_pose": pin.SE3ToXYZQUAT(pose)}
    if isinstance(home, pin.SE3):
        pose = as_pose("home", home)
        rotation, point = np.array(pose.rotation), np.array(pose.translation)
        turn = float(np.arctan2(rotation[2, 0], rotation[0, 0]))
        if not np.allclose(rotation, pin.exp3(-_Y * turn), atol=1e-9) or abs(point[1]) > 1e-9:
            raise InputError(
                "home leaves the plane y = 0 of a planar robot; give x, z and the turn from x to z"
            )
        x, z = float(point[0]), float(point[2])
    else:
        x, z, turn = (float(value) for value in as_array("home", home, (3,)))
    values = {"platform_x": x, "platform_z": z, "platform_turn": turn}
    pose = pin.SE3(pin.exp3(-_Y * turn), np.array([x, 0.0, z]))
    return pose, {joint: np.array([value]) for joint, value in values.items()}


def _platform(platform: pin.Inertia, planar: bool) -> tuple[list[Link], list[Joint]]:
    """Ground, platform and the joints that let it move."""
    here, links = pin.SE3.Identity(), [Link("base"), Link("platform", platform)]
    if not planar:
        return links, [Joint("platform_pose", JointKind.FLOATING, "base", "platform", here)]
    return [*links, Link("platform_slide1"), Link("platform_slide2")], [
        Joint("platform_x", JointKind.PRISMATIC, "base", "platform_slide1", here, _X),
        Joint("platform_z", JointKind.PRISMATIC, "platform_slide1", "platform_slide2", here, _Z),
        Joint("platform_turn", JointKind.REVOLUTE, "platform_slide2", "platform", here, -_Y),
    ]


def _winch(
    number: int,
    leaves: FloatArray,
    axis: FloatArray,
    length: float,
    tension: tuple[float, float],
    lengths: tuple[float, float],
    speed: float,
    drum: float,
) -> Joint:
    """Slide that winds in the cable, away from its exit; what is wound in at home is zero."""
    return Joint(
        f"winch{number}", JointKind.PRISMATIC, "base", f"drum{number}", pin.SE3(np.eye(3), leaves), -axis,
        length - lengths[1], length - lengths[0], tension, speed, independent=True,
        physics=JointPhysics(armature=drum),
    )  # fmt: skip
