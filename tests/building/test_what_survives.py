"""What each format keeps: read(write(x)) has it still, or it is refused by name, or the report tells; never silently.

The table of the README is made of the same answers: ``python -m tests.building.test_what_survives`` prints it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import LOOP_KINDS, Bounds, Coupling, JointKind, Link, Mechanism
from stewart_pin.model.joint_physics import JointPhysics
from stewart_pin.model.shapes import Shape, ShapeKind
from stewart_pin.model.validation import keep_odd_inertias
from tests.mechanisms import four_bar, gear_train, two_bodies

FORMATS = {
    "urdf+": "urdf",
    "drake": "urdf",
    "isaac": "urdf",
    "gepetto": "urdf",
    "sdf": "sdf",
    "usd": "usda",
    "mjcf": "xml",
}
NEEDS = {"gepetto": "yaml", "usd": "pxr", "mjcf": "mujoco"}
README = Path(__file__).parents[2] / "README.md"
HEAD = "| | " + " | ".join(FORMATS) + " |"


@dataclass(frozen=True)
class Thing:
    """Something that a chain has: how to make one, how to ask for it, and whom the report would name."""

    make: Callable[[], stp.ClosedChain]
    ask: Callable[[stp.ClosedChain], Any]
    subject: str


def bar(**changes: Any) -> stp.ClosedChain:
    return build_chain(replace(four_bar().described(), **changes))


def with_joint(name: str, **changes: Any) -> Callable[[], stp.ClosedChain]:
    def make() -> stp.ClosedChain:
        joints = four_bar().described().joints
        return bar(joints=tuple(replace(j, **changes) if j.name == name else j for j in joints))

    return make


def with_link(name: str, **changes: Any) -> Callable[[], stp.ClosedChain]:
    def make() -> stp.ClosedChain:
        links = four_bar().described().links
        changed = tuple(replace(link, **changes) if link.name == name else link for link in links)
        return build_chain(keep_odd_inertias(replace(four_bar().described(), links=changed)))

    return make


def ball(**changes: Any) -> stp.ClosedChain:
    mechanism = two_bodies(JointKind.SPHERICAL, np.random.default_rng(11)).described()
    joints = tuple(replace(j, **changes) if j.name == "ball" else j for j in mechanism.joints)
    return build_chain(replace(mechanism, joints=joints))


def coupled(joint2: str | None, polynomial: tuple[float, ...]) -> stp.ClosedChain:
    mechanism: Mechanism = gear_train(np.random.default_rng(5)).mechanism
    coupling = Coupling("cam", "wheel", joint2, polynomial)
    return build_chain(replace(mechanism, couplings=(coupling,), home={}), motors=["swing"])


def limit(name: str, kind: str) -> Callable[[stp.ClosedChain], Any]:
    """Ask for both ends of a limit, rounded where frames are turned."""

    def ask(chain: stp.ClosedChain) -> list[float] | None:
        names = list(chain.limits.names)
        if name not in names:
            return None
        return [round(float(x), 9) for x in getattr(chain.limits, kind)[names.index(name)]]

    return ask


def shapes(role: str) -> Callable[[stp.ClosedChain], Any]:
    return lambda chain: [(s.kind, s.sizes) for s in getattr(chain.mechanism.link("rocker"), role)]


def inertia(chain: stp.ClosedChain) -> list[float] | None:
    found = chain.mechanism.link("rocker").inertia
    return None if found is None else [round(float(x), 12) for x in found.inertia.ravel()]


def loop(chain: stp.ClosedChain) -> list[tuple[str, str, int]]:
    return [(each.name, str(each.kind), chain.nc) for each in chain.loops]


def swings(name: str) -> Callable[[stp.ClosedChain], Any]:
    """Ask for the limit of a ball, and in which direction the swinging axis points on link 1 at home."""

    def ask(chain: stp.ClosedChain) -> list[float] | None:
        span = limit(f"{name} swing", "position")(chain)
        joints = {joint.name: (joint.placement, joint) for joint in chain.mechanism.joints}
        joints |= {loop.name: (loop.placement1, loop) for loop in chain.loops}
        placement, held = joints[name]
        return span and [*span, *(np.round(placement.rotation @ held.axis, 6) + 0.0).tolist()]

    return ask


def does(name: str) -> Callable[[stp.ClosedChain], Any]:
    """Ask what a joint does by itself: rotor, damping, friction, and the spring's pull in three positions."""

    def ask(chain: stp.ClosedChain) -> list[list[float]]:
        told = {joint.name: (joint.physics,) for joint in chain.described().joints}
        told |= {loop.name: loop.physics for loop in chain.loops}
        return [
            [round(x, 9) + 0.0 for x in (own.armature, own.damping, own.friction, *pulls(own))]
            for own in told[name]
        ]

    def pulls(own: JointPhysics) -> list[float]:
        return [
            float(np.polynomial.polynomial.polyval(x - own.rest, own.polynomial)) for x in (-1.0, 0.3, 2.0)
        ]

    return ask


