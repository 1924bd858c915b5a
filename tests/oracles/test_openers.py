"""Which other readers open the files of each dialect, and that they find our tree in it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'stewart_pin[oracles]'")
pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

import mujoco
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

FORMATS = ("urdf+", "drake", "isaac", "gepetto")
ROBOTS = ("delta", "four_bar", "stewart")


@pytest.fixture(params=FORMATS)
def format(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=ROBOTS)
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    return stp.load(request.param, gravity=(0.1, 0.2, -1.62))


@pytest.fixture
def path(chain: stp.ClosedChain, format: str, tmp_path: Path) -> Path:
    stp.export(chain, tmp_path / "a.urdf", format=format)
    return tmp_path / "a.urdf"


def test_pinocchio(chain: stp.ClosedChain, path: Path) -> None:
    model = pin.buildModelFromUrdf(str(path))
    assert list(model.names) == list(chain.model.names)
    assert np.isclose(pin.computeTotalMass(model), pin.computeTotalMass(chain.model), rtol=1e-14)


def test_drake(chain: stp.ClosedChain, path: Path, format: str) -> None:
    plant = MultibodyPlant(1e-3)
    if format == "isaac":
        with pytest.raises(RuntimeError, match="loop joints are not supported"):
            Parser(plant).AddModels(str(path))
        return
    Parser(plant).AddModels(str(path))
    assert {plant.get_joint(i).name() for i in plant.GetJointIndices()} >= {
        joint.name for joint in chain.mechanism.joints if joint.has_axis
    }


def test_mujoco(chain: stp.ClosedChain, path: Path) -> None:
    # MuJoCo wants mass on every moving body; the crosses of universal joints have none.
    settings = '<mujoco><compiler boundmass="1e-9" boundinertia="1e-12"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(path.read_text().replace("</robot>", settings))
    assert {model.joint(k).name for k in range(model.njnt)} >= {
        joint.name for joint in chain.mechanism.joints if joint.has_axis
    }
    assert model.nv == chain.nv


def test_yourdfpy(tmp_path: Path) -> None:
    chain = stp.load("stewart", gravity=(0.1, 0.2, -1.62))
    for format in FORMATS:
        stp.export(chain, tmp_path / f"{format}.urdf", format=format)
    # In a process of its own: it imports for a second, and warns of what it imports.
    code = (
        "import sys, logging, yourdfpy; logging.disable(); "
        "[print(*sorted(yourdfpy.URDF.load(name).actuated_joint_names)) for name in sys.argv[1:]]"
    )
    files = sorted(map(str, tmp_path.glob("*.urdf")))
    answer = subprocess.run([sys.executable, "-c", code, *files], capture_output=True, text=True, timeout=100)
    assert answer.returncode == 0, answer.stderr
    movable = {joint.name for joint in chain.mechanism.joints if joint.has_axis}
    found = answer.stdout.splitlines()
    assert len(found) == len(FORMATS) and all(movable <= set(line.split()) for line in found)
