"""Closed forms stand for a chain only where they agree with the general way; elsewhere that answers."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.mechanics import closed_forms
from tests.closed_states import robot
from tests.retelling.case import sway
from tests.retelling.changes import CHANGES, changed

ZOO = Path(__file__).parent.parent / "zoo" / "urdf"
FORMS = {
    "stewart": {"leg_lengths", "leg_efforts", "point_mass"},
    "stewart_sps": {"leg_lengths", "leg_efforts", "point_mass"},
    "rpr_planar": {"planar_lengths"},
    "delta": {"crank_angles"},
    "hexapod_rss": {"crank_angles"},
    "four_bar": set(),
}


def admitted(chain: stp.ClosedChain) -> set[str]:
    return {found.form for found in stp.dynamics.closed_forms(chain) if found.admitted}


@pytest.mark.parametrize("name", FORMS)
def test_forms_of_the_bundled_robots(name: str) -> None:
    assert admitted(robot(name)) == FORMS[name]


@pytest.mark.parametrize("telling", ["base moved and turned", "all at once"])
@pytest.mark.parametrize("name", ["stewart", "stewart_sps", "rpr_planar", "delta"])
def test_forms_of_a_chain_told_otherwise(name: str, telling: str) -> None:
    chain = robot(name)
    mechanism, _ = changed(chain.described(), CHANGES[telling](chain))
    assert admitted(build_chain(mechanism, platform=chain.platform)) == FORMS[name]


def swaying(
    chain: stp.ClosedChain, scale: float = 1.0, times: np.ndarray | None = None
) -> stp.motions.PlatformSamples:
    times = np.linspace(0, 1, 3) if times is None else times
    if chain.nu > 6:
        home = stp.platform_pose(chain, chain.q_home)
        amplitude = 0.01 * scale * np.array([1.0, 0.5, 2.0])
        return stp.motions.sinusoidal_motion(times, home=home, amplitude=amplitude, frequency=(1, 1.1, 1.2))
    home = stp.motor_positions(chain, chain.q_home)
    size = 0.01 * scale * chain.tangent_scale[chain.motor_index]
    return sway(chain, home, size, 1 + 0.1 * np.arange(chain.nu), times)


def eight_legs() -> stp.ClosedChain:
    """Build a platform on eight UPS legs, which share its load by least norm."""
    inertia = {
        "platform": pin.Inertia(20.0, np.zeros(3), np.eye(3)),
        "lower": pin.Inertia(2.0, np.array([0, 0, 0.2]), 0.02 * np.eye(3)),
        "upper": pin.Inertia(1.0, np.array([0, 0, -0.2]), 0.01 * np.eye(3)),
    }
    angles = np.deg2rad([10, 110, 130, 230, 250, 350])
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    shape = stp.Hexapod(ring, 0.6 * ring[[1, 0, 3, 2, 5, 4]])
    more = stp.Hexapod(1.2 * ring[::-1], 0.5 * ring)
    home = pin.SE3(np.eye(3), np.array([0, 0, 1.0]))
    one, two = (stp.hexapod_chain(x, **inertia, home=home).described() for x in (shape, more))
    named = lambda text: text.replace("leg1", "leg7").replace("leg2", "leg8")  # noqa: E731 - a word
    extra = lambda name: name.startswith(("leg1", "leg2"))  # noqa: E731 - a test
    links = [replace(x, name=named(x.name)) for x in two.links if extra(x.name)]
    joints = [
        replace(x, name=named(x.name), parent=named(x.parent), child=named(x.child))
        for x in two.joints
        if extra(x.name)
    ]
    loops = [
        replace(x, name=named(x.name), link1=named(x.link1), link2=named(x.link2))
        for x in two.loops
        if extra(x.name)
    ]
    values = {named(name): value for name, value in two.home.items() if extra(name)}
    return build_chain(
        replace(
            one,
            links=(*one.links, *links),
            joints=(*one.joints, *joints),
            loops=(*one.loops, *loops),
            home={**one.home, **values},
        )
    )


def lopsided() -> stp.ClosedChain:
    rod = pin.Inertia(2.0, np.array([0.02, 0.0, -0.2]), np.diag([0.1, 0.1, 0.01]))
    return stp.build.replace_inertias(robot("stewart_sps"), {"leg1_upper": rod})


OTHERS = pytest.mark.parametrize(
    "make",
    [
        pytest.param(lambda: stp.load(ZOO / "tricept.urdf"), id="tricept"),
        pytest.param(lambda: stp.load("tripod_3upu"), id="3upu"),
        pytest.param(eight_legs, id="8ups"),
        pytest.param(lopsided, id="lopsided"),
    ],
)


@pytest.mark.slow
@OTHERS
def test_kernels_never_change_an_answer(make) -> None:
    """Compiled where that can be done, and state by state where it cannot, without a word of refusal."""
    chain = make()
    samples = swaying(chain)
    plain, found = (stp.motor_demand(chain, samples, kernels=kernels) for kernels in (False, True))
    size = np.abs(plain.efforts).max()
    np.testing.assert_allclose(found.efforts, plain.efforts, atol=1e-9 * size)
    np.testing.assert_allclose(found.positions, plain.positions, atol=1e-9)
    compared = stp.compare_methods(chain, samples, kernels=True)
    assert ("kernels" in compared.forces) == (found.method == "kernels")
    np.testing.assert_allclose(compared.reference, plain.efforts, atol=1e-9 * size)
    swept = [
        stp.sweep_demand(chain, lambda scale: swaying(chain, scale), {"scale": [1.0]}, kernels=kernels)
        for kernels in (False, True)
    ]
    np.testing.assert_allclose(swept[1]["peak_effort"], swept[0]["peak_effort"], rtol=1e-9)


@OTHERS
def test_no_verb_refuses_what_another_can_do(make) -> None:
    """Demand, comparison, control and fits answer alike where no closed form is; kernels never change an answer."""
    chain = make()
    samples = swaying(chain)
    plain = stp.motor_demand(chain, samples, kernels=False)
    assert plain.method == "one_state" and not {"leg_efforts"} & admitted(chain)
    size = np.abs(plain.efforts).max()
    found = stp.motor_demand(chain, samples)
    np.testing.assert_allclose(found.efforts, plain.efforts, atol=1e-9 * size)
    compared = stp.compare_methods(chain, samples, kernels=False)
    assert "closed_form" not in compared.forces and any("closed form" in note for note in compared.notes)
    np.testing.assert_allclose(compared.reference, plain.efforts, atol=1e-9 * size)
    reference = lambda t: swaying(chain, times=t)  # noqa: E731 - a motion
    rest = np.zeros(chain.nv)
    at = swaying(chain, times=np.array([0.3]))
    asked = stp.motor_demand(chain, at)
    pid = stp.control.LegPID(chain, reference, kp=1.0, kd=0.0)(0.3, chain.q_home, rest)
    np.testing.assert_allclose(pid, asked.positions[0] - chain.q_home[chain.motor_q_index], atol=1e-11)
    for model in ("full", "point_mass"):
        assert np.isfinite(stp.control.Feedforward(chain, reference, model)(0.3, chain.q_home, rest)).all()
        assert np.isfinite(
            stp.control.ComputedTorque(chain, reference, model=model)(0.3, chain.q_home, rest)
        ).all()
    assert stp.fit_to_limits(chain, lambda scale: swaying(chain, scale)).scale == 1.0


def test_a_reading_that_is_wrong_costs_the_shortcut_not_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Legs read off by a millionth of their length: every verb answers as the chain itself does."""
    chain = robot("stewart")
    right = stp.motor_demand(chain, swaying(chain), kernels=False)
    read = closed_forms._FORMS["leg_efforts"][0]

    def wrong(chain: stp.ClosedChain) -> closed_forms.LegForm:
        legs = read(chain)
        moved = stp.Hexapod(legs.hexapod.base_points * (1 + 1e-6), legs.hexapod.platform_points)
        return replace(legs, hexapod=moved)

    for form in ("leg_lengths", "leg_efforts"):
        compare = closed_forms._FORMS[form][1]
        monkeypatch.setitem(closed_forms._FORMS, form, (wrong, compare))
    fresh = replace(chain)
    found = stp.motor_demand(fresh, swaying(fresh), kernels=False)
    assert (right.method, found.method) == ("closed_form", "one_state")
    assert 1e-9 < closed_forms.admission(fresh, "leg_efforts").miss < 1e-3
    assert "differs" in str(closed_forms.admission(fresh, "leg_efforts"))
    np.testing.assert_allclose(found.efforts, right.efforts, atol=1e-9 * np.abs(right.efforts).max())
    compared = stp.compare_methods(fresh, swaying(fresh), kernels=False)
    assert "closed_form" not in compared.forces
    efforts = [
        stp.control.LegPID(c, lambda t: swaying(chain, times=t))(0.3, c.q_home, np.zeros(c.nv))
        for c in (chain, fresh)
    ]
    np.testing.assert_allclose(efforts[1], efforts[0], atol=1e-9 * np.abs(efforts[0]).max())