def effective(
    name: str, kind: JointKind = JointKind.SPHERICAL, **physics: Any
) -> Callable[[], stp.ClosedChain]:
    return lambda: stp.with_joint_physics(four_bar(kind), {name: physics})


BOX = (Shape(ShapeKind.BOX, (0.1, 0.2, 0.3)),)
ODD = pin.Inertia(1.0, np.array([0.3, 0.0, 0.0]), np.diag([1.0, 1.0, 2.5]))
LEANS = np.array([0.6, 0.0, 0.8])
LIMITED = tuple(
    replace(each, axis=LEANS, bounds=(Bounds((-np.inf, 1.0)), Bounds((-np.inf, 3.0))))
    for each in four_bar().loops
)
CRANK = "joint 'crank_motor'"

THINGS = {
    **{
        f"loop: {kind}": Thing(lambda kind=kind: two_bodies(kind, np.random.default_rng(11)), loop, "'loop'")
        for kind in LOOP_KINDS
    },
    "ball in the tree": Thing(ball, lambda c: c.mechanism.joint("ball").kind, "'ball'"),
    "free body": Thing(ball, lambda c: [j.kind for j in c.mechanism.joints if j.child == "free"], "'float'"),
    "linear coupling": Thing(
        lambda: coupled("pinion", (0.2, -0.4)),
        lambda c: [(k.joint1, k.joint2, *np.round(k.polynomial, 9)) for k in c.couplings],
        "'cam'",
    ),
    "coupling of higher degree": Thing(
        lambda: coupled("pinion", (0.2, -0.4, 0.1)),
        lambda c: [np.round(k.polynomial, 9) for k in c.couplings],
        "'cam'",
    ),
    "joint held still": Thing(
        lambda: coupled(None, (0.2,)), lambda c: [np.round(k.polynomial, 9) for k in c.couplings], "'cam'"
    ),
    "range": Thing(with_joint("crank_motor", lower=-1.0, upper=2.0), limit("crank_motor", "position"), CRANK),
    "speed": Thing(with_joint("crank_motor", velocity=3.0), limit("crank_motor", "velocity"), CRANK),
    "speed, two-sided": Thing(
        with_joint("crank_motor", velocity=(-1.0, 3.0)), limit("crank_motor", "velocity"), CRANK
    ),
    "effort of a motor, two-sided": Thing(
        with_joint("crank_motor", effort=(-1.0, 3.0)), limit("crank_motor", "effort"), CRANK
    ),
    "effort without a motor": Thing(
        with_joint("elbow", effort=(-np.inf, 3.0)), limit("elbow", "effort"), "joint 'elbow'"
    ),
    "acceleration": Thing(
        with_joint("crank_motor", acceleration=3.0), limit("crank_motor", "acceleration"), CRANK
    ),
    "jerk": Thing(with_joint("crank_motor", jerk=(-1.0, 3.0)), limit("crank_motor", "jerk"), CRANK),
    "swing of a ball": Thing(lambda: ball(swing=1.0, axis=LEANS), swings("ball"), "'ball'"),
    "turn of a ball": Thing(lambda: ball(turn=3.0), limit("ball angle", "position"), "'ball'"),
    "limits of a loop": Thing(lambda: bar(loops=LIMITED), swings("pin"), "'pin'"),
    "rotor": Thing(effective("crank_motor", armature=0.3), does("crank_motor"), CRANK),
    "damping": Thing(effective("elbow", damping=0.7), does("elbow"), "joint 'elbow'"),
    "dry friction": Thing(effective("elbow", friction=0.2), does("elbow"), "joint 'elbow'"),
    "spring": Thing(effective("elbow", stiffness=3.0, rest=0.4), does("elbow"), "joint 'elbow'"),
    "spring with preload": Thing(
        effective("elbow", stiffness=3.0, rest=0.4, force=1.5), does("elbow"), "joint 'elbow'"
    ),
    "spring of higher degree": Thing(
        effective("elbow", stiffness=(3.0, 0.5, 2.0, 0.0, 1.0), rest=0.4), does("elbow"), "joint 'elbow'"
    ),
    "constant force": Thing(effective("elbow", force=1.5), does("elbow"), "joint 'elbow'"),
    "damping, friction, spring of a ball": Thing(
        lambda: ball(physics=JointPhysics(damping=0.7, friction=0.2, stiffness=(3.0,))),
        does("ball"),
        "'ball'",
    ),
    "damping of a free body": Thing(
        lambda: stp.with_joint_physics(ball(), {"float": {"damping": 0.7}}), does("float"), "'float'"
    ),
    "damping and spring of a loop": Thing(effective("pin", damping=0.7, stiffness=3.0), does("pin"), "'pin'"),
    "friction and preload of a loop": Thing(
        effective("pin", JointKind.REVOLUTE, friction=0.2, stiffness=3.0, force=1.5), does("pin"), "'pin'"
    ),
    "platform": Thing(lambda: bar(platform="rocker"), lambda c: c.platform, "rocker"),
    "motors": Thing(lambda: stp.with_motors(four_bar(), ["elbow"]), lambda c: c.motors, "elbow"),
    "no motors": Thing(lambda: stp.with_motors(four_bar(), []), lambda c: c.motors, "motors"),
    "home": Thing(four_bar, lambda c: np.sort(c.q_home).round(9).tolist(), "home"),
    "gravity": Thing(lambda: bar(gravity=(0.1, 0.2, -3.0)), lambda c: c.gravity.tolist(), "gravity"),
    "visuals": Thing(with_link("rocker", visuals=BOX), shapes("visuals"), "'rocker'"),
    "collision shapes": Thing(with_link("rocker", collisions=BOX), shapes("collisions"), "'rocker'"),
    "inertia that no body has": Thing(with_link("rocker", inertia=ODD), inertia, "'rocker'"),
    "link that is no body": Thing(
        lambda: bar(
            links=(*four_bar().mechanism.links, Link("tip")),
            joints=(
                *four_bar().described().joints,
                replace(
                    four_bar().mechanism.joint("elbow"),
                    name="tip_place",
                    kind=JointKind.FIXED,
                    parent="coupler",
                    child="tip",
                ),
            ),
        ),
        lambda c: [link.inertia for link in c.mechanism.links if link.name == "tip"],
        "tip",
    ),
}


