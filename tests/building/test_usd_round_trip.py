"""What a chain holds survives OpenUSD: exactly by our own words, and to single precision as others read it."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError
from stewart_pin.model.description import LOOP_KINDS, Bounds, JointKind, Mechanism, loop_coordinates
from stewart_pin.model.shapes import Material, Shape, ShapeKind
from stewart_pin.state.newton import polish
from tests.mechanisms import gear_train, two_bodies
from tests.small_usd import as_others_see_it

ZOO = Path(__file__).parents[1] / "zoo" / "urdf"
SINGLE = 2e-6
"""Relative error that single precision of frames, masses and moments may make together."""
# Overconstrained loops of every sort, a coupling, a universal and a cylindrical loop, floating bodies.
FEW = ["four_bar", "bennett", "bricard_trihedral", "double_cardan", "rack_and_pinion", "rccc", "jansen_leg"]
REST = [
    name for name in (*stp.robots(), *sorted(path.stem for path in ZOO.glob("*.urdf"))) if name not in FEW
]


def found(name: str) -> stp.ClosedChain:
    return stp.load(name if name in stp.robots() else ZOO / f"{name}.urdf")


def written(chain: stp.ClosedChain, folder: Path) -> Path:
    path = folder / "again.usda"
    stp.export(chain, path, format="usd")
    return path


def parts(mechanism: Mechanism) -> dict[str, object]:
    """Everything that equations of motion depend on, as it compares exactly."""

    def place(placement: pin.SE3) -> bytes:
        return (placement.homogeneous + 0.0).tobytes()

    def spans(bounds: Bounds | tuple[Bounds, ...]) -> list[float]:
        each = (bounds,) if isinstance(bounds, Bounds) else bounds
        return [float(end) for bound in each for span in astuple(bound) for end in span]

    return {
        "links": sorted(
            (x.name, None if x.inertia is None else (x.inertia.toDynamicParameters() + 0.0).tobytes())
            for x in mechanism.links
        ),
        "joints": sorted(
            (x.name, x.kind, x.parent, x.child, place(x.placement), x.swing, x.turn, x.independent)
            + ((tuple(x.axis), str(spans(x.bounds))) if x.has_axis else ())
            for x in mechanism.joints
        ),
        "loops": [
            (x.name, x.kind, x.link1, x.link2, place(x.placement1), place(x.placement2), str(spans(x.bounds)))
            + ((x.length,) if x.kind is JointKind.DISTANCE else ())
            for x in mechanism.loops
        ],
        "couplings": [(x.name, x.joint1, x.joint2, x.polynomial) for x in mechanism.couplings],
        "rest": (mechanism.name, mechanism.platform, mechanism.gravity, mechanism.odd_inertias),
    }


def assert_exact(chain: stp.ClosedChain, again: stp.ClosedChain) -> None:
    # A link may be no body, or one without mass, of which other formats keep the former.
    assert parts(again.described()) == parts(chain.described())
    assert again.motors == chain.motors
    np.testing.assert_allclose(again.q_home, chain.q_home, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", [kind for kind in LOOP_KINDS if kind is not JointKind.CABLE])
def test_every_kind_of_loop_is_read_back_exactly(
    kind: JointKind, rng: np.random.Generator, tmp_path: Path
) -> None:
    chain = two_bodies(kind, rng)
    coordinates = loop_coordinates(kind)
    least = 0.0 if kind is JointKind.SPHERICAL else -6.0
    bounds = tuple(Bounds((least, 6.0 + k / 7), effort=(-3.1, 0.3)) for k, _ in enumerate(coordinates))
    loops = tuple(replace(loop, bounds=bounds) for loop in chain.loops)
    chain = replace(chain, mechanism=replace(chain.mechanism, loops=loops))
    again = stp.load(written(chain, tmp_path))
    assert_exact(chain, again)
    loop, theirs = chain.loops[0], again.loops[0]
    if kind not in (JointKind.FIXED, JointKind.DISTANCE):
        assert (theirs.axis == loop.axis).all()
    if kind is JointKind.UNIVERSAL:
        assert (theirs.axis2 == loop.axis2).all()


@pytest.mark.parametrize("name", ["stewart", "gough_6sps", "rack_and_pinion", "screw_jack"])
def test_robots_are_read_back_exactly(name: str, tmp_path: Path) -> None:
    chain = found(name)
    assert_exact(chain, stp.load(written(chain, tmp_path)))


def test_couplings_of_any_degree_gravity_and_odd_inertias_go_along(
    rng: np.random.Generator, tmp_path: Path
) -> None:
    chain = gear_train(rng)
    odd = pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))
    links = tuple(
        replace(link, inertia=odd) if link.name == chain.mechanism.joints[0].child else link
        for link in chain.mechanism.links
    )
    names = frozenset({chain.mechanism.joints[0].child})
    mechanism = replace(chain.described(), links=links, odd_inertias=names)
    chain = build_chain(mechanism, gravity=(0.3, -0.1, -1.62))
    path = written(chain, tmp_path)
    assert_exact(chain, stp.load(path))


def test_a_moving_link_may_be_called_world(tmp_path: Path) -> None:
    def renamed(name: str) -> str:
        return {"crank": "world"}.get(name, name)

    chain = stp.load("four_bar")
    links = tuple(replace(x, name=renamed(x.name)) for x in chain.mechanism.links)
    joints = tuple(
        replace(x, parent=renamed(x.parent), child=renamed(x.child)) for x in chain.mechanism.joints
    )
    chain = build_chain(replace(chain.described(), links=links, joints=joints))
    assert_exact(chain, stp.load(written(chain, tmp_path)))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FEW, *REST])
def test_all_robots_there_and_back(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    chain = found(name)
    again = stp.load(written(chain, tmp_path))
    assert_exact(chain, again)
    away = polish(chain, pin.integrate(chain.model, chain.q_home, 0.05 * rng.normal(size=chain.nv)))
    if chain.motors and away.success and stp.mobility(chain).motors_sufficient:
        for q in (chain.q_home, away.q):
            still = np.zeros(chain.nv)
            mine, theirs = (stp.inverse_dynamics(one, q, still, still).tau_motor for one in (chain, again))
            np.testing.assert_allclose(theirs, mine, rtol=1e-12, atol=1e-12 * (1 + np.abs(mine).max()))


def assert_single(name: str, folder: Path) -> None:
    """Compare freedoms, and motor efforts to single precision, from the schema's numbers alone."""
    chain = found(name)
    other = stp.load(as_others_see_it(written(chain, folder)))
    assert stp.mobility(other).dof == stp.mobility(chain).dof
    assert (other.platform, other.motors) == (chain.platform, chain.motors)
    if not chain.motors or not stp.mobility(chain).motors_sufficient:
        return
    mine, theirs = (
        stp.inverse_dynamics(one, one.q_home, np.zeros(one.nv), np.zeros(one.nv)).tau_motor
        for one in (chain, other)
    )
    weight = 9.81 * sum(link.inertia.mass for link in chain.mechanism.links if link.inertia is not None)
    np.testing.assert_allclose(theirs, mine, rtol=SINGLE, atol=SINGLE * weight)