def test_an_admission_is_made_once_and_again_for_a_chain_made_of_it() -> None:
    chain = robot("stewart")
    assert closed_forms.admission(chain, "leg_efforts") is closed_forms.admission(chain, "leg_efforts")
    payload = stp.attach_payload(chain, pin.Inertia(3.0, np.array([0, 0.1, 0.1]), 0.1 * np.eye(3)))
    found = closed_forms.admission(payload, "leg_efforts").geometry
    assert isinstance(found, closed_forms.LegForm) and found.bodies is not None
    assert found.bodies.platform.mass == pytest.approx(23.0)


@pytest.mark.slow
def test_workspace_and_modes_of_legs_that_no_closed_form_stands_for() -> None:
    """The chain answers for itself, to the same numbers: with axes that miss by printed digits, to those digits."""
    chain = robot("stewart")
    other = replace(chain)
    read = closed_forms.admission(chain, "leg_lengths").geometry
    other.found["leg_lengths"] = closed_forms.Admission("leg_lengths", False, np.inf, "for the test", read)
    spacing = 1.3 * chain.length_scale
    one, two = (stp.workspaces.sample_workspace(c, np.eye(3), spacing=spacing) for c in (chain, other))
    np.testing.assert_array_equal(two.inside, one.inside)
    np.testing.assert_allclose(two.clearance, one.clearance, atol=1e-11)
    np.testing.assert_allclose(two.dexterity, one.dexterity, atol=1e-9)
    readings = stp.motor_positions(chain, chain.q_home) + 0.01 * np.arange(6)
    one, two = (stp.assembly_modes(c, readings, engine="numpy") for c in (chain, other))
    np.testing.assert_allclose(two.position, one.position, atol=1e-8)
    assert one.certified.all() and not two.certified.any() and two.residual.max() < 1e-10


