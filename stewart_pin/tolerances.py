"""The few numbers by which the package tells small from nothing, each with its reason.

All are in natural units: lengths in robot sizes, angles in radians, motions and rows of equations of size one.
"""

from __future__ import annotations

import numpy as np

EPS = float(np.finfo(float).eps)
"""Round-off of one operation."""

CLOSED = 2e-13
"""Largest gap of a closed loop: a thousand units of round-off. What is solved for goes on to a tenth of it as long as
that makes the gap smaller."""

ROUND_OFF_STEPS = 64
"""Units of round-off that placing a chain of joints may cost: the floor of every gap, where a small robot stands far
from the origin."""

CONSISTENT = 1e-6
"""How far a state of a user may be from closed loops (per s, s²), relative where the state itself is larger: printed
digits, not a wrong state."""

PRINTED = 1e-5
"""How far six printed digits move what would be exact, in robot sizes, radians and shares: an angle near π keeps its
fifth decimal to half a unit, and two or three of them add up. What is nearer than this is read as meant; what the miss
costs is judged by numbers."""

SINGULAR = 1e-6
"""Share of its usual size at which a singular value that belongs to the mechanism counts as lost. A configuration known
to 13 digits is only known to half of them where loops depend on each other; every verb raises at this nearness."""

DIGITS = 1e-3
"""Share of an answer that the error of a state may cost. A state whose loops are open by more than this share of its
distance to a singularity is refused: three digits of the answer could not be promised."""

NOTHING = 1e-11
"""Singular values below this are round-off at a configuration that is polished to the last bit."""

GAP = 1e-6
"""Ratio of neighbouring singular values, and size of the smaller one, from which on the larger belongs to the mechanism
and the smaller to round-off: far from both, on a logarithmic scale."""

NO_INERTIA = 1e-12
"""Inertia of a motion, relative to the largest, below which it has none: a thousand units of round-off."""

TAKES_PART = 1e-8
"""Share of a motion, of norm one, below which a joint or a link does not take part: round-off of null spaces."""

UNIT_QUATERNION = 1e-6
"""Deviation from unit length that printed or integrated quaternions may show."""

FAR_FROM_SINGULAR = 1e-4
"""Reciprocal condition number of a square system, such as the rows of loops and motors, from which on no singularity
is near: a hundred times `SINGULAR`, since it is estimated, in another norm."""
