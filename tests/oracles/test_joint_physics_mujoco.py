"""Rotors, damping, dry friction and springs of joints: MuJoCo, given the same file, has the same forces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from tests.model.small_mjcf import write
from tests.oracles.test_mjcf_reading import Twin, random_states, require_same_tree
from tests.oracles.test_mujoco import compiled, random_configuration

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'stewart_pin[mjcf]'")

AGREE = 1e-12
"""Relative to the largest effort: sums of a few products, written with all digits."""

ARM = """
<mujoco model="arm">
  <compiler angle="{angle}"/>
  <option gravity="1 -2 -9"><flag {flags}/></option>
  <default><joint damping="0.3"/><geom size="0.1"/></default>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 0.6 0.8" ref="0.2" pos="0.1 0 0.05" {shoulder}/><geom/>
      <body name="lower" pos="0.5 0 0.1" euler="10 20 30">
        <joint name="elbow" type="slide" axis="1 2 0" ref="-0.1" {elbow}/>
        <joint name="twist" axis="-1 0 1" pos="0 0.1 0" armature="0.4"/><geom pos="0 0.1 0.2"/>
        <body name="hand" pos="0.1 0.3 0"><joint name="wrist" type="ball" pos="0.02 0 0" {wrist}/><geom/></body>
      </body>
    </body>
    <body name="free"><joint name="float" type="free" {float}/><geom/></body>
  </worldbody>
  {rest}
</mujoco>
"""
TENDONS = (
    '<tendon><fixed name="belt" {}><joint joint="elbow" coef="-2.5"/></fixed>'
    '<fixed name="half" stiffness="3" damping="0.2"><joint joint="elbow" coef="0.5"/><joint joint="twist" coef="0"/>'
    "</fixed></tendon>"
)
MODELS = {
    "springs": {"shoulder": 'stiffness="3" springref="0.5"', "elbow": 'stiffness="7" springref="0.4"'},
    "springs of higher powers": {"shoulder": 'stiffness="3 -0.5 0.25" springref="-0.3"', "elbow": 'stiffness="0 2"'},
    "springs in degrees": {"angle": "degree", "shoulder": 'stiffness="3 0.5" springref="35"'},
    "springs by their decay": {"shoulder": 'springdamper="0.5 0.8"', "elbow": 'springdamper="0.2 1.1"'},
    "rotors and dry friction": {
        "shoulder": 'armature="0.7" frictionloss="0.4"',
        "elbow": 'armature="0.1" frictionloss="0.2"',
        "wrist": 'armature="0.05" frictionloss="0.3"',
    },
    "balls and free bodies": {"wrist": 'stiffness="2" damping="0.7"', "float": 'damping="0.9"'},
    "tendons over one joint": {
        "elbow": 'stiffness="7 1 0.3" springref="0.4" armature="0.2" frictionloss="0.1"',
        "rest": TENDONS.format(
            'stiffness="2 0.3 0.1" springlength="0.4" damping="0.2" frictionloss="0.3" armature="0.6"'
        ),
    },
    "rotors behind gears": {
        "shoulder": 'armature="0.1" damping="0.2"',
        "rest": TENDONS.format('armature="0.1"')
        + '<actuator><motor joint="shoulder" gear="-30" armature="2e-3" damping="1e-3"/>'
        '<position joint="shoulder" kp="0" gear="7" armature="0.02"/><motor tendon="belt" gear="4" armature="0.3"/>'
        '<motor jointinparent="twist" gear="5" damping="0.04"/><motor joint="wrist" gear="2 1 0" armature="0.1"/>'
        "</actuator>",
    },
    "no springs": {"flags": 'spring="disable"', "shoulder": 'stiffness="3"', "rest": TENDONS.format('stiffness="2"')},
    "no dampers": {"flags": 'damper="disable"', "shoulder": 'stiffness="3"', "rest": TENDONS.format('damping="2"')},
    "no friction": {
        "flags": 'frictionloss="disable"',
        "shoulder": 'frictionloss="3" stiffness="2"',
        "rest": TENDONS.format('frictionloss="2"'),
    },
}  # fmt: skip
_NOTHING = {"angle": "radian", "flags": 'gravity="enable"'}


def arm(folder: Path, **words: str) -> Path:
    slots = dict.fromkeys(("shoulder", "elbow", "wrist", "float", "rest"), "")
    return write(folder, ARM.format(**(slots | _NOTHING | words)))


def rubbing_limits(model: Any, data: Any) -> np.ndarray:
    """(nv,) what dry friction may hold of each of MuJoCo's coordinates, summed over joints and tendons."""
    kinds = mujoco.mjtConstraint
    rows = np.isin(data.efc_type, [kinds.mjCNSTR_FRICTION_DOF, kinds.mjCNSTR_FRICTION_TENDON])
    # There may be room for more rows than there are.
    jacobian = data.efc_J[: len(rows) * model.nv].reshape(-1, model.nv)[rows]
    return data.efc_frictionloss[rows] @ np.abs(jacobian)


