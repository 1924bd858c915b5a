"""The files of the biped Cassie, as the package example-robot-data ships them."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import JointKind

FILES = ("cassie", "cassie_reduced", "cassie_simple", "cassie_v2", "cassie_wo_gearbox_spring")
SIDES = ("left", "right")
MOTORS = tuple(f"{side}-{joint}" for side in SIDES for joint in ("roll", "yaw", "pitch", "knee", "foot"))
"""Five per leg; the joints are called -op behind the gearbox, -ip before it."""

_SHARE = "cmeel.prefix/share/example-robot-data/robots/cassie_description"
_TYPO = ("<izz>9.4e-6</izz>", "<izz>9.4e-7</izz>")
"""The rotors of the feet: as printed, no body has such an inertia; with the exponent of the other moments, one has."""


def folder() -> Path | None:
    """Find the folder of the files, or None where the package is not installed."""
    try:
        found = Path(str(distribution("example-robot-data").locate_file(_SHARE)))
    except PackageNotFoundError:
        return None
    return found if found.is_dir() else None


def text(name: str) -> str:
    """Return a file as text, with physical rotors."""
    root = folder()
    assert root is not None
    return (root / "robots" / f"{name}.sdf").read_text().replace(*_TYPO)


def motors(name: str) -> list[str]:
    """Return the motor joints of a file."""
    return [f"{motor}-{'ip' if name == 'cassie' else 'op'}" for motor in MOTORS]


def load(name: str, scratch: Path, content: str | None = None) -> stp.ClosedChain:
    """Load a file, or another content under its name."""
    path = scratch / f"{name}.sdf"
    path.write_text(text(name) if content is None else content)
    return stp.load(path, motors=motors(name), platform="pelvis")


def standing(chain: stp.ClosedChain) -> np.ndarray:
    """Return the pose 'standing' of the SRDF; joints that it does not know stay at zero."""
    root = folder()
    assert root is not None
    state = etree.parse(str(root / "srdf" / "cassie_v2.srdf")).getroot().find("group_state")
    assert state is not None
    values = {e.get("name"): np.array(e.get("value", "").split(), float) for e in state.iter("joint")}
    q = pin.neutral(chain.model)
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        value = values.get("root_joint" if name == "pelvis_floating" else name, np.zeros(0))
        if len(value) == joint.nq:
            q[joint.idx_q : joint.idx_q + joint.nq] = value
    return pin.normalize(chain.model, q)


def held(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Hold the pelvis where it is at home; the platform is a foot, because a platform has to move."""
    mechanism = chain.described()
    base = next(joint for joint in mechanism.joints if joint.child == "pelvis")
    if base.kind is JointKind.FLOATING:
        placement = pin.XYZQUATToSE3(mechanism.home[base.name])
    else:
        slide = float(mechanism.home[base.name][0]) * base.axis
        placement = base.placement * pin.SE3(np.eye(3), slide)
    fixed = replace(base, kind=JointKind.FIXED, placement=placement, lower=-np.inf, upper=np.inf)
    joints = tuple(fixed if joint is base else joint for joint in mechanism.joints)
    home = {name: value for name, value in mechanism.home.items() if name != base.name}
    return build_chain(
        replace(mechanism, joints=joints, home=home), motors=chain.motors, platform="left-foot"
    )
