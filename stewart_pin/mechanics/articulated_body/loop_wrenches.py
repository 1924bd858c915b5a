"""Loops as wrenches: each loop row is a wrench that the closure transmits from link 1 to link 2.

With v_rel the spatial velocity of link 2 relative to link 1 and T the wrench of a row, the rate of the gap is Tᵀ v_rel.
T belongs to link 1 but for what the joint itself moves, so that its rate is T° + v₁ ×* T, with T° as seen from link 1.
Everything stands in base coordinates, [angular; linear]. No formula is shared with `stewart_pin.state`.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.errors import SingularityError
from stewart_pin.mechanics.articulated_body.bodies import Body
from stewart_pin.mechanics.articulated_body.passes import BodyMotion
from stewart_pin.mechanics.articulated_body.spatial_vectors import cross_motion, skew
from stewart_pin.model.description import Loop
from stewart_pin.model.loop_rows import AngleRow, LengthRow, NormalRow, closure_rows
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class LoopWrenches:
    """Rows of one loop.

    Attributes
    ----------
    body1, body2
        Numbers of the bodies.
    wrench1, wrench2
        (6, r) wrenches in the coordinates of either body [1 and m].
    gap
        (r,) residual of the rows [m and 1].
    rate
        (r,) its derivative [m/s and 1/s].
    bias
        (r,) its second derivative without acceleration of the bodies [m/s² and 1/s²].
    """

    body1: int
    body2: int
    wrench1: FloatArray
    wrench2: FloatArray
    gap: FloatArray
    rate: FloatArray
    bias: FloatArray


def loop_wrenches(loop: Loop, bodies: Sequence[Body], motion: BodyMotion) -> LoopWrenches:
    """Evaluate the rows of a loop.

    Parameters
    ----------
    loop
        The loop.
    bodies
        Bodies of the tree.
    motion
        Their motion, from the first pass.

    Returns
    -------
    LoopWrenches
        Wrenches, gap, rate and bias.

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    number = {body.link: i for i, body in enumerate(bodies)}
    one, two = number[loop.link1], number[loop.link2]
    axes1, origin1 = _loop_frame(motion.to_base[one], loop.placement1)
    axes2, origin2 = _loop_frame(motion.to_base[two], loop.placement2)
    velocity1, velocity2 = (np.linalg.solve(motion.to_base[k], motion.velocity[k]) for k in (one, two))
    relative = velocity2 - velocity1
    arm, spin = skew(origin2), skew(relative[:3])
    slide = relative[3:] - arm @ relative[:3]  # of frame 2's origin, as seen from link 1: v + ω × p
    sliding, reach, none = skew(slide), origin2 - origin1, np.zeros(3)
    wrenches, rates, gaps = [], [], []
    for row in closure_rows(loop):
        match row:
            case NormalRow():
                n = axes1 @ row.normal
                gaps.append(n @ reach)
                wrenches.append(np.concatenate([arm @ n, n]))
                rates.append(np.concatenate([sliding @ n, none]))
            case AngleRow():
                u1, u2 = axes1 @ row.u1, axes2 @ row.u2
                gaps.append(u1 @ u2)
                wrenches.append(np.concatenate([-skew(u1) @ u2, none]))  # u2 × u1
                rates.append(np.concatenate([-skew(u1) @ (spin @ u2), none]))
            case LengthRow():
                distance = float(np.linalg.norm(reach))
                if distance == 0.0:
                    raise SingularityError(
                        f"the ends of the distance loop '{loop.name}' coincide, so its direction is undefined",
                        smallest_singular_value=0.0,
                    )
                e = reach / distance
                turn = (slide - e * (e @ slide)) / distance
                gaps.append(distance - row.length)
                wrenches.append(np.concatenate([arm @ e, e]))
                rates.append(np.concatenate([sliding @ e + arm @ turn, turn]))
    wrench = np.array(wrenches).reshape(-1, 6).T
    apparent_rate = np.array(rates).reshape(-1, 6)
    return LoopWrenches(
        body1=one,
        body2=two,
        wrench1=np.linalg.solve(motion.to_base[one].T, wrench),  # f₀ = ⁱX₀ᵀ fᵢ
        wrench2=np.linalg.solve(motion.to_base[two].T, wrench),
        gap=np.array(gaps),
        rate=wrench.T @ relative,
        # (T° + v₁ ×* T)ᵀ v_rel, and (v ×*)ᵀ = -(v ×)
        bias=apparent_rate @ relative - wrench.T @ (cross_motion(velocity1) @ relative),
    )


def _loop_frame(to_base: FloatArray, placement: pin.SE3) -> tuple[FloatArray, FloatArray]:
    """Axes (3, 3) and origin (3,) of a loop frame in base coordinates, read off ⁱX₀ = [[E, 0], [-E r×, E]]."""
    rotation = to_base[:3, :3].T
    cross = -rotation @ to_base[3:, :3]
    origin = np.array([cross[2, 1], cross[0, 2], cross[1, 0]])
    return rotation @ placement.rotation, origin + rotation @ placement.translation
