"""Loops that close only to the digits of their file keep the freedom that was meant, aloud."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, MechanismError
from stewart_pin.model.description import Link, Mechanism
from stewart_pin.state.newton import rank_at_precision
from tests.printed import half_unit, on_kinematic_bodies, round_places, turned_frames
from tests.rewritten import in_other_unit
from tests.zoo.table import ZOO, zoo_chain

STYLES = ("4f", "5f", "6f", "7f", "9f", "12f", "17f", "5g", "6g", "9g")
# How far an answer may be off per half unit: levers, lengths below one robot size, and neighbouring joints add up.
HOME, EFFORT = 60.0, 600.0
QUICK = ("crank_rocker", "parallel_cranks", "bennett", "sarrus", "spherical_4r", "door_on_two_hinges")
OTHERS = tuple(
    pytest.param(row.name, marks=pytest.mark.slow) for row in ZOO if row.excess and row.name not in QUICK
)


def rest_effort(chain: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
    rest = np.zeros(chain.nv)
    return stp.inverse_dynamics(chain, q, rest, rest, throw=False).tau_motor


def assert_the_same(printed: stp.ClosedChain, exact: stp.ClosedChain, style: str) -> None:
    assert printed.generic.count == exact.generic.count
    assert stp.mobility(printed).redundant_rows == stp.mobility(exact).redundant_rows
    off = half_unit(style)
    home = pin.difference(exact.model, exact.q_home, printed.q_home) / exact.tangent_scale
    assert np.abs(home).max() <= HOME * off + 1e-12
    # At home, and on the way: the same guess is closed by both.
    step = 0.1 * np.random.default_rng(1).uniform(-1, 1, exact.nv) * exact.tangent_scale
    closed = stp.close_loops(exact, pin.integrate(exact.model, exact.q_home, step)).q
    followed = stp.close_loops(printed, closed)
    assert followed.gap <= 1e-12 * max(1.0, printed.length_scale)
    size = max(np.abs(rest_effort(exact, closed)).max(), np.abs(rest_effort(exact, exact.q_home)).max(), 1.0)
    for q, theirs in ((exact.q_home, printed.q_home), (closed, followed.q)):
        error = np.abs(rest_effort(printed, theirs) - rest_effort(exact, q)).max()
        assert error <= EFFORT * off * size + 1e-9 * size


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", [*QUICK, *OTHERS])
def test_overconstrained_loops_keep_their_freedom(name: str, style: str, tmp_path: Path) -> None:
    exact = turned_frames(zoo_chain(name), seed=3)
    path = tmp_path / "printed.urdf"
    stp.export(exact, path)
    round_places(path, style)
    assert_the_same(stp.load(path, gravity=exact.gravity), exact, style)


@pytest.mark.parametrize("style", ["4f", "6f", "9f", "4g", "6g"])
def test_axes_in_line_but_for_digits_are_no_length(style: str, tmp_path: Path) -> None:
    # No place of the robot is off the line of its hinges: how far they miss it is no size.
    exact = stp.with_platform(turned_frames(zoo_chain("door_on_two_hinges"), seed=3, slide=0.3), "door")
    path = tmp_path / "printed.urdf"
    stp.export(exact, path)
    round_places(path, style)
    assert_the_same(stp.load(path, gravity=exact.gravity), exact, style)


def side_by_side(chains: Sequence[stp.ClosedChain]) -> stp.ClosedChain:
    """Stand mechanisms on one ground, two metres apart and each turned."""
    links, joints, loops = [Link("ground")], [], []
    for k, chain in enumerate(chains):
        old, ground = chain.described(), chain.mechanism.root
        place = pin.SE3(pin.utils.rotate("z", 0.37 * k), np.array([0.0, 2.0 * k, 0.0]))

        def named(link: str, k: int = k, ground: str = ground) -> str:
            return "ground" if link == ground else f"{link}_{k}"

        def placed(placement: pin.SE3, link: str, place: pin.SE3 = place, ground: str = ground) -> pin.SE3:
            return place * placement if link == ground else placement

        links += [replace(link, name=named(link.name)) for link in old.links if link.name != ground]
        joints += [
            replace(
                joint,
                name=f"{joint.name}_{k}",
                parent=named(joint.parent),
                child=named(joint.child),
                placement=placed(joint.placement, joint.parent),
            )
            for joint in old.joints
        ]
        loops += [
            replace(
                loop,
                name=f"{loop.name}_{k}",
                link1=named(loop.link1),
                link2=named(loop.link2),
                placement1=placed(loop.placement1, loop.link1),
                placement2=placed(loop.placement2, loop.link2),
            )
            for loop in old.loops
        ]
    return build_chain(Mechanism("row", tuple(links), tuple(joints), tuple(loops)), motors=[])


@pytest.mark.parametrize("by", [1.0, 0.03, 2e-3])
def test_a_small_linkage_beside_a_large_one_keeps_its_size(by: float, tmp_path: Path) -> None:
    """Digits that are nothing beside its own links explain no link away, however large its neighbours are."""
    small = in_other_unit(turned_frames(zoo_chain("crank_rocker"), seed=1), by)
    row = side_by_side([turned_frames(zoo_chain("crank_rocker"), seed=0), small])
    path = tmp_path / "row.urdf"
    stp.export(row, path)
    round_places(path, "6g")
    printed = stp.load(path)
    assert stp.mobility(printed).dof == 2
    for loop, printed_loop in zip(row.loops, printed.loops, strict=True):
        moved = loop.placement1.translation - printed_loop.placement1.translation
        assert np.abs(moved).max() < 1e-5


def test_home_of_a_linkage_does_not_depend_on_the_others() -> None:
    """Neither do its joints: they are searched for in its own size."""
    small = in_other_unit(zoo_chain("crank_rocker"), 0.01)
    row = side_by_side([small, zoo_chain("crank_rocker")])
    first, found = small.mechanism.joints[0].name, []
    for chain in (small, row):
        joints = [
            replace(joint, lower=0.2) if joint.name.startswith(first) else joint
            for joint in chain.mechanism.joints
        ]
        told = replace(chain.mechanism, joints=tuple(joints), home={}, platform=None)
        home = build_chain(told, motors=[]).described().home
        found.append([home[name if chain is small else f"{name}_0"] for name in small.mechanism.home])
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("style", ["5f", "9f"])
def test_linkages_side_by_side_keep_their_freedoms(style: str, tmp_path: Path) -> None:
    """Together they are too large to look for one that moves; each is found for itself."""
    names = ["crank_rocker", "bennett", "crank_rocker", "spherical_4r", "crank_rocker", "crank_rocker"]
    exact = side_by_side([turned_frames(zoo_chain(name), seed=k) for k, name in enumerate(names)])
    path = tmp_path / "row.urdf"
    stp.export(exact, path)
    round_places(path, style)
    printed = stp.load(path)
    assert stp.mobility(printed).dof == stp.mobility(exact).dof == len(names)
    off = pin.difference(exact.model, exact.q_home, printed.q_home) / exact.tangent_scale
    assert np.abs(off).max() <= HOME * half_unit(style)
    assert np.abs(stp.loop_gap(printed, printed.q_home)).max() <= 1e-12 * printed.length_scale


@pytest.mark.parametrize("style", ["4f", "6f", "9f"])
@pytest.mark.parametrize("format", ["drake", "isaac", "gepetto", "mjcf", "sdf", "usd"])
@pytest.mark.parametrize("name", ["crank_rocker", "bennett"])
def test_every_dialect_keeps_them(name: str, format: str, style: str, tmp_path: Path) -> None:
    exact = turned_frames(zoo_chain(name), seed=4)
    if format not in ("sdf", "usd"):
        exact = stp.build.loops_by_balls(exact)
    if format == "usd":
        pytest.importorskip("pxr")
    path = tmp_path / f"printed{ {'mjcf': '.xml', 'sdf': '.sdf', 'usd': '.usda'}.get(format, '.urdf') }"
    stp.export(exact, path, format=format)
    for file in tmp_path.iterdir():
        round_places(file, style)
    printed = stp.load(path, gravity=exact.gravity)
    assert printed.generic.count == exact.generic.count
    right = rest_effort(exact, exact.q_home)
    error = np.abs(rest_effort(printed, printed.q_home) - right).max()
    assert error <= EFFORT * half_unit(style) * max(1.0, np.abs(right).max())


@pytest.mark.parametrize(
    ("name", "format"), [("linear_delta", "urdf+"), ("tripod_3upu", "sdf"), ("double_cardan", "sdf")]
)
def test_four_decimals_are_enough(name: str, format: str, tmp_path: Path) -> None:
    """Of small robots the roundings move the named home by more than a thousandth, and axes from right angles."""
    exact = turned_frames(zoo_chain(name), seed=3)
    path = tmp_path / ("printed.sdf" if format == "sdf" else "printed.urdf")
    stp.export(exact, path, format=format)  # type: ignore[arg-type]
    round_places(path, "4f")
    printed = stp.load(path, gravity=exact.gravity)
    assert stp.mobility(printed).dof == stp.mobility(exact).dof
    apart = pin.log6(
        stp.platform_pose(exact, exact.q_home).actInv(stp.platform_pose(printed, printed.q_home))
    ).vector
    assert np.abs(apart / exact.twist_sizes).max() <= 5e-3
    if name == "linear_delta":
        assert "which the digits of the file explain" in str(printed.report)
        with pytest.raises(MechanismError, match=r"closing them moves joint 'platform_pose wz' by 0\.00"):
            stp.load(path, closure_tolerance=1e-4)


def test_what_digits_do_not_explain_may_be_said_to_be_rounding(tmp_path: Path) -> None:
    """Three digits are meant as they stand, unless asked; the message says how."""
    exact = stp.build.loops_by_balls(turned_frames(zoo_chain("agile_eye"), seed=3))
    path = tmp_path / "printed.xml"
    stp.export(exact, path, format="mjcf")
    round_places(path, "4f")
    with pytest.raises(MechanismError, match=r"rounding.*closure_tolerance=0\.0\d+") as caught:
        stp.load(path)
    tolerance = float(re.search(r"closure_tolerance=([\d.]+)", str(caught.value))[1])  # type: ignore[index]
    assert stp.mobility(stp.load(path, closure_tolerance=tolerance)).dof == stp.mobility(exact).dof


@pytest.mark.parametrize("style", ["4f", "5f", "6f"])
@pytest.mark.parametrize("name", ["crank_rocker", "five_bar_5r", "oldham"])
def test_digits_of_bodies_that_stand_still_count(name: str, style: str, tmp_path: Path) -> None:
    """Joints stand at the origins of kinematic bodies, so that the places of these alone have digits."""
    exact, path = on_kinematic_bodies(zoo_chain(name), tmp_path)
    round_places(path, style)
    printed = stp.load(path, motors=exact.motors, platform=exact.platform, gravity=exact.gravity)
    assert printed.generic.count == exact.generic.count
    off = half_unit(style)
    places = [stp.platform_pose(chain, chain.q_home) for chain in (exact, printed)]
    assert np.abs(pin.log6(places[0].actInv(places[1])).vector / exact.twist_sizes).max() <= HOME * off
    size = max(np.abs(rest_effort(exact, exact.q_home)).max(), 1.0)
    error = np.abs(rest_effort(printed, printed.q_home) - rest_effort(exact, exact.q_home)).max()
    assert error <= EFFORT * off * size


def test_poses_that_leave_loops_open_may_be_said_to_be_rounding(tmp_path: Path) -> None:
    """A post whose numbers have all digits stands beside its place; the error says what takes them for rounded."""
    exact, path = on_kinematic_bodies(zoo_chain("crank_rocker"), tmp_path)
    before, post, after = path.read_text().partition('def Xform "post_0"')
    moved = re.sub(
        r"(xformOp:translate = \()([^,]*)", lambda m: f"{m[1]}{float(m[2]) + 2e-4!r}", after, count=1
    )
    path.write_text(before + post + moved)
    names: dict[str, Any] = {"motors": exact.motors, "platform": exact.platform}
    with pytest.raises(
        MechanismError, match=r"where the file places its links: .* closure_tolerance="
    ) as caught:
        stp.load(path, **names)
    found = re.search(r"closure_tolerance=([\d.e+-]+), or more", str(caught.value))
    assert found is not None
    assert stp.load(path, closure_tolerance=float(found[1]), **names).generic.count == exact.generic.count


@pytest.mark.parametrize(("seed", "style"), [(0, "6f"), (1, "6f"), (2, "6f"), (3, "6f"), (3, "5f")])
def test_the_middle_between_two_families_is_left(seed: int, style: str, tmp_path: Path) -> None:
    # Two balls a hinge, as Drake has it: near Sarrus' linkage several families of mobile linkages meet.
    exact = stp.build.loops_by_balls(turned_frames(zoo_chain("sarrus"), seed=seed))
    path = tmp_path / "printed.xml"
    stp.export(exact, path, format="mjcf")
    round_places(path, style)
    assert stp.load(path).generic.count == exact.generic.count


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "format"), [(6, "urdf+"), (5, "isaac"), (6, "isaac")])
def test_a_mechanism_too_far_away_hides_no_nearer_one(seed: int, format: str, tmp_path: Path) -> None:
    # Steps that are let go farther than the digits explain end at another plate of hinged parts, which is refused.
    exact = turned_frames(zoo_chain("par4"), seed=seed)
    exact = stp.build.loops_by_balls(exact) if format == "isaac" else exact
    path = tmp_path / "printed.urdf"
    stp.export(exact, path, format=format)  # type: ignore[arg-type]
    round_places(path, "4f")
    assert stp.load(path, gravity=exact.gravity).generic.count == exact.generic.count


CRANK = '<origin xyz="0 0 0" rpy="{} 0 0"/>'
BALL = (
    '<loop name="end" type="spherical"><predecessor link="coupler"><origin xyz="0.3 0.1 0"/></predecessor>'
    '<successor link="platform"><origin xyz="0 0 0.2"/></successor></loop>'
)
HINGE = (
    '<loop name="end" type="revolute"><predecessor link="coupler"><origin xyz="0.3 0.1 0"/></predecessor>'
    '<successor link="platform"><origin xyz="0 0 0.2" rpy="{} 0 0"/></successor><axis xyz="0 0 1"/></loop>'
)


def bars(angle: str, closing: str) -> str:
    """Write a four-bar in the x-z plane that is closed where all joints are zero; its crank is turned about x."""

    def link(name: str, centre: str, mass: float, inertia: float) -> str:
        return (
            f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/><inertia ixx="{inertia}" '
            f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    def hinge(name: str, ends: tuple[str, str], origin: str, axis: str, driven: str = "") -> str:
        parent, child = ends
        return (
            f'<joint name="{name}" type="continuous"{driven}><parent link="{parent}"/><child link="{child}"/>{origin}'
            f'<axis xyz="{axis}"/></joint>'
        )

    return (
        '<robot name="bars"><link name="base"/>'
        + link("crank", "0.05 0 0", 0.3, 4e-4)
        + link("coupler", "0.15 0 0", 0.5, 4e-3)
        + link("platform", "0 0 0.1", 0.4, 2e-3)
        + hinge("motor", ("base", "crank"), CRANK.format(angle), "0 0 1", ' independent="true"')
        + hinge("pin", ("crank", "coupler"), '<origin xyz="0.1 0.05 0"/>', "0 0 1")
        + hinge("rocker", ("base", "platform"), '<origin xyz="0.4 0 -0.05"/>', "0 -1 0")
        + closing.format(angle)
        + "</robot>"
    )


def crank_effort() -> float:
    """Find the effort of the crank by the rate at which the weights rise, from velocities in the plane."""

    def turning(rate: float, arm: np.ndarray) -> np.ndarray:
        return rate * np.array([arm[1], -arm[0]])  # (x, z) velocity of a point at `arm`, spun about y

    b, c, d = np.array([0.1, 0.05]), np.array([0.4, 0.15]), np.array([0.4, -0.05])
    coupler, rocker = np.linalg.solve(
        np.column_stack([turning(1, c - b), -turning(1, c - d)]), -turning(1, b)
    )
    first = 0.3 * turning(1, np.array([0.05, 0]))[1]
    second = 0.5 * (turning(1, b) + turning(coupler, np.array([0.15, 0])))[1]
    third = 0.4 * turning(rocker, np.array([0, 0.1]))[1]
    return -9.81 * (first + second + third)  # the crank's own axis points along -y


@pytest.mark.parametrize("closing", [BALL, HINGE], ids=["ball", "hinge"])
@pytest.mark.parametrize("angle", ["1.571", "1.5708", "1.570796", "1.570796327", "1.5707963267949"])
def test_a_right_angle_of_few_digits(angle: str, closing: str, tmp_path: Path) -> None:
    path = tmp_path / "bars.urdf"
    path.write_text(bars(angle, closing))
    chain = stp.load(path)
    off = abs(float(angle) - np.pi / 2)
    assert stp.mobility(chain).dof == 1
    np.testing.assert_allclose(chain.q_home, 0, atol=10 * off + 1e-12)
    # Standard gravity here, 9.81 there.
    tau = rest_effort(chain, chain.q_home)[0] * 9.81 / np.linalg.norm(chain.gravity)
    np.testing.assert_allclose(tau, crank_effort(), atol=10 * off + 1e-9)


def test_the_report_tells_what_was_moved(tmp_path: Path) -> None:
    path = tmp_path / "bars.urdf"
    path.write_text(bars("1.5708", HINGE))
    text = str(stp.load(path).report)
    assert "close only to the digits of the file: the gap was 2.7e-06" in text
    assert "singular values" in text and "the mechanism has 1 freedoms" in text
    assert "joint 'rocker'" in text and "loop 'end', frame 2" in text and "rad, as the loops need" in text
    path.write_text(bars("1.570796326794897", HINGE))
    assert "digits" not in str(stp.load(path).report)


def test_what_is_forgiven_may_be_said(tmp_path: Path) -> None:
    path = tmp_path / "bars.urdf"
    path.write_text(bars("1.5708", HINGE))
    with pytest.raises(
        MechanismError, match=r"the loops do not close, the smallest gap found is 5\.4\de-07 m"
    ):
        stp.load(path, closure_tolerance=1e-8)
    # Three digits explain nothing unasked: short numbers are meant as they stand.
    path.write_text(bars("1.57", HINGE))
    with pytest.raises(MechanismError, match="the loops do not close"):
        stp.load(path)
    assert stp.mobility(stp.load(path, closure_tolerance=5e-3)).dof == 1
    with pytest.raises(InputError, match="closure_tolerance must be"):
        stp.load(path, closure_tolerance=-1.0)


def test_a_bent_loop_is_no_matter_of_digits(tmp_path: Path) -> None:
    path = tmp_path / "bars.urdf"
    path.write_text(bars("1.5608", HINGE))  # 0.01 rad off, a hundred times what five digits explain
    with pytest.raises(MechanismError, match="the loops do not close"):
        stp.load(path)


def test_exact_numbers_are_not_moved() -> None:
    for row in ZOO:
        assert "digits" not in str(zoo_chain(row.name).report)


def test_ranks_are_told_by_a_gap_whose_lower_edge_rounding_explains() -> None:
    assert rank_at_precision(np.array([2.0, 0.5, 3e-6, 1e-9]), 1e-5) == 2
    assert rank_at_precision(np.array([2.0, 0.5, 3e-4]), 1e-5) == 3
    assert rank_at_precision(np.array([1e-6]), 1e-5) == 0
    assert rank_at_precision(np.zeros(0), 1e-5) == 0