@pytest.mark.parametrize("name", MODELS)
def test_files_mean_what_they_mean_in_mujoco(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    twin = Twin.of(arm(tmp_path, **MODELS[name]), motors=[])
    require_same_tree(twin, rng)
    for q, v in random_states(twin.chain, rng, 4):
        turn, _ = twin.set(q, v)
        effects = twin.chain.at(q, v).effects
        ours = np.zeros(twin.chain.nv) if effects is None else effects.smooth
        theirs = turn.T @ twin.data.qfrc_passive
        assert np.abs(ours - theirs).max() <= AGREE * np.abs(theirs).max()
        limits = np.abs(turn).T @ rubbing_limits(twin.model, twin.data)
        np.testing.assert_allclose(twin.chain.model.upperDryFrictionLimit, limits, rtol=AGREE, atol=0)


TOLD = {
    "damping by powers": (
        {"shoulder": 'damping="1 0.5 0.25"'},
        "damping 0.5 0.25 by higher powers of the speed",
    ),
    "a spring that yields": ({"shoulder": 'stiffness="3" springyield="0.5"'}, "springyield 0.5"),
    "a ball by powers": ({"wrist": 'stiffness="3 1"'}, "stiffness 3 1: a ball has a linear spring"),
    "a sprung free body": ({"float": 'stiffness="3"'}, "stiffness 3: left out, as a floating body"),
    "a free body with a rotor": ({"float": 'armature="0.2"'}, "armature 0.2: along its own axes"),
    "a slack tendon": (
        {"rest": TENDONS.format('stiffness="2 1" springlength="0.1 0.3"')},
        "stiffness 2 1 beyond the lengths 0.1 to 0.3",
    ),
    "a tendon over two joints": (
        {
            "rest": TENDONS.replace('coef="0"', 'coef="1"').format("")
            + '<actuator><motor tendon="half" armature="0.1"/></actuator>'
        },
        "stiffness 3: left out, as it acts on several joints at once",
    ),
    "no springs": (MODELS["no springs"], "stiffness 3: the file disables all springs"),
    "no dampers": (MODELS["no dampers"], "damping 0.3: the file disables all dampers"),
    "no friction": (MODELS["no friction"], "frictionloss 3: the file disables it"),
}


@pytest.mark.parametrize("name", TOLD)
def test_what_has_no_counterpart_is_told(name: str, tmp_path: Path) -> None:
    words, said = TOLD[name]
    report = str(stp.load(arm(tmp_path, **words), motors=[]).report)
    assert said in report
    if name == "a tendon over two joints":
        assert (
            "damping 0.2: left out, as it acts" in report and "armature 0.1: left out, as it acts" in report
        )


QUANTITIES = {
    "armature": 0.3,
    "damping": 1.7,
    "friction": 0.2,
    "stiffness": (5.0, 0.4, 0.3),
    "rest": 0.35,
    "force": -2.0,
}
BALL = {"armature": 0.02, "damping": 0.4, "friction": 0.1, "stiffness": 0.8}


def effective(name: str) -> stp.ClosedChain:
    """Give all joints of the tree other numbers."""
    chain = stp.load(name)
    own = {}
    for k, joint in enumerate(chain.mechanism.joints):
        told = QUANTITIES if joint.has_axis else BALL if joint.kind == "spherical" else {}
        if told:
            own[joint.name] = {key: np.multiply(value, 1 + k / 7).tolist() for key, value in told.items()}
    return stp.with_joint_physics(chain, own)


@pytest.mark.parametrize("name", ["stewart", "delta", "five_bar", "agile_eye", "hexapod_rss"])
def test_exports_mean_the_same_to_mujoco(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    chain = effective(name)
    engine = compiled(chain, tmp_path)
    for _ in range(3):
        q, v = random_configuration(chain, rng), rng.uniform(-1, 1, chain.nv)
        turn = engine.set(q, v)
        inertia = engine.inertia()
        state = chain.at(q, v)
        assert np.abs(turn.T @ inertia @ turn - state.M).max() < 1e-10 * np.abs(state.M).max()
        effects = state.effects
        assert effects is not None
        theirs = turn.T @ engine.data.qfrc_passive
        assert np.abs(effects.smooth - theirs).max() <= AGREE * np.abs(theirs).max()
        limits = np.abs(turn).T @ rubbing_limits(engine.model, engine.data)
        np.testing.assert_allclose(chain.model.upperDryFrictionLimit, limits, rtol=AGREE, atol=0)


SPRINGS = {
    "linear": {"stiffness": 3.0, "rest": 0.4},
    "preloaded": {"stiffness": 3.0, "rest": 0.4, "force": 2.0},
    "cubic, preloaded": {"stiffness": (1.0, 0.3, 0.7), "rest": -0.2, "force": 1.5},
    "cubic without a linear part": {"stiffness": (0.0, 0.0, 2.0), "rest": 0.1, "force": 3.0},
    "quadratic that balances": {"stiffness": (1.0, 0.5), "rest": 0.1, "force": 2.0},
    "quadratic that never does": {"stiffness": (1.0, 0.5), "rest": 0.1, "force": -2.0},
    "constant force": {"force": -2.5, "rest": 0.3},
    "of the fifth power": {"stiffness": (1.0, 0.0, 0.2, 0.0, 3.0), "rest": 0.3, "force": 0.5},
    "stiff, far preloaded": {"stiffness": (1e7, 2e6, 3e5), "rest": 0.3, "force": 1e7},
}
IN_CUSTOM = {
    "quadratic that never does": "force -2",
    "constant force": "force -2.5",
    "of the fifth power": "0 0 0 0 3",
}


def pull(chain: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
    effects = chain.at(q).effects
    assert effects is not None
    return effects.elastic


@pytest.mark.parametrize("name", SPRINGS)
def test_springs_come_back(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    """As the same effort: a preloaded spring may be told about another rest. What MuJoCo lacks is told."""
    chain = stp.with_joint_physics(stp.load("five_bar"), {"left_knee": SPRINGS[name]})
    report = stp.export(chain, tmp_path / "a.xml", format="mjcf")
    again = stp.load(tmp_path / "a.xml")
    told = [note.text for note in report.notes if note.subject == "joint 'left_knee'"]
    assert [IN_CUSTOM[name] in text for text in told] == ([True] if name in IN_CUSTOM else [])
    at = [each.model.joints[each.model.getJointId("left_knee")] for each in (chain, again)]
    for _ in range(3):
        q = random_configuration(chain, rng)
        theirs = again.q_home.copy()
        theirs[at[1].idx_q] = q[at[0].idx_q]
        ours, read = (
            pull(each, x)[own.idx_v] for each, x, own in zip((chain, again), (q, theirs), at, strict=True)
        )
        assert abs(read - ours) <= AGREE * np.abs(chain.mechanism.joint("left_knee").physics.polynomial).max()


def test_loops_are_told_with_their_numbers(tmp_path: Path) -> None:
    own = {"tip_pin": {"damping": 0.15, "friction": 0.3, "stiffness": 2.0}}
    report = stp.export(stp.with_joint_physics(stp.load("five_bar"), own), tmp_path / "a.xml", format="mjcf")
    (note,) = [note for note in report.notes if note.subject == "loop 'tip_pin'"]
    assert note.text.startswith("its angle: damping 0.15, friction 0.3, stiffness 2: left out")


def test_words_of_our_own_need_their_joint(tmp_path: Path) -> None:
    custom = (
        '<custom><numeric name="spring:nobody" data="0 1"/><numeric name="spring:elbow" data="0"/></custom>'
    )
    report = str(stp.load(arm(tmp_path, rest=custom), motors=[]).report)
    assert "no joint of this name that has one freedom (<numeric name='spring:nobody'>)" in report
    assert "the name 'spring:elbow': unknown; it takes two numbers or more" in report
