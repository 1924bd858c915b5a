"""How finely a file prints its geometry: what its last digits leave open.

A number of four and more significant digits counts as rounded at its last digit; shorter ones count as meant.
Inertias that only their last digit makes impossible are mended.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import radians
from pathlib import Path

import numpy as np
from lxml import etree

from stewart_pin.model.formats.xml import read_xml, shown_tag
from stewart_pin.typing import FloatArray

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(?:[eE]([-+]?\d+))?(?![\w.])")
_ROUNDED = 4
"""Significant digits from which on a number counts as rounded."""
_EXACT = 15
"""Decimals from which on a number is as fine as a float, or nothing but round-off."""

_LENGTHS = frozenset({"xyz", "pos", "anchor", "xyz_offset", "proximal_to_common", "distal_to_common"})
_ANGLES = frozenset({"rpy", "quat", "euler", "axis", "axis2", "axisangle", "xyaxes", "zaxis", "quat_xyzw"})
_BOTH = frozenset({"relpose", "pose"})
_ASIDE = frozenset(
    {"inertial", "visual", "collision", "geom", "material", "asset", "mesh", "camera", "light", "sensor"}
)
"""Elements whose numbers place no joint."""


@dataclass(frozen=True)
class Precision:
    """Half a unit of the last digit of the coarsest number.

    Attributes
    ----------
    length
        Of lengths [m]; 0 where they are exact.
    angle
        Of angles and directions [rad]; 0 where they are exact.
    """

    length: float = 0.0
    angle: float = 0.0

    def __bool__(self) -> bool:
        """Tell whether digits leave anything open."""
        return self.length > 0 or self.angle > 0


def printed_precision(path: Path, side_car: Path | None = None) -> Precision:
    """Find how finely a file prints where joints and loops are attached.

    Parameters
    ----------
    path
        A file that has been read as a mechanism.
    side_car
        File of its loops, or None.

    Returns
    -------
    Precision
        What its digits leave open.
    """
    length = angle = 0.0
    for kind, text, degrees in _texts(read_xml(path)):
        numbers = [_half_unit(match) for match in _NUMBER.finditer(text)]
        turned = [numbers[3:] if kind == "pose" else numbers if kind == "angle" else []][0]
        shifted = [numbers[:3] if kind == "pose" else numbers if kind == "length" else []][0]
        unit = radians(1.0) if degrees else 1.0
        length = max([length, *shifted])
        angle = max([angle, *(unit * number for number in turned)])
    if side_car is not None and side_car.exists():
        numbers = [_half_unit(match) for match in _NUMBER.finditer(side_car.read_text(errors="replace"))]
        length, angle = max([length, *numbers]), max([angle, *numbers])
    return Precision(length, angle)


def _texts(root: etree._Element) -> Iterator[tuple[str, str, bool]]:
    """Texts that place something: what they hold, the text, and whether its angles are degrees."""
    in_degrees = shown_tag(root) == "mujoco" and not any(
        element.get("angle") == "radian" for element in root.iter("compiler")
    )
    yield from _texts_within(root, in_degrees=in_degrees)


def _texts_within(element: etree._Element, *, in_degrees: bool) -> Iterator[tuple[str, str, bool]]:
    if not isinstance(element.tag, str) or (tag := shown_tag(element)) in _ASIDE:
        return
    for name, value in element.attrib.items():
        if name in _LENGTHS:
            # The axis of a joint is told as xyz as well.
            yield "angle" if tag in ("axis", "axis2") else "length", str(value), False
        elif name in _ANGLES:
            yield "angle", str(value), in_degrees and name == "euler"
        elif name in _BOTH:
            yield "pose", str(value), False
    if tag == "pose":
        quaternion = element.get("rotation_format") == "quat_xyzw"
        yield "pose", element.text or "", element.get("degrees") == "true" and not quaternion
    elif tag == "xyz":
        yield "angle", element.text or "", False
    for child in element:
        yield from _texts_within(child, in_degrees=in_degrees)


def _half_unit(number: re.Match[str]) -> float:
    """Half a unit of the last digit of a number that is rounded, else 0."""
    mantissa, exponent = number.group(1), int(number.group(2) or 0)
    whole, _, fraction = mantissa.partition(".")
    decimals = len(fraction) - exponent
    significant = len((whole + fraction).lstrip("0"))
    zero = not significant
    rounded = significant >= _ROUNDED and len(fraction) > 0
    if zero or not rounded or decimals >= _EXACT:
        return 0.0
    return 0.5 * 10.0**-decimals


def half_unit(text: str) -> float:
    """Find what the last digit of a number leaves open.

    Parameters
    ----------
    text
        One printed number.

    Returns
    -------
    float
        Half a unit of its last digit if it counts as rounded, else 0.
    """
    number = _NUMBER.fullmatch(text.strip())
    return 0.0 if number is None else _half_unit(number)


# ----------------------------------------------------------------------------------------------------
# Inertias of real bodies whose last printed digit makes them odd
#
# A flat plate, a thin rod and a point on a rod have one principal moment that is the sum of the others. Rounded to the
# digits of a file it is a little more.
# ----------------------------------------------------------------------------------------------------

_ROUNDS = 40
"""Steps, each of which leaves a third of what is odd."""
_REACH = 3.0
"""Change of a moment per change of an entry: the spectral norm of a matrix (3, 3) whose entries are one at most."""


def within_digits(matrix: FloatArray, texts: Iterable[str]) -> tuple[FloatArray, float]:
    """Bring principal moments back to those of a body, where the rounding of their entries has led them off.

    Parameters
    ----------
    matrix
        (3, 3) rotational inertia as it was read, symmetric [kg m²].
    texts
        Its entries as they are printed.

    Returns
    -------
    tuple
        (3, 3) the nearest inertia that a body has, or the one given where digits do not explain what is odd, or nothing
        is; and by how much its moments were moved [kg m²].
    """
    rounding = max((half_unit(text) for text in texts), default=0.0)
    if not (rounding > 0 and np.isfinite(matrix).all()):
        return matrix, 0.0
    moments, axes = np.linalg.eigh(matrix)
    real = moments.copy()
    for _ in range(_ROUNDS):
        largest = int(np.argmax(real))
        odd = float(2 * real[largest] - real.sum())
        if odd <= 0:
            break
        # All three give way alike, the least change; the second largest may be the largest then.
        real += odd / 3
        real[largest] -= 2 * odd / 3
    moved = float(np.abs(real - moments).max())
    if not 0 < moved <= _REACH * rounding:
        return matrix, 0.0
    return (axes * real) @ axes.T, moved


def moved_by_digits(move: float) -> str:
    """Tell it for the report.

    Parameters
    ----------
    move
        By how much moments were moved [kg m²].

    Returns
    -------
    str
        What was made of the inertia.
    """
    return f"its principal moments were moved by {move:.2g} kg m², as its digits leave open, to be those of a body"