def guided(tmp_path: Path) -> stp.ClosedChain:
    """Tell a carriage on two slides, three legs on it: lengths are those of a planar platform, turns are not."""
    bodies = {
        "x": ("base", "prismatic", "0 0 0", "1 0 0"), "platform": ("x", "prismatic", "0 0 .6", "0 0 1"),
        "r0": ("base", "continuous", "-.8 0 0", "0 1 0"), "s0": ("r0", "prismatic", ".3 0 .2", "8 0 5.5"),
        "r1": ("base", "continuous", ".8 0 0", "0 1 0"), "s1": ("r1", "prismatic", "-.3 0 .2", "-7.5 0 5.5"),
        "r2": ("base", "continuous", ".1 0 1.4", "0 1 0"), "s2": ("r2", "prismatic", "0 0 -.3", "0 0 -1"),
    }  # fmt: skip
    text = '<robot name="guided"><link name="base"/>'
    for name, (parent, kind, xyz, axis) in bodies.items():
        limit = '<limit lower="-2" upper="2" effort="9" velocity="9"/>' if kind == "prismatic" else ""
        drive = ' independent="true"' if name in ("s0", "s1", "s2") else ""
        along = np.array(axis.split(), dtype=float)
        unit = " ".join(f"{x:.17g}" for x in along / np.linalg.norm(along))
        text += (
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" '
            f'iyz="0"/></inertial></link><joint name="{name}_joint" type="{kind}"{drive}><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{xyz}"/><axis xyz="{unit}"/>{limit}</joint>'
        )
    for k, (own, on) in enumerate(
        [(".5 0 .35", "0 0 -.05"), ("-.45 0 .35", ".05 0 -.05"), ("0 0 -.55", ".1 0 -.05")]
    ):
        text += (
            f'<loop name="loop{k}" type="revolute"><predecessor link="s{k}"><origin xyz="{own}"/></predecessor>'
            f'<successor link="platform"><origin xyz="{on}"/></successor><axis xyz="0 1 0"/></loop>'
        )
    path = tmp_path / "guided.urdf"
    path.write_text(text + "</robot>")
    return stp.load(path)


def test_a_guided_platform_has_no_closed_form(tmp_path: Path) -> None:
    """Wherever its slides let it go the lengths agree; the closed form would turn it as well."""
    chain = guided(tmp_path)
    assert chain.generic.count.platform == 2
    assert [form.form for form in stp.dynamics.closed_forms(chain) if form.admitted] == []
    found = {form.form: form.reason for form in stp.dynamics.closed_forms(chain)}
    assert "2 freedoms instead of 3" in found["planar_lengths"]
    poses = stp.forward_kinematics(
        chain, stp.motor_positions(chain, chain.q_home), all=True, limits=False
    ).poses
    assert all(np.abs(pose.rotation - np.eye(3)).max() < 1e-9 for pose in poses)


@pytest.mark.parametrize("field", ["armature", "damping"])
def test_what_joints_do_is_asked_for_whenever_it_came(field: str) -> None:
    # Set by hand in the model, after everything was asked of the bare chain once.
    chain, fresh = stp.load("stewart"), stp.load("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    motion = partial(stp.motions.sinusoidal_motion, home=home, amplitude=(0.05, 0.0, 0.02))
    answers = [stp.control.Feedforward(chain, motion, model="point_mass")(0.1, chain.q_home, chain.rest)]
    assert admitted(chain) == FORMS["stewart"]
    for each in (chain, fresh):
        setattr(each.model, field, np.full(chain.nv, 3.0))
        answers.append(
            stp.control.Feedforward(each, motion, model="point_mass")(0.1, chain.q_home, chain.rest)
        )
        assert admitted(each) == {"leg_lengths"}
    np.testing.assert_allclose(answers[1], answers[2], rtol=1e-12)
    assert np.abs(answers[1] - answers[0]).max() > 0.1
