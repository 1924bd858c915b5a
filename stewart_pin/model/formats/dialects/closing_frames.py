"""Frames called ``closing_NAME_1`` and ``closing_NAME_2``, as onshape-to-robot exports a mate ``closing_NAME``.

The type of the mate is not in the URDF. For hinges the exporter adds a second pair of frames, ``closing_NAME_1_z``
and ``closing_NAME_2_z``, farther up the axis, which are read as a revolute loop about z. A pair alone is taken
for a ball, the weakest that all mates share; to say otherwise, name the pair in a YAML beside the URDF (see
`gepetto`), with the type that it is.

References
----------
.. [1] onshape-to-robot documentation, "Kinematic loops".
"""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import JointKind, Loop, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import Dialect, Parts, add_parts, carrier

_NAME = re.compile(r"(closing_.+)_([12])(_z)?")
_TITLE = "frames closing_*_1, closing_*_2"
_ASSUMED = "taken for a ball: the file does not say what the mate was; if it is more, name the pair in a YAML beside it"


def _complete(mechanism: Mechanism) -> Mechanism:
    ends: dict[tuple[str, str], dict[str, str]] = {}
    for link in mechanism.links:
        found = _NAME.fullmatch(link.name)
        if found:
            ends.setdefault((found[1], found[3] or ""), {})[found[2]] = link.name
    for (stem, suffix), pair in ends.items():
        if len(pair) < 2 or (suffix and (stem, "") not in ends):
            raise FileFormatError(
                f"frame '{next(iter(pair.values()))}' is called like half of a pair that closes a loop, and the other "
                "half is missing; add it, or rename the frame",
                path=mechanism.source,
                culprit=next(iter(pair.values())),
            )
        if not suffix:
            mechanism = _closed(mechanism, stem, pair, hinge=(stem, "_z") in ends)
    return mechanism


def _closed(mechanism: Mechanism, stem: str, pair: dict[str, str], *, hinge: bool) -> Mechanism:
    (link1, place1), (link2, place2) = (carrier(mechanism, pair[end]) for end in "12")
    for loop in mechanism.loops:
        ends = [(loop.link1, loop.placement1), (loop.link2, loop.placement2)]
        wanted = [(link1, place1), (link2, place2)]
        if loop.name == stem or _same(ends, wanted) or _same(ends[::-1], wanted):
            return mechanism
    kind = JointKind.REVOLUTE if hinge else JointKind.SPHERICAL
    parts = Parts(loops=(Loop(stem, kind, link1, link2, place1, place2),))
    if not hinge:
        parts = Parts(loops=parts.loops, notes=(Note(f"loop '{stem}'", _ASSUMED, Outcome.CHANGED),))
    return add_parts(mechanism, parts, _TITLE)


def _same(ends: list[tuple[str, pin.SE3]], wanted: list[tuple[str, pin.SE3]]) -> bool:
    """Tell whether two pairs of frames have the same links and origins."""
    return all(
        link == other and np.allclose(place.translation, there.translation, rtol=0, atol=1e-9)
        for (link, place), (other, there) in zip(ends, wanted, strict=True)
    )


DIALECT = Dialect("closing_frames", _TITLE, complete=_complete)