@pytest.mark.parametrize("name", FEW)
def test_loops_keep_their_freedom_in_single_precision(name: str, tmp_path: Path) -> None:
    assert_single(name, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", REST)
def test_all_robots_as_others_see_them(name: str, tmp_path: Path) -> None:
    assert_single(name, tmp_path)


def test_the_schema_is_obeyed(tmp_path: Path) -> None:
    from pxr import Tf, Usd, UsdPhysics, UsdValidation

    try:
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    except Tf.ErrorException:
        pytest.skip("the wheel of this version lacks the libraries of its validators")
    assert any("PhysicsJointChecker" in one.GetMetadata().name for one in validators)
    for name in ("stewart", "double_cardan"):
        path = written(found(name), tmp_path).rename(tmp_path / f"{name}.usda")
        stage = Usd.Stage.Open(str(path))
        faults = UsdValidation.ValidationContext(validators).Validate(stage)
        assert [fault.GetMessage() for fault in faults] == []
    # The validators do see faults.
    stage.GetPrimAtPath("/double_cardan/joints/ground_in_world").GetRelationship("physics:body1").SetTargets(
        ["/no"]
    )
    assert UsdValidation.ValidationContext(validators).Validate(stage)
    assert stage.GetPrimAtPath("/double_cardan").HasAPI(UsdPhysics.ArticulationRootAPI)


def test_report_tells_what_single_precision_loses(tmp_path: Path) -> None:
    report = str(stp.export(stp.load("stewart"), tmp_path / "stewart.usda", format="usd"))
    assert "single precision, off by 2e-08 m at most" in report
    assert "a rigid body without mass" in report and "leg1_cross" in report


def test_only_text_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must end in \.usda or \.usd, got 'a\.usdc'"):
        stp.export(stp.load("four_bar"), tmp_path / "a.usdc", format="usd")
    assert not list(tmp_path.iterdir())


def test_shapes(tmp_path: Path) -> None:
    chain, at = (
        stp.load("four_bar"),
        pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.01, 0.0, 0.02])),
    )
    sizes = {"BOX": (0.1, 0.2, 0.3), "CYLINDER": (0.1, 0.4), "SPHERE": (0.2,), "CAPSULE": (0.1, 0.3)}
    shapes = tuple(
        Shape(ShapeKind[key], size, at, key, material=Material(rgba=(0.1, 0.5, 0.25, 0.75)))
        for key, size in (*sizes.items(), ("ELLIPSOID", (0.1, 0.2, 0.3)))
    )
    shapes += (Shape(ShapeKind.MESH, (1.0, 1.0, 1.0), mesh="rod.stl"),)
    links = tuple(
        replace(link, visuals=shapes, collisions=shapes[:1]) if link.name == "crank" else link
        for link in chain.mechanism.links
    )
    chain = replace(chain, mechanism=replace(chain.mechanism, links=links))
    path = tmp_path / "shapes.usda"
    assert "the mesh 'rod.stl' is left out" in str(stp.export(chain, path, format="usd"))
    crank = stp.load(path).mechanism.link("crank")
    assert [shape.kind for shape in crank.visuals] == [shape.kind for shape in shapes[:5]]
    assert [shape.kind for shape in crank.collisions] == [ShapeKind.BOX]
    for shape, theirs in zip(shapes[:5], crank.visuals, strict=True):
        np.testing.assert_allclose(theirs.sizes, shape.sizes, rtol=1e-14)
        np.testing.assert_allclose(theirs.placement.homogeneous, at.homogeneous, atol=1e-14)
        assert theirs.name == shape.name and theirs.material is not None
        assert theirs.material.rgba == (0.1, 0.5, 0.25, 0.75)
