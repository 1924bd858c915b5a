"""Displacements of a step on the manifold: how their rates depend on the velocity of the chain."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.typing import FloatArray, Tangent


class Displacements:
    """Displacements ξ with q = q0 ⊕ ξ of one model.

    Joints with one freedom add up; those that turn about several axes do not, and need a correction.

    Parameters
    ----------
    model
        Tree.
    """

    def __init__(self, model: pin.Model) -> None:
        self._bodies = [joint.idx_v for joint in model.joints[1:] if joint.nv == 6]
        self._balls = [joint.idx_v for joint in model.joints[1:] if joint.nv == 3]

    def rate(self, displacement: Tangent, v: Tangent) -> Tangent:
        """Compute the rate of a displacement that moves the chain at a velocity.

        Parameters
        ----------
        displacement
            (nv,) ξ [m, rad].
        v
            (nv,) tangent velocity at q0 ⊕ ξ [m/s, rad/s].

        Returns
        -------
        numpy.ndarray
            (nv,) ``v + [ξ, v] / 2 + [ξ, [ξ, v]] / 12``, exact to third order in ξ: enough for an integrator of order
            four [m/s, rad/s].

        References
        ----------
        .. [1] A. Iserles, H. Munthe-Kaas, S. Nørsett, A. Zanna, "Lie-group methods", Acta Numerica, 2000, eq. (2.46).
        """
        if not (self._bodies or self._balls):
            return v
        rate = v.copy()
        for k in self._bodies:
            part = slice(k, k + 6)
            step = pin.Motion(displacement[part])
            once = step ^ pin.Motion(v[part])
            rate[part] += once.vector / 2 + (step ^ once).vector / 12
        for k in self._balls:
            part = slice(k, k + 3)
            turn = pin.skew(np.array(displacement[part]))
            once = turn @ v[part]
            rate[part] += once / 2 + turn @ once / 12
        return rate


def displacement_jacobian(model: pin.Model, q: FloatArray, q_moved: FloatArray) -> FloatArray:
    """Differentiate a displacement by where it leads.

    Parameters
    ----------
    model
        Tree.
    q, q_moved
        (nq,) configurations [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nv, nv) rate of ``difference(q, q_moved)`` per tangent velocity at `q_moved`, dimensionless.
    """
    return pin.dDifference(model, q, q_moved, pin.ArgumentPosition.ARG1)
