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

ROUND_OFF = ROUND_OFF_STEPS * EPS
"""How far beyond reach a leg or an arm counts as just stretched, and by how much lengths that are one may differ,
relative to the lengths they are computed from: what placing a chain may cost."""

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

NO_INERTIA = 1e-12
"""Inertia of a motion, relative to the largest, below which it has none: a thousand units of round-off."""

TAKES_PART = 1e-8
"""Share of a motion, of norm one, below which a joint or a link does not take part: round-off of null spaces."""

UNIT_QUATERNION = 1e-6
"""Deviation from unit length that printed or integrated quaternions may show."""

FAR_FROM_SINGULAR = 1e-4
"""Reciprocal condition number of a square system, such as the rows of loops and motors, from which on no singularity
is near: a hundred times `SINGULAR`, since it is estimated, in another norm."""

JACOBIAN_SINGULAR = 1e-12
"""Smallest over largest singular value of a Jacobian of legs or actuators below which solving it returns noise: some
thousand units of round-off."""

ROOT_BAND = 0.05
"""Distance from the unit circle within which a root may be a real one, scattered: six-fold by round-off to the power
1/6."""

CONTRACTION = 0.25
"""Largest ratio of the second Newton step to the first where a branch is certainly kept: half the radius of the theorem
of Newton and Kantorovich for the first."""

SHORTEST_STRETCH = 1e-5
"""Share of a path below which a stretch is not shortened any more: where so short a one fails, there is a
singularity."""

AT_LIMIT = 1e-9
"""Excess over a limit that is still round-off: of positions in robot sizes or radians, of the rest as a share of the
limit."""

HOME_IN_FILE = 1e-3
"""How far closing the loops may move a joint of a home printed with few digits, and how far home may stand outside a
range, in robot sizes and radians: what three printed digits may cost. More is an error."""

NO_DIRECTION = 1e-12
"""Length below which an axis or a quaternion of a file has no direction: what is left of round-off of numbers that
cancel, while a length that is meant is about one."""

SHOWN = 1e-6
"""Share of the largest entry below which an entry is not spelled out: round-off, that would hide what matters."""

WHOLE_STEPS = 1e-6
"""How far a duration may be from a whole number of steps, relative to it: printed digits, not another step."""

AT_REST = 1e-12
"""Rate, in robot sizes or radians per second, below which a joint with dry friction is at rest: rounding of a velocity
that is meant to be none."""
AT_REST_BESIDE = 1e-9
"""The same relative to the fastest joint: rounding of what loops make of a velocity, near a singularity as well."""
