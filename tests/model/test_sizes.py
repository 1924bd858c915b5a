"""The size of a mechanism: its own, wherever it stands and however it is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from stewart_pin.model.sizes import length_scale
from tests.closed_states import robot
from tests.mechanisms import turned

ROBOTS = (
    "stewart",
    "stewart_cad",
    "delta",
    "four_bar",
    "five_bar",
    "hexapod_rss",
    "rpr_planar",
    "arm_7r",
    "agile_eye",
)


def size(chain: stp.ClosedChain, mechanism: Mechanism | None = None) -> float:
    return length_scale(mechanism or chain.mechanism, chain.platform)


def test_radius_of_the_joints_on_one_body() -> None:
    """The base of `stewart`: six universal joints on a circle, whose single hinges are only lines."""
    s = np.sqrt(3.0)
    assert size(robot("stewart")) == pytest.approx(np.hypot(0.6, s / 10), rel=1e-12)
    # Half the longest bar of a four-bar: two hinges, in the middle of which is the nearest point.
    assert size(robot("four_bar")) == pytest.approx(0.06, rel=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("metres", [1.0, 100.0, 1000.0])
def test_where_a_robot_stands_is_no_property_of_it(name: str, metres: float) -> None:
    chain = robot(name)
    mechanism = chain.mechanism
    place = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), metres * np.array([0.6, 0.8, 0.0]))
    plant = replace(
        mechanism,
        links=(Link("plant"), *mechanism.links),
        joints=(Joint("foundation", JointKind.FIXED, "plant", mechanism.root, place), *mechanism.joints),
    )
    # Round-off of adding and taking away the distance.
    assert size(chain, plant) == pytest.approx(size(chain), rel=1e-14 * max(1.0, 10 * metres / size(chain)))


@pytest.mark.parametrize("name", ROBOTS)
def test_frames_along_their_axes_make_no_difference(name: str, rng: np.random.Generator) -> None:
    """A hinge's frame slid along and turned about its axis, a slide's frame put anywhere along with its link."""
    chain = robot(name)
    mechanism = chain.mechanism
    moved: dict[str, pin.SE3] = {}
    for joint in mechanism.joints:
        match joint.kind:
            case JointKind.REVOLUTE:
                moved[joint.name] = pin.SE3(pin.exp3(rng.normal() * joint.axis), rng.normal() * joint.axis)
            case JointKind.PRISMATIC:
                moved[joint.name] = pin.SE3(np.eye(3), rng.normal(size=3))
    # The child's frame moves with the joint's, and what hangs on it is told in the new one.
    shift = {joint.child: moved[joint.name] for joint in mechanism.joints if joint.name in moved}
    back = {link: place.inverse() for link, place in shift.items()}

    def seen(link: str, place: pin.SE3) -> pin.SE3:
        return back[link] * place if link in back else place

    told = replace(
        mechanism,
        joints=tuple(
            replace(
                joint,
                placement=seen(joint.parent, joint.placement) * moved.get(joint.name, pin.SE3.Identity()),
            )
            for joint in mechanism.joints
        ),
        loops=tuple(
            replace(
                loop,
                placement1=seen(loop.link1, loop.placement1),
                placement2=seen(loop.link2, loop.placement2),
            )
            for loop in mechanism.loops
        ),
    )
    if chain.platform in shift and shift[chain.platform].translation.any():
        pytest.skip("the platform's own origin has moved along")
    assert size(chain, told) == pytest.approx(size(chain), rel=1e-12)


def slides(offset: float, stroke: float = np.inf) -> Mechanism:
    """Three slides in a row."""
    names = ("base", "x", "y", "z")
    joints = tuple(
        Joint(
            f"j{child}", JointKind.PRISMATIC, parent, child, pin.SE3(np.eye(3), np.array([offset, 0, 0])), axis,
            lower=-stroke / 2, upper=stroke / 2,
        )
        for parent, child, axis in zip(names, names[1:], np.eye(3), strict=False)
    )  # fmt: skip
    return Mechanism("gantry", tuple(Link(name) for name in names), joints)


def test_slides_have_no_place() -> None:
    assert length_scale(slides(1e-3, 2.0)) == 1.0  # half the stroke
    assert length_scale(slides(1e-3)) == pytest.approx(5e-4)  # nothing but frames
    assert length_scale(slides(0.0)) == 1.0  # nothing at all
    assert length_scale(slides(1e-17, 2.0)) == 1.0


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-6])
def test_a_stroke_that_no_body_fits_is_none(unit: float) -> None:
    """Slides of 2 km on carriages of 0.2 m have no limits; those of 20 m have, on frames that are 1 mm apart."""
    box = pin.Inertia(2.0, np.zeros(3), 2.0 * (0.2 * unit) ** 2 * np.eye(3))

    def found(stroke: float) -> float:
        bare = slides(1e-3 * unit, stroke * unit)
        return length_scale(replace(bare, links=tuple(Link(link.name, box) for link in bare.links))) / unit

    assert found(20.0) == pytest.approx(10.0, rel=1e-12)
    for placeholder in (2e3, 2e6, 1e12):
        assert found(placeholder) == pytest.approx(found(np.inf), rel=1e-12)
        assert found(placeholder) < 1.0


def test_an_offset_of_round_off_is_none(rng: np.random.Generator) -> None:
    """Axes that meet in a point but for the digits of a file: a spherical mechanism is as large as it is drawn."""
    hinges = []
    for k, parent in enumerate(("base", "a", "b")):
        axis = rng.normal(size=3)
        place = turned(rng, 0.0)
        axis = axis / np.linalg.norm(axis)
        # The frame is drawn away from the centre, along the axis that passes through it up to 1e-16.
        place = pin.SE3(np.eye(3), 0.2 * axis + 1e-16 * rng.normal(size=3)) if k == 0 else place
        hinges.append(Joint(f"h{k}", JointKind.REVOLUTE, parent, "abc"[k], place, axis))
    links = tuple(Link(name) for name in ("base", "a", "b", "c"))
    two = Mechanism("wrist", links, tuple(hinges))
    found = length_scale(two)
    assert found > 1e-3 or found == 1.0


@pytest.mark.parametrize("inertia", [None, pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))])
def test_round_off_of_a_balanced_gimbal_is_no_length(
    inertia: pin.Inertia | None, rng: np.random.Generator
) -> None:
    """All axes meet in one point, which is the centre of every mass; sums of placements leave 1e-17 between them."""
    hinges = []
    for k, parent in enumerate(("base", "a", "b")):
        axis = rng.normal(size=3)
        place = pin.SE3(np.eye(3), np.full(3, 0.3 if k == 0 else 1e-17 * k))
        hinges.append(
            Joint(f"h{k}", JointKind.REVOLUTE, parent, "abc"[k], place, axis / np.linalg.norm(axis))
        )
    links = tuple(Link(name, None if name == "base" else inertia) for name in ("base", "a", "b", "c"))
    assert length_scale(Mechanism("gimbal", links, tuple(hinges))) == 1.0
