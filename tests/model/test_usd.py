"""OpenUSD as other programmes write it: units, axes, frames, roles of joints; and what is refused."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import (
    FileFormatError,
    MechanismError,
    MissingExtraError,
    StewartPinError,
    UnsupportedError,
)
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.usd.bodies import read_bodies
from stewart_pin.model.formats.usd.joints import JointReader
from stewart_pin.model.formats.usd.stage import open_stage
from stewart_pin.state.newton import polish
from tests.mechanisms import gear_train
from tests.small_usd import as_others_see_it, bar, ends, joint, stage, write

AXIS = '        uniform token physics:axis = "Z"\n'
MOTOR = "        float drive:angular:physics:stiffness = 3\n"
DRIVE = '"PhysicsDriveAPI:angular"'
# A parallelogram in the plane of x and y, y upwards: bars of 10 cm; the ground is the world.
BARS = (bar("left", turn=90), bar("right", "(10, 0, 0)", 90), bar("top", "(0, 10, 0)", mass=2.0))
HINGES = (
    joint("motor", AXIS + ends("", "left") + MOTOR, schemas=DRIVE),
    # From the body to the world, and limits in degrees.
    joint("foot", AXIS + ends("right", "", at1="(10, 0, 0)") + "        float physics:lowerLimit = -135\n"),
    joint("elbow", AXIS + ends("left", "top", "(10, 0, 0)")),
)
LOOP = joint("tip", AXIS + ends("top", "right", "(10, 0, 0)", "(10, 0, 0)"))


def loaded(folder: Path, *parts: str, **options: str) -> stp.ClosedChain:
    return stp.load(write(folder, stage(*parts, **options)))


def torque(chain: stp.ClosedChain) -> float:
    still = np.zeros(chain.nv)
    return float(stp.inverse_dynamics(chain, chain.q_home, still, still).tau_motor[0])


def test_centimetres_y_upwards_degrees_and_joints_to_the_world(tmp_path: Path) -> None:
    chain = loaded(tmp_path, *BARS, *HINGES, LOOP)
    assert stp.mobility(chain).dof == 1
    assert chain.motors == ("motor",)
    assert [loop.name for loop in chain.loops] == ["tip"]
    np.testing.assert_allclose(chain.gravity, [0, -9.81, 0])
    left = chain.mechanism.link("left").inertia
    assert left.mass == 1.0
    np.testing.assert_allclose(left.lever, [0.05, 0, 0])
    np.testing.assert_allclose(left.inertia, np.diag([1e-5, 8e-4, 8e-4]), rtol=1e-12)
    foot = chain.mechanism.joint("foot")
    assert (foot.parent, foot.child) == ("world", "right")
    np.testing.assert_allclose(foot.axis, [0, 0, -1], atol=1e-12)
    assert foot.lower == pytest.approx(-0.75 * np.pi) and foot.upper == np.inf
    # Upright, and the gravity of both legs and the coupler is balanced; leaning by 0.3 rad it is not.
    assert abs(torque(chain)) < 1e-12
    leaning = polish(chain, chain.q_home + 0.3 * np.array([-1.0, 1.0, -1.0])).q
    angle = leaning[chain.model.joints[chain.model.getJointId("motor")].idx_q]
    still = np.zeros(chain.nv)
    mine = stp.inverse_dynamics(chain, leaning, still, still).tau_motor[0]
    # Two legs of 1 kg with centres at 5 cm, and 2 kg carried at 10 cm.
    assert mine == pytest.approx(9.81 * (2 * 0.05 + 2 * 0.1) * np.cos(angle), rel=1e-9)


def test_metres_and_z_upwards_are_the_same_numbers(tmp_path: Path) -> None:
    chain = loaded(tmp_path, *BARS, *HINGES, LOOP, metre="1", up="Z")
    np.testing.assert_allclose(chain.mechanism.link("left").inertia.lever, [5, 0, 0])
    np.testing.assert_allclose(chain.gravity, [0, 0, -9.81])


def test_excluded_joints_close_loops_unless_they_must_hold_a_body(tmp_path: Path) -> None:
    out = "        bool physics:excludeFromArticulation = 1\n"
    elbow = HINGES[2].replace("    {\n", "    {\n" + out)
    chain = loaded(tmp_path, *BARS, HINGES[0], HINGES[1], elbow, LOOP)
    assert [loop.name for loop in chain.loops] == ["elbow"]
    # A motor keeps its coordinate, whatever the file says.
    motor = HINGES[0].replace("    {\n", "    {\n" + out)
    chain = loaded(tmp_path, *BARS, motor, *HINGES[1:], LOOP)
    assert chain.motors == ("motor",) and [loop.name for loop in chain.loops] == ["tip"]
    assert "in the tree: nothing else holds its body, or it is a motor" in str(chain.report)


def test_all_joints_of_a_loop_driven(tmp_path: Path) -> None:
    driven = [
        joint(f"j{k}", AXIS + ends(*pair) + MOTOR, schemas=DRIVE)
        for k, pair in enumerate(
            [("", "left"), ("left", "top", "(10, 0, 0)"), ("top", "", "(0, 0, 0)", "(0, 10, 0)")]
        )
    ]
    with pytest.raises(FileFormatError, match=r"</robot/j2> is driven, .* take its drive off"):
        loaded(tmp_path, BARS[0], BARS[2], *driven)


def test_drives_without_gains_are_motors_where_none_has_gains(tmp_path: Path) -> None:
    idle = joint("foot", AXIS + ends("right", "", at1="(10, 0, 0)"), schemas=DRIVE)
    chain = loaded(tmp_path, *BARS, HINGES[0], idle, HINGES[2], LOOP)
    assert chain.motors == ("motor",)
    assert "its drive has no gains, as others have: not a motor (/robot/foot)" in str(chain.report)
    bare = HINGES[0].replace(MOTOR, "")
    chain = loaded(tmp_path, *BARS, bare, idle, HINGES[2], LOOP)
    assert chain.motors == ("motor", "foot")


CROSSED = "        float physics:lowerLimit = 9\n        float physics:upperLimit = 1\n"
STILL = "double3 xformOp:translate = (0, 0, 0)"
MOVED = "double3 xformOp:translate.timeSamples = {0: (0, 0, 0), 1: (1, 0, 0)}"
KINEMATIC = "bool physics:kinematicEnabled = 1\n        quatf"
LOCK = {"transX", "transY", "transZ", "rotX", "rotY", "rotZ"}


def generic(free: set[str], extra: str = "") -> str:
    locked = sorted(LOCK - free)
    text = "".join(
        f"        float limit:{dof}:physics:low = 1\n        float limit:{dof}:physics:high = -1\n"
        for dof in locked
    )
    schemas = ", ".join(f'"PhysicsLimitAPI:{dof}"' for dof in locked)
    return joint("any", text + extra + ends("", "left"), "PhysicsJoint", schemas)


@pytest.mark.parametrize(
    ("free", "freedoms", "names"),
    [
        ({"rotY"}, 1, ["any"]),
        ({"transZ"}, 1, ["any"]),
        ({"rotX", "rotY", "rotZ"}, 3, ["any"]),
        ({"transY", "rotY"}, 2, ["any_slide", "any_turn"]),
        ({"transX", "transZ", "rotY"}, 3, ["any_x", "any_y", "any_turn"]),
        ({"rotX", "rotZ"}, 2, ["any_1", "any_2"]),
    ],
)
def test_joints_without_a_type(free: set[str], freedoms: int, names: list[str], tmp_path: Path) -> None:
    chain = loaded(
        tmp_path, bar("left", turn=90 if "rotY" not in free and "rotX" not in free else 0), generic(free)
    )
    assert chain.nv == freedoms
    assert sorted(chain.model.names[1:]) == sorted(names)


def test_a_universal_joint_swings_in_body_0_and_twists_in_body_1(tmp_path: Path) -> None:
    chain = loaded(tmp_path, bar("left"), generic({"rotX", "rotZ"}))
    first, second = (chain.mechanism.joint(f"any_{k}") for k in (1, 2))
    assert first.parent == "world" and second.child == "left"
    np.testing.assert_array_equal([first.axis, second.axis], [[0, 0, 1], [1, 0, 0]])


@pytest.mark.parametrize(
    ("parts", "error", "message"),
    [
        ((generic({"rotY", "rotZ"}),), UnsupportedError, "leaves free rotY, rotZ"),
        ((generic(LOCK),), FileFormatError, "locks nothing, and holds nothing"),
        (
            (joint("any", "        float limit:rotX:physics:low = 0\n" + ends("", "left"), "PhysicsJoint"),),
            FileFormatError,
            "has limit:rotX:physics:low, but not the schema PhysicsLimitAPI:rotX",
        ),
        (
            (joint("rope", "        float physics:maxDistance = 3\n" + ends("", "left"), "PhysicsDistanceJoint"),),
            FileFormatError,
            "a rope or a stop",
        ),
        ((joint("gear", ends("", "left"), "PhysxPhysicsGearJoint"),), UnsupportedError, "PhysxPhysicsGearJoint"),
        ((joint("a", AXIS + ends("", "lost")),), FileFormatError, "joins </robot/lost>, and no such prim is there"),
        (
            (joint("a", AXIS + ends("", "left") + CROSSED),),
            FileFormatError,
            "has a lower limit",
        ),
        (
            (HINGES[0], bar("other").replace("        float physics:mass = 1.0\n", "")),
            FileFormatError,
            r"</robot/other> is a rigid body without physics:mass: engines compute it .* stewart_pin:massless = 1",
        ),
        (
            (HINGES[0], bar("other").replace("        float3 physics:diagonalInertia = (0.1, 8, 8)\n", "")),
            FileFormatError,
            "</robot/other> has no physics:diagonalInertia",
        ),
        (
            (HINGES[0], bar("other").replace("quatf", KINEMATIC).replace(STILL, MOVED)),
            FileFormatError,
            "is kinematic, and an animation moves it",
        ),
        (
            (HINGES[0].replace("uniform token", "rel newton:mimicJoint = </robot/left>\n        uniform token"),),
            FileFormatError,
            "hinges and slides follow one of these each",
        ),
    ],
)  # fmt: skip
def test_refusals(parts: tuple[str, ...], error: type[Exception], message: str, tmp_path: Path) -> None:
    with pytest.raises(error, match=message):
        loaded(tmp_path, bar("left"), *parts)


def test_nothing_is_fetched(tmp_path: Path) -> None:
    far = 'def Xform "robot" (references = @{}@)\n{{\n}}\n'
    path = write(tmp_path, "#usda 1.0\n" + far.format("http://example.invalid/robot.usd"))
    with pytest.raises(UnsupportedError, match="on another machine; nothing is fetched"):
        stp.load(path)
    path = write(tmp_path, "#usda 1.0\n" + far.format("./missing.usda"))
    with pytest.raises(FileFormatError, match=r"refers to '\./missing\.usda', which is missing"):
        stp.load(path)
    write(tmp_path, stage(*BARS, *HINGES, LOOP), "below.usda")
    units = '(\n    defaultPrim = "robot"\n    metersPerUnit = 0.01\n    upAxis = "Y"\n)\n'
    path = write(tmp_path, "#usda 1.0\n" + units + far.format("./below.usda"))
    assert stp.mobility(stp.load(path)).dof == 1


def test_the_disk_counts_where_a_file_is_open(tmp_path: Path) -> None:
    from pxr import Sdf

    path = write(tmp_path, stage(*BARS, *HINGES, LOOP))
    layer = Sdf.Layer.FindOrOpen(str(path))
    path.write_text(stage(*BARS[:2], *HINGES[:2]))
    assert not stp.load(path).loops
    layer.comment = "unsaved"
    with pytest.raises(FileFormatError, match="open with changes that are not saved"):
        stp.load(path)


VALUES = [
    "nan",
    "inf",
    "0",
    "-1",
    "1e300",
    "1e-300",
    '"x"',
    "(0, 0, 0)",
    "[]",
    "None",
    "@http://a/b@",
    "</robot/left>",
]
TYPES = [
    "double",
    "float",
    "string",
    "token",
    "rel",
    "Revolute",
    "Z",
    "body0",
    "quatf",
    "bool",
    "matrix4d",
    "int",
]


def damaged(text: str, rng: np.random.Generator) -> str:
    """Exchange a value, a number or a type, or leave a line out, or say it twice elsewhere."""
    lines = text.split("\n")
    at, other = (int(rng.integers(1, len(lines))) for _ in range(2))
    what, value = rng.integers(5), str(rng.choice(VALUES))
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(at, lines[other])
    elif what == 2:
        lines[at] = lines[at].replace(str(rng.choice(TYPES)), str(rng.choice(TYPES)))
    elif what == 3:
        lines[at] = re.sub(r"= .*", lambda _: f"= {value}", lines[at])
    else:
        lines[at] = re.sub(r"-?\d+(\.\d+)?(?=[,)]|$)", lambda _: value, lines[at], count=1)
    return "\n".join(lines)


def damage(count: int, seed: int, folder: Path) -> int:
    """Load damaged files, and count those that are refused in words."""
    rng, refused = np.random.default_rng(seed), 0
    stp.export(gear_train(rng), folder / "gears.usda", format="usd")
    whole = [(folder / "gears.usda").read_text(), stage(*BARS, *HINGES, LOOP)]
    for k in range(count):
        path = write(folder, damaged(whole[k % 2], rng), f"{k}.usda")
        try:
            stp.load(path)
        except StewartPinError as error:
            assert str(error)
            refused += 1
    return refused


def test_damaged_files(tmp_path: Path) -> None:
    assert 8 < damage(40, 0, tmp_path) < 32


@pytest.mark.slow
def test_many_damaged_files(tmp_path: Path) -> None:
    assert 200 < damage(1000, 1, tmp_path) < 800


def test_broken_files(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="OpenUSD cannot open this file"):
        stp.load(write(tmp_path, "#usda 1.0\ndef Xform {"))
    with pytest.raises(FileFormatError, match="the stage holds no rigid body"):
        loaded(tmp_path, joint("a", ""))


def test_a_coupling_without_coefficients(tmp_path: Path) -> None:
    own = 'custom string stewart_pin:coupling = "gear"\n custom string stewart_pin:joint1 = "foot"'
    parts = [part.replace("{", "{ " + own, 1) if part is LOOP else part for part in (*BARS, *HINGES, LOOP)]
    with pytest.raises(FileFormatError, match="coupling without stewart_pin:polynomial"):
        stp.load(write(tmp_path, stage(*parts)))


def test_missing_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, stage(*BARS, *HINGES, LOOP))
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[usd\]"):
        stp.load(path)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[usd\]"):
        stp.export(stp.load("four_bar"), tmp_path / "a.usda", format="usd")


def test_bodies_that_stand_apart_are_brought_together(tmp_path: Path) -> None:
    chain = loaded(tmp_path, *BARS[:2], bar("top", "(3, 20, 0)", 10), *HINGES, LOOP)
    assert stp.mobility(chain).dof == 1
    assert "robot sizes or radians apart: home is searched for" in str(chain.report)


@pytest.mark.parametrize(
    "words",
    [
        "        rel newton:mimicJoint = </robot/motor>\n        float newton:mimicCoef0 = 90\n"
        "        float newton:mimicCoef1 = -2\n",
        "        rel physxMimicJoint:rotZ:referenceJoint = </robot/motor>\n"
        "        float physxMimicJoint:rotZ:offset = -90\n        float physxMimicJoint:rotZ:gearing = 2\n",
    ],
)
def test_joints_that_follow_others(words: str, tmp_path: Path) -> None:
    chain = loaded(
        tmp_path, *BARS[:2], HINGES[0], joint("foot", AXIS + words + ends("", "right", "(10, 0, 0)"))
    )
    (coupling,) = chain.couplings
    assert (coupling.joint1, coupling.joint2) == ("foot", "motor")
    np.testing.assert_allclose(coupling.polynomial, [np.pi / 2, -2.0])


def test_what_was_changed_since_is_believed(tmp_path: Path) -> None:
    path = tmp_path / "four_bar.usda"
    stp.export(stp.load("four_bar"), path, format="usd")
    text = path.read_text()
    assert "point3f physics:localPos0 = (0.04, 0, 0)" in text and "float physics:mass = 0.0314" in text
    text = text.replace(
        "point3f physics:localPos0 = (0.04, 0, 0)", "point3f physics:localPos0 = (0.05, 0, 0)"
    )
    path.write_text(text.replace("float physics:mass = 0.0314", "float physics:mass = 0.04"))
    chain = stp.load(path)
    assert chain.mechanism.joint("crank_pin").placement.translation[0] == 0.05
    assert chain.mechanism.link("crank").inertia.mass == 0.04
    report = str(chain.report)
    assert "was changed since its words stewart_pin:... were written" in report
    assert "its mass was changed since stewart_pin:inertia was written" in report


@pytest.mark.parametrize("digits", [9, 8, 6])
def test_turned_frames_of_few_digits(tmp_path: Path, digits: int) -> None:
    """Axes that are no longer orthogonal to the last digit are made so; beyond four digits they are refused."""
    chain = stp.load("hexapod_rss")
    path = tmp_path / "few.usda"
    stp.export(chain, path, format="usd")
    text = re.sub(
        r"(?<![\w.])-?\d+\.\d+(e-?\d+)?(?![\w.])",
        lambda found: f"{float(found[0]):.{digits}g}",
        path.read_text(),
    ).replace("#usda 1\n", "#usda 1.0\n", 1)
    path.write_text(text)
    again = stp.load(path)
    for each in again.mechanism.joints:
        turn = each.placement.rotation
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-14)
    np.testing.assert_allclose(again.q_home, chain.q_home, rtol=0, atol=100 * 10.0**-digits)
    (number,) = set(re.findall(r"stewart_pin:frame0 = \( \((-0\.2474\d+)", text))
    path.write_text(text.replace(f"({number}", f"({float(number) + 1e-3:.9g}"))
    with pytest.raises(FileFormatError, match="has to be a placement"):
        stp.load(path)


def test_single_precision_counts_as_digits(tmp_path: Path) -> None:
    path = tmp_path / "goldberg.usda"
    stp.export(stp.load(Path(__file__).parents[1] / "zoo/urdf/goldberg_5r.urdf"), path, format="usd")
    assert stp.load(path).mechanism.digits == (0.0, 0.0)
    length, angle = stp.load(as_others_see_it(path)).mechanism.digits or (0.0, 0.0)
    assert length < 1e-7 and 1e-8 < angle <= 1e-6
    # Without them, its loop does not close.
    assert stp.mobility(stp.load(as_others_see_it(path))).dof == 1
    with pytest.raises(MechanismError, match=r"no home|do not close"):
        stp.load(as_others_see_it(path), closure_tolerance=1e-13)


def test_frames_are_those_of_the_schema_s_own_parser(tmp_path: Path) -> None:
    from pxr import UsdPhysics

    scaled = bar("left").replace(
        '["xformOp:translate", "xformOp:rotateZ"]', '["xformOp:translate", "xformOp:scale"]'
    )
    scaled = scaled.replace("(5, 0, 0)", "(0, 0, 0)").replace(
        "double3", "float3 xformOp:scale = (2, 3, 4)\n        double3"
    )
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    within = f'def Xform "frame"\n{{\n double3 xformOp:translate = (1, 2, 3)\n {order}\n}}\n'
    text = stage(
        scaled,
        within,
        joint("a", AXIS + ends("frame", "left", "(1, 1, 1)", "(1, 1, 1)")),
        joint("b", AXIS + ends("left", "right", "(1, 1, 1)", "(1, 1, 1)")),
        bar("right", "(4, 5, 6)", 30),
    )
    opened = open_stage(write(tmp_path, text))
    edges = JointReader(opened, read_bodies(opened)).read()
    # Its name until lately.
    parse = (
        getattr(UsdPhysics, "UsdPhysicsLoadStageFromPrimRange", None) or UsdPhysics.LoadUsdPhysicsFromRange
    )
    told = parse(opened.stage, ["/"])
    theirs = {
        str(path): joint
        for paths, joints in told.values()
        for path, joint in zip(paths, joints, strict=True)
        if hasattr(joint, "localPose0Position")
    }
    assert len(edges) == 2
    for edge in edges:
        assert edge.kind is JointKind.REVOLUTE
        for k in (0, 1):
            position = 0.01 * np.array(getattr(theirs[edge.path], f"localPose{k}Position"))
            np.testing.assert_allclose(edge.frames[k].translation, position, atol=1e-8)


def a_ball(words: str) -> tuple[str, ...]:
    return bar("left"), joint("ball", ends("", "left") + words, "PhysicsSphericalJoint")


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_the_cone_of_a_ball_is_about_its_axis(axis: str, tmp_path: Path) -> None:
    cone = "".join(f"        float physics:coneAngle{k}Limit = 30\n" for k in (0, 1))
    chain = loaded(tmp_path, *a_ball(f'        uniform token physics:axis = "{axis}"\n' + cone))
    turned = {name: pin.exp3(0.8 * unit) for name, unit in zip("XYZ", np.eye(3), strict=True)}
    beyond = {
        name
        for name, turn in turned.items()
        if stp.limits_exceeded(chain.at(np.array(pin.Quaternion(turn).coeffs())))
    }
    assert beyond == set("XYZ") - {axis}


def test_limits_that_no_joint_of_ours_has_are_noted(tmp_path: Path) -> None:
    chain = loaded(tmp_path, *a_ball("        float physics:coneAngle0Limit = 30\n"))
    assert "a cone of 30 degrees to one side alone: not limited" in str(chain.report)
    locked = "".join(
        f"        float limit:trans{x}:physics:low = 1\n        float limit:trans{x}:physics:high = -1\n"
        for x in "XYZ"
    )
    turns = "        float limit:rotY:physics:low = -10\n        float limit:rotY:physics:high = 20\n"
    schemas = ", ".join(f'"PhysicsLimitAPI:{name}"' for name in ("transX", "transY", "transZ", "rotY"))
    chain = loaded(
        tmp_path, bar("left"), joint("j", ends("", "left") + locked + turns, "PhysicsJoint", schemas)
    )
    assert chain.mechanism.joint("j").kind is JointKind.SPHERICAL
    assert "PhysicsLimitAPI:rotY: a spherical joint has no such coordinate, no limit" in str(chain.report)


@pytest.mark.parametrize("instance", ["transX", "Z", "linear"])
def test_mimics_of_physx_whatever_their_instance(instance: str, tmp_path: Path) -> None:
    def slide(body: str, words: str = "") -> str:
        return joint(f"{body}_slide", ends("", body) + words, "PhysicsPrismaticJoint")

    words = (
        f"        rel physxMimicJoint:{instance}:referenceJoint = </robot/left_slide>\n"
        f"        float physxMimicJoint:{instance}:gearing = -2\n"
    )
    chain = loaded(tmp_path, bar("left"), bar("right"), slide("left"), slide("right", words))
    (coupling,) = chain.couplings
    assert (coupling.joint2, coupling.polynomial) == ("left_slide", (0.0, 2.0))


def test_joints_of_one_name_are_called_by_their_paths(tmp_path: Path) -> None:
    def arm(name: str) -> str:
        hinge = joint("hinge", AXIS + f"        rel physics:body1 = </robot/{name}/bar>\n")
        return f'    def Xform "{name}"\n    {{\n{bar("bar")}{hinge}    }}\n'

    chain = loaded(tmp_path, arm("left"), arm("right"))
    assert [joint.name for joint in chain.mechanism.joints] == ["robot_left_hinge", "robot_right_hinge"]
    assert stp.mobility(chain).dof == 2


def test_joints_to_what_is_not_there(tmp_path: Path) -> None:
    absent = bar("gone").replace("def Xform", "over Xform")
    with pytest.raises(FileFormatError, match=r"joins </robot/gone>, which is no part of the stage"):
        loaded(tmp_path, bar("left"), absent, joint("j", AXIS + ends("left", "gone")))


def test_digits_of_positions_in_a_scaled_body_are_scaled(tmp_path: Path) -> None:
    """Half a unit of 12.3457 in a body that is a tenth as large, in cm; the other ends are round numbers."""
    small = bar("left").replace("(5, 0, 0)", "(0, 0, 0)").replace('rotateZ"]', 'rotateZ", "xformOp:scale"]')
    small = small.replace(
        "        uniform", "        double3 xformOp:scale = (0.1, 0.1, 0.1)\n        uniform"
    )
    chain = loaded(tmp_path, small, joint("motor", AXIS + ends("", "left", at1="(12.3457, 0, 0)") + MOTOR))
    assert chain.mechanism.digits == pytest.approx((0.5e-4 * 0.1 * 0.01, 0.0), rel=1e-12)


def test_a_mass_without_its_schema_is_refused(tmp_path: Path) -> None:
    """Engines do not see it, and compute another one."""
    left = BARS[0].replace(', "PhysicsMassAPI"', "")
    with pytest.raises(FileFormatError, match="has physics:mass, but not the schema PhysicsMassAPI"):
        loaded(tmp_path, left, HINGES[0])
