"""The zoo: mechanisms of the literature, what is known of each, and what the package still gets wrong."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

import stewart_pin as stp
from stewart_pin.building.loading import urdf_root

FOLDER = Path(__file__).parent / "urdf"


@dataclass(frozen=True)
class Row:
    """A mechanism: its freedoms, and what its equations repeat.

    `mobility` counts the freedoms at and around home, those of idle spins among them; they are finite motions and the
    same number instantaneously. `excess` is by how much it exceeds the count of Kutzbach for space: the rank that the
    equations lack (3 for each planar or spherical loop).
    """

    name: str
    mobility: int
    excess: int
    source: str
    idle: int = 0
    note: str = ""

    @property
    def bundled(self) -> bool:
        return self.name in stp.robots()

    @property
    def file(self) -> Path:
        folder = urdf_root() / self.name if self.bundled else FOLDER
        return folder / f"{self.name}.urdf"


_NORTON = "Norton, Design of Machinery, 2012"
_HUNT = "Hunt, Kinematic Geometry of Mechanisms, 1978"
_MERLET = "Merlet, Parallel Robots, 2006"
_CHIANG = "Chiang, Kinematics of Spherical Mechanisms, 1988"
_HARRISBERGER = "Harrisberger, A number synthesis survey of three-dimensional mechanisms, 1965"
_BRICARD = "Bricard, Leçons de cinématique, 1927"
_MULLER = "Müller, Epicyclic Drive Trains, 1982"
_ZHOU = "Zhou and Tsagarakis, A humanoid parallel ankle mechanism, 2018"

ZOO = (
    Row("crank_rocker", 1, 3, _NORTON, note="Grashof, shortest bar driven"),
    Row("drag_link", 1, 3, _NORTON, note="Grashof, shortest bar fixed"),
    Row("triple_rocker", 1, 3, _NORTON, note="not Grashof"),
    Row("kite", 1, 3, _NORTON, note="change point: equal neighbours"),
    Row("parallelogram", 1, 3, _NORTON, note="change point: equal opposites"),
    Row("antiparallelogram", 1, 3, _NORTON, note="change point: the crossed branch"),
    Row("chebyshev", 1, 3, _NORTON),
    Row("watt_line", 1, 3, _NORTON),
    Row("roberts", 1, 3, _NORTON),
    Row("hoeken", 1, 3, _NORTON),
    Row("peaucellier", 1, 9, "Kempe, How to Draw a Straight Line, 1877"),
    Row("slider_crank", 1, 3, _NORTON),
    Row("slider_crank_offset", 1, 3, _NORTON),
    Row("whitworth", 1, 3, _NORTON, note="inverted slider-crank"),
    Row("scotch_yoke", 1, 3, _NORTON),
    Row("lever_on_a_cylinder", 1, 3, _NORTON, note="oscillating cylinder"),
    Row("elliptic_trammel", 1, 3, _NORTON),
    Row("oldham", 1, 3, _HUNT),
    Row("wedge", 1, 4, _HUNT, note="three slides in a plane"),
    Row("watt_six_bar", 1, 6, _NORTON),
    Row("stephenson_six_bar", 1, 6, _NORTON),
    Row("jansen_leg", 1, 9, "Jansen, The Great Pretender, 2007"),
    Row("parallel_cranks", 1, 7, _HUNT, note="Grübler counts 0 in the plane"),
    Row("double_parallelogram", 2, 6, _NORTON),
    Row("pantograph", 2, 3, _NORTON),
    Row("scissor_lift", 1, 9, _NORTON),
    Row("five_bar_5r", 2, 3, "Liu, Wang and Pritschow, Planar 5R symmetrical parallel mechanisms, 2006"),
    Row("five_bar_prrrp", 2, 3, _MERLET),
    Row("planar_3rrr", 3, 6, "Gosselin and Angeles, Optimum design of a planar manipulator, 1988"),
    Row("planar_3rpr", 3, 6, "Merlet, Direct kinematics of planar parallel manipulators, 1996"),
    Row("planar_3prr", 3, 6, "Merlet, Direct kinematics of planar parallel manipulators, 1996"),
    Row("bennett", 1, 3, "Bennett, A new mechanism, 1903"),
    Row("goldberg_5r", 1, 2, "Goldberg, New five-bar and six-bar linkages, 1943"),
    Row("bricard_line_symmetric", 1, 1, _BRICARD),
    Row("bricard_plane_symmetric", 1, 1, _BRICARD),
    Row("bricard_trihedral", 1, 1, _BRICARD, note="threefold symmetric, neighbours at right angles"),
    Row("sarrus", 1, 1, "Sarrus, Note sur la transformation des mouvements, 1853"),
    Row("plano_spherical_6r", 1, 1, "Bennett, The parallel motion of Sarrut, 1905"),
    Row("double_spherical_6r", 1, 1, _HUNT),
    Row("spherical_4r", 1, 3, _CHIANG),
    Row("spherical_5r", 2, 3, _CHIANG),
    Row("cardan_shaft", 1, 3, _CHIANG, note="Hooke's joint"),
    Row("double_cardan", 1, 0, _HUNT, note="with a sleeve between the joints"),
    Row("agile_eye", 3, 6, "Gosselin and Hamel, The agile eye, 1994"),
    Row(
        "spherical_wrist_parallel", 3, 6, "Asada and Cro Granito, Kinematic and static characterization, 1985"
    ),
    Row("rssr", 2, 0, _HARRISBERGER, idle=1, note="the rod spins"),
    Row("rssp", 2, 0, _HARRISBERGER, idle=1, note="the rod spins"),
    Row("rscr", 1, 0, _HARRISBERGER),
    Row("rccc", 1, 0, _HARRISBERGER),
    Row("planetary_gear", 1, 0, _MULLER, note="ring fixed"),
    Row("bevel_differential", 2, 0, _MULLER),
    Row("rack_and_pinion", 1, 3, _NORTON, note="the rack drives a flap"),
    Row(
        "screw_jack",
        1,
        6,
        _NORTON,
        note="rhombus with a screw across and toothed feet: its gear repeats one row",
    ),
    Row("door_on_two_hinges", 1, 5, _HUNT),
    Row("three_rps", 3, 0, "Hunt, Structural kinematics of in-parallel-actuated robot arms, 1983"),
    Row("tripod_3prs", 3, 0, "Carretero et al., Kinematic analysis of a new 3-dof manipulator, 2000"),
    Row("tripod_3upu", 3, 0, "Tsai, Kinematics of a three-dof platform with extensible limbs, 1996"),
    Row("translating_3puu", 3, 0, "Tsai and Joshi, Kinematic analysis of 3-dof position mechanisms, 2002"),
    Row("three_rrs", 3, 0, _MERLET),
    Row(
        "linear_delta",
        9,
        0,
        "Clavel, Device for the movement and positioning of an element in space, 1990",
        idle=6,
    ),
    Row(
        "par4",
        12,
        4,
        "Nabat et al., Par4: very high speed parallel robot for pick-and-place, 2005",
        idle=8,
        note="the plate is a planar loop, and its two parts do not turn for four chains that each say so",
    ),
    Row("schoenflies_4puu", 4, 2, "Kong and Gosselin, Type synthesis of 3T1R parallel manipulators, 2004"),
    Row("tricept", 3, 0, "Siciliano, The Tricept robot, 1999"),
    Row("exechon", 3, 2, "Bi and Jin, Kinematic modeling of Exechon, 2011"),
    Row("gough_6ups", 6, 0, "Gough and Whitehall, Universal tyre test machine, 1962"),
    Row("gough_6sps", 12, 0, _MERLET, idle=6, note="each leg spins"),
    Row("hexaglide", 6, 0, "Honegger et al., Adaptive control of the Hexaglide, 1997"),
    Row("delta_hinges", 3, 12, "Tsai, Walsh and Stamper, A novel three-dof translational platform, 1996"),
    Row("orthoglide", 3, 12, "Chablat and Wenger, Architecture optimization of the Orthoglide, 2003"),
    Row("ankle_2spu", 2, 0, _ZHOU),
    Row("ankle_2rss", 4, 0, _ZHOU, idle=2, note="the push rods spin"),
    Row("double_wishbone", 1, 0, "Blundell and Harty, Multibody Systems Approach to Vehicle Dynamics, 2004"),
)
ROWS = {row.name: row for row in ZOO}
ROBOTS = tuple(name for name in stp.robots() if name not in ROWS)
"""Robots of no row, which every test asks; a robot with a row is asked what the zoo is asked, the dear part slow."""


@cache
def zoo_chain(name: str) -> stp.ClosedChain:
    """Load a mechanism of the zoo once: chains are immutable."""
    return stp.load(ROWS[name].file)


FAILING: dict[tuple[str, str], str] = {}
"""What the package gets wrong: (check, mechanism), and the cause in a line."""

# The rods of robots are round.
_SPIN = "an idle rod whose centre lies beside its axis pulls at the motors wherever its spin stands"
REFUSED: dict[tuple[str, str], str] = {
    **{
        (kind, row.name): _SPIN
        for kind in ("motor", "platform")
        for row in ZOO
        if row.idle and not row.bundled
    },
    ("platform", "bevel_differential"): "the platform, one of the side gears, leaves the other one open",
}
"""Kernels that there cannot be: (coordinates, mechanism), and why; they are refused aloud."""

QUICK = (
    *(
        "crank_rocker",
        "kite",
        "peaucellier",
        "whitworth",
        "lever_on_a_cylinder",
        "oldham",
        "wedge",
        "parallel_cranks",
    ),
    *(
        "scissor_lift",
        "five_bar_prrrp",
        "planar_3rrr",
        "bennett",
        "goldberg_5r",
        "bricard_line_symmetric",
        "sarrus",
    ),
    *(
        "spherical_4r",
        "rssr",
        "rccc",
        "screw_jack",
        "door_on_two_hinges",
        "three_rps",
        "tricept",
        "exechon",
    ),
)
"""Mechanisms of every kind, on which the quick tests see all laws; the others are marked slow there."""


def expected(check: str, *, quick: bool = False, only: Collection[str] = ()) -> list[ParameterSet]:
    """Name mechanisms for a check; where it is known to fail, with its cause; with `quick`, others slow."""
    names: list[ParameterSet] = []
    for row in ZOO:
        if only and row.name not in only:
            continue
        failing = FAILING.get((check, row.name))
        marks = [] if failing is None else [pytest.mark.xfail(strict=True, reason=failing)]
        marks += [pytest.mark.slow] if quick and row.name not in QUICK else []
        names.append(pytest.param(row.name, marks=marks))
    return names
