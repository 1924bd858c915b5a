"""The points at which joints and loops hold the bodies of a chain: what a body looks like when no file says so."""

from __future__ import annotations

import numpy as np

from stewart_pin.model.description import Joint, JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_SAME = 1e-6
"""Points nearer than this are one point, in robot sizes."""


def body_points(chain: ClosedChain) -> dict[str, FloatArray]:
    """Collect the points of every link.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    dict
        ``{link: (n, 3) points in the link frame [m]}``, each point once.
    """
    points: dict[str, list[FloatArray]] = {link.name: [] for link in chain.mechanism.links}
    idle = [joint for joint in chain.mechanism.joints if _holds_nothing(chain, joint)]
    for joint in chain.mechanism.joints:
        if any(joint is other for other in idle):
            points[joint.child].append(np.zeros(3))
        elif joint.kind is not JointKind.FLOATING:  # which holds nothing together
            points[joint.parent].append(np.array(joint.placement.translation))
            points[joint.child].append(np.zeros(3))
    for loop in chain.loops:
        points[loop.link1].append(np.array(loop.placement1.translation))
        points[loop.link2].append(np.array(loop.placement2.translation))
    for (
        joint
    ) in idle:  # a flange is the only far end that a last link has; a payload is no corner of a platform
        if len(_distinct(points[joint.parent], _SAME * chain.length_scale)) < 2:
            points[joint.parent].append(np.array(joint.placement.translation))
    return {link: _distinct(found, _SAME * chain.length_scale) for link, found in points.items()}


def _holds_nothing(chain: ClosedChain, joint: Joint) -> bool:
    """Tell whether a joint fixes a link that no other joint or loop holds, such as a payload or a frame."""
    held = {other.parent for other in chain.mechanism.joints}
    held |= {link for loop in chain.loops for link in (loop.link1, loop.link2)}
    return joint.kind is JointKind.FIXED and joint.child not in held


def _distinct(points: list[FloatArray], same: float) -> FloatArray:
    kept: list[FloatArray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > same for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, 3)
