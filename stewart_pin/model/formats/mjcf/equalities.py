"""Loops and couplings as equality constraints of MJCF, where those hold exactly the same motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Coupling, JointKind, Loop, Mechanism
from stewart_pin.model.formats.xml import number_text
from stewart_pin.typing import FloatArray

_COEFFICIENTS = 5
"""MuJoCo's polynomials between two joints are of degree four."""

PlaceSite = Callable[[str, str, pin.SE3], str]
"""Makes a site on a link: (link, name, placement) to name."""


def write_equalities(
    root: etree._Element, mechanism: Mechanism, at_zero: Mapping[str, pin.SE3], place_site: PlaceSite
) -> None:
    """Write loops and couplings.

    Parameters
    ----------
    root
        The ``<mujoco>`` element, its bodies written; gets ``<tendon>`` and ``<equality>``.
    mechanism
        What to write.
    at_zero
        Placement of every body in the world at zero joint values.
    place_site
        Makes a site on a body.

    Raises
    ------
    UnsupportedError
        If MuJoCo cannot express a loop or a coupling; names it and the remedy.
    """
    writer = _EqualityWriter(at_zero, place_site)
    for loop in mechanism.loops:
        writer.loop(loop)
    for coupling in mechanism.couplings:
        writer.coupling(coupling)
    if len(writer.tendons):
        root.append(writer.tendons)
    root.append(writer.equality)


class _EqualityWriter:
    def __init__(self, at_zero: Mapping[str, pin.SE3], place_site: PlaceSite) -> None:
        self.at_zero = at_zero
        self.place_site = place_site
        self.equality = etree.Element("equality")
        self.tendons = etree.Element("tendon")
        self.names: set[str] = set()

    def loop(self, loop: Loop) -> None:
        # Arms as long as the links are large: the constraints then weigh alike.
        reach = (
            max(float(np.linalg.norm(end.translation)) for end in (loop.placement1, loop.placement2)) or 1.0
        )
        axis, arm1, arm2 = f"{loop.name}_axis", loop.axis * reach, loop.axis2 * reach
        match loop.kind:
            case JointKind.SPHERICAL:
                self._tie("connect", loop, loop.name)
            case JointKind.FIXED:
                self._tie("weld", loop, loop.name)
            case JointKind.REVOLUTE:
                # Two points of the axis: the sixth row is redundant.
                self._tie("connect", loop, loop.name)
                self._tie("connect", loop, axis, arm1, arm1)
            case JointKind.UNIVERSAL:
                # Two arms of one length from a common centre are perpendicular where their ends are √2 of it apart.
                self._tie("connect", loop, loop.name)
                self._rod(loop, axis, np.sqrt(2) * reach, arm1, arm2)
            case JointKind.DISTANCE:
                self._rod(loop, loop.name, loop.length)
            case _:
                raise UnsupportedError(
                    f"loop '{loop.name}' is {loop.kind}; MuJoCo closes spherical, fixed, revolute, universal and "
                    "distance loops: cut the loop at another joint"
                )

    def coupling(self, coupling: Coupling) -> None:
        polynomial = np.trim_zeros(np.array(coupling.polynomial), "b")
        if len(polynomial) > _COEFFICIENTS:
            raise UnsupportedError(
                f"coupling '{coupling.name}' is of degree {len(polynomial) - 1}; MuJoCo couples joints by polynomials "
                f"of degree {_COEFFICIENTS - 1} at most"
            )
        element = etree.SubElement(
            self.equality, "joint", name=self._fresh(coupling.name), joint1=coupling.joint1
        )
        if coupling.joint2 is not None:
            element.set("joint2", coupling.joint2)
        padded = np.pad(polynomial, (0, _COEFFICIENTS - len(polynomial)))
        element.set("polycoef", number_text(padded))

    def _fresh(self, name: str) -> str:
        if name in self.names:
            raise UnsupportedError(
                f"two constraints would be called '{name}'; rename the loop or the coupling"
            )
        self.names.add(name)
        return name

    def _ends(
        self, loop: Loop, name: str, shift1: FloatArray, shift2: FloatArray
    ) -> list[tuple[str, str, pin.SE3]]:
        return [
            (loop.link1, f"{name}_1", loop.placement1 * pin.SE3(np.eye(3), shift1)),
            (loop.link2, f"{name}_2", loop.placement2 * pin.SE3(np.eye(3), shift2)),
        ]

    def _tie(
        self,
        tag: str,
        loop: Loop,
        name: str,
        shift1: FloatArray | None = None,
        shift2: FloatArray | None = None,
    ) -> None:
        ends = self._ends(loop, name, _or_zero(shift1), _or_zero(shift2))
        site1, site2 = (self.place_site(*end) for end in ends)
        etree.SubElement(self.equality, tag, name=self._fresh(name), site1=site1, site2=site2)

    def _rod(
        self,
        loop: Loop,
        name: str,
        length: float,
        shift1: FloatArray | None = None,
        shift2: FloatArray | None = None,
    ) -> None:
        ends = self._ends(loop, name, _or_zero(shift1), _or_zero(shift2))
        spatial = etree.SubElement(self.tendons, "spatial", name=name)
        for end in ends:
            etree.SubElement(spatial, "site", site=self.place_site(*end))
        # The constraint is length - (length at zero joint values) = first coefficient.
        origins = [self.at_zero[link].act(placement.translation) for link, _, placement in ends]
        excess = length - float(np.linalg.norm(origins[1] - origins[0]))
        coefficients = number_text([excess, 0, 0, 0, 0])
        etree.SubElement(self.equality, "tendon", name=self._fresh(name), tendon1=name, polycoef=coefficients)


def _or_zero(shift: FloatArray | None) -> FloatArray:
    return np.zeros(3) if shift is None else shift
