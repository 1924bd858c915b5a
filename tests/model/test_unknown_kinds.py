"""A kind of joint that a table does not know is refused there by name: none is taken for another one."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from stewart_pin.cli.inspect import freedoms
from stewart_pin.errors import UnsupportedError
from stewart_pin.mechanics.articulated_body.bodies import joint_motion, motion_subspace
from stewart_pin.mechanics.constraint_matrix.columns import transmitted
from stewart_pin.mechanics.constraint_matrix.kinematics import _joint_transform
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.model.formats.dialect import dialects
from stewart_pin.model.formats.mjcf.writing import write_mjcf_file
from stewart_pin.model.formats.sdf.writing import write_sdf
from stewart_pin.model.formats.usd.writing import write_usd
from stewart_pin.model.loop_rows import closure_rows
from stewart_pin.model.sizes import length_scale
from stewart_pin.model.tree import build_tree
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.joint_coordinates import Coordinate, _Ball


class Other(StrEnum):
    """Kinds beside those that there are."""

    HELIX = "helix"


HELIX: Any = Other.HELIX
ONE = pin.SE3.Identity()
BODIES = (Link("ground"), *(Link(name, pin.Inertia.FromSphere(1.0, 0.1)) for name in ("one", "two")))
JOINT = Joint("thread", HELIX, "ground", "one", ONE)
LOOP = Loop("thread", HELIX, "one", "two", ONE, ONE)
TREE = Mechanism("a", BODIES[:2], (JOINT,), home={"thread": np.zeros(1)})
FREE = tuple(Joint(name, JointKind.FLOATING, "ground", name, ONE) for name in ("one", "two"))
CLOSED = Mechanism(
    "a", BODIES, FREE, (LOOP,), home={name: np.array([0.0] * 6 + [1.0]) for name in ("one", "two")}
)

MODELLED: Any = SimpleNamespace(
    mechanism=TREE,
    nv=1,
    model=SimpleNamespace(names=["universe", "thread"], joints=[None, pin.JointModelRX()]),
)

Ask = Callable[[Path], object]
JOINTS: dict[str, Ask] = {
    "model": lambda _: build_tree(TREE, np.zeros(3)),
    "size": lambda _: length_scale(TREE),
    "natural sizes": lambda _: ClosedChain.angle_mask.func(MODELLED),
    "freedoms of a file": lambda _: freedoms(TREE),
    "twists of the articulated bodies": lambda _: motion_subspace(JOINT),
    "places of the articulated bodies": lambda _: joint_motion(JOINT, np.zeros(1)),
    "maximal coordinates": lambda _: _joint_transform(JOINT, np.zeros(1)),
}
LOOPS: dict[str, Ask] = {
    "rows": lambda _: closure_rows(LOOP),
    "size": lambda _: length_scale(CLOSED),
    "maximal coordinates": lambda _: transmitted(LOOP),
}
WRITERS: dict[str, Callable[[Mechanism, Path], object]] = {
    **{dialect.name: dialect.write for dialect in dialects() if dialect.write is not None},
    "sdf": write_sdf,
    "mjcf": lambda mechanism, path: write_mjcf_file(mechanism, path, motors=(), gravity=np.zeros(3)),
    **({"usd": write_usd} if find_spec("pxr") else {}),
}


@pytest.mark.parametrize("ask", JOINTS.values(), ids=JOINTS)
def test_of_joints(ask: Ask, tmp_path: Path) -> None:
    with pytest.raises(UnsupportedError, match=r"joint 'thread' is of kind 'helix', which .* does not know"):
        ask(tmp_path)


@pytest.mark.parametrize("ask", LOOPS.values(), ids=LOOPS)
def test_of_loops(ask: Ask, tmp_path: Path) -> None:
    with pytest.raises(UnsupportedError, match=r"loop 'thread' is of kind 'helix', which .* does not know"):
        ask(tmp_path)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_of_writers(write: Callable[[Mechanism, Path], object], tmp_path: Path) -> None:
    for mechanism, owner in ((TREE, "joint"), (CLOSED, "loop")):
        if (write, owner) == (WRITERS["urdf+"], "loop"):
            continue  # it writes the kind's own name, which the reader judges
        with pytest.raises(UnsupportedError, match=f"{owner} 'thread' is .*helix"):
            write(mechanism, tmp_path / "a.usda")
    assert not list(tmp_path.iterdir())


def test_of_coordinates() -> None:
    read = Coordinate(_Ball(0, 0), "slant", JointKind.SPHERICAL, np.eye(3)[2], np.eye(3)[1])
    for ask in (read._value, read._gradient):
        with pytest.raises(UnsupportedError, match="nothing reads a coordinate 'slant' of a joint"):
            ask(ONE)


def test_of_kernels() -> None:
    ca = pytest.importorskip("casadi")
    from stewart_pin.kernels.graph.bodies import joint_effort, joint_placement, joint_velocity

    joint: Any = SimpleNamespace(name="thread", kind=HELIX, axis=np.eye(3)[2])
    asked = (
        lambda: joint_velocity(joint, ca.SX.sym("v")),
        lambda: joint_placement(joint, ca.SX.sym("q")),
        lambda: joint_effort(joint, ca.SX.sym("f", 3), ca.SX.sym("m", 3)),
    )
    for ask in asked:
        with pytest.raises(UnsupportedError, match="joint 'thread' is of kind 'helix'"):
            ask()