@cache
def made(name: str) -> tuple[stp.ClosedChain, str]:
    """Make the chain that has something, and ask it, once."""
    chain = THINGS[name].make()
    # As text, in which what is not stated equals itself.
    return chain, str(THINGS[name].ask(chain))


@cache
def answer(format: str, name: str) -> str:
    """Write, read, ask: ``yes``, ``refused`` by name, or told in the ``report``; anything else is a silent loss."""
    thing = THINGS[name]
    chain, mine = made(name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"a.{FORMATS[format]}")
        try:
            report = stp.export(chain, path, format=format)
        except UnsupportedError as error:
            return (
                "refused"
                if thing.subject.rpartition(" ")[2] in str(error)
                else f"refused without a name: {error}"
            )
        if str(thing.ask(stp.load(path))) == mine:
            return "yes"
    told = any(thing.subject.rpartition(" ")[2] in note.subject for note in report.notes)
    return "report" if told else "lost in silence"


@pytest.mark.parametrize("format", FORMATS)
def test_nothing_is_lost_in_silence(format: str) -> None:
    pytest.importorskip(NEEDS.get(format, "numpy"))
    answers = {name: answer(format, name) for name in THINGS}
    assert set(answers.values()) <= {"yes", "refused", "report"}, answers
    lines = README.read_text("utf-8").partition(HEAD)[2].partition("\n\n")[0].splitlines()
    for name, found in answers.items():
        (line,) = (line for line in lines if line.startswith(f"| {name} |"))
        assert line.split("|")[2 + list(FORMATS).index(format)].strip() == found, (name, found)


def test_every_format_is_asked() -> None:
    with pytest.raises(InputError, match="format must be one of") as caught:
        stp.export(four_bar(), "a.urdf", format="")
    known = str(caught.value).partition("one of ")[2].partition(", got")[0].split(", ")
    assert sorted(FORMATS) == sorted(known)
    assert [name for name in known if f'``"{name}"``' not in str(stp.export.__doc__)] == []


def table() -> str:
    """Make the table of the README."""
    lines = [HEAD, "|---" * (1 + len(FORMATS)) + "|"]
    for name in THINGS:
        lines.append(f"| {name} | " + " | ".join(answer(format, name) for format in FORMATS) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(table() + "\n")
