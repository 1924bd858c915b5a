"""Who judges the judges: a row, a sign or an axis exchanged in any shared place must be seen by law 5.

Every place is exchanged alone, in all modules that hold it, before the mechanism is built, so that everything that
shares the place is wrong together. Seen means that a formulation refuses, or differs from another one.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import StewartPinError
from stewart_pin.model.description import JointKind
from stewart_pin.model.loop_rows import AngleRow, NormalRow
from tests.closed_states import random_configuration, random_motion
from tests.mechanisms import gear_train, two_bodies

pytest.importorskip("casadi")
DIFFERS = 1e-6
"""Relative; formulations agree to 1e-12 where nothing is exchanged."""
Wrong = Callable[[Any], Any]


@dataclass(frozen=True)
class Place:
    """A shared function, what is exchanged in it, and the mechanism on which that matters."""

    module: str
    name: str
    what: str
    wrong: Wrong
    kind: str = "revolute"

    def __str__(self) -> str:
        return f"{self.module}.{self.name}: {self.what}, {self.kind}"


def after(change: Callable[[Any], Any]) -> Wrong:
    """Change what a function returns."""
    return lambda right: lambda *args, **kwargs: change(right(*args, **kwargs))


def entry(index: int, factor: float = -1.0) -> Callable[[Any], Any]:
    def change(found: Any) -> Any:
        found = np.array(found)
        found[index] *= factor
        return found

    return change


def swapped(i: int, j: int) -> Callable[[Any], Any]:
    def change(found: Any) -> Any:
        found = np.array(found)
        found[[i, j]] = found[[j, i]]
        return found

    return change


def rows_with(kind: type, change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda rows: tuple(change(row) if isinstance(row, kind) else row for row in rows)


def turned(axis: np.ndarray) -> np.ndarray:
    side = np.cross(axis, [0.3, -0.5, 0.8])
    return side / np.linalg.norm(side)


def column_sign(columns: Any) -> Any:
    transpose = columns.transpose * 1
    transpose[:, 0] = -2 * transpose[:, 0] + transpose[:, 1]
    return replace(columns, transpose=transpose)


def loop_of(change: Callable[[Any], Any]) -> Wrong:
    """Change the loop that a function is given."""
    return lambda right: lambda loop, *args: right(change(loop), *args)


def joint_of(change: Callable[[Any], Any]) -> Wrong:
    return lambda right: (
        lambda joint, *args: right(change(joint) if joint.kind is JointKind.PRISMATIC else joint, *args)
    )


def other_axis(thing: Any) -> Any:
    return replace(thing, axis=turned(np.array(thing.axis)))


def less_inertia(masses: Any) -> Any:
    return replace(masses, first=-masses.first)


PLACES = (
    # rows of the states
    Place(
        "model.loop_rows",
        "closure_rows",
        "normal",
        after(rows_with(NormalRow, lambda r: replace(r, normal=turned(r.normal)))),
        "planar",
    ),
    Place(
        "model.loop_rows", "closure_rows", "normals in another order", after(lambda r: (r[1], r[0], *r[2:]))
    ),
    Place(
        "model.loop_rows",
        "closure_rows",
        "axis in frame 1",
        after(rows_with(AngleRow, lambda r: replace(r, u1=turned(r.u1)))),
    ),
    Place(
        "model.loop_rows",
        "closure_rows",
        "axis in frame 2",
        after(rows_with(AngleRow, lambda r: replace(r, u2=turned(r.u2)))),
        "universal",
    ),
    Place(
        "model.loop_rows",
        "closure_rows",
        "sign of an axis",
        after(rows_with(AngleRow, lambda r: replace(r, u1=-r.u1))),
    ),
    Place("model.loop_rows", "closure_rows", "a row left out", after(lambda r: r[:-1])),
    Place(
        "model.loop_rows",
        "closure_rows",
        "length",
        loop_of(lambda loop: replace(loop, length=1.1 * loop.length)),
        "distance",
    ),
    Place(
        "model.loop_rows",
        "orthonormal_triad",
        "sign of the third",
        after(lambda t: (t[0], t[1], -t[2])),
        "cylindrical",
    ),
    Place(
        "model.loop_table",
        "support",
        "who moves a joint",
        after(lambda m: np.append(m[:-1], 0.0)),
        "spherical",
    ),
    Place("state.loop_rows", "gap_of", "sign of a gap", after(entry(0)), "prismatic"),
    Place("state.loop_rows", "wrenches_of", "rows in another order", after(swapped(0, 1)), "spherical"),
    Place(
        "state.loop_rows",
        "wrenches_of",
        "sign of moments",
        after(lambda w: w * [1, 1, 1, -1, -1, -1]),
        "spherical",
    ),
    Place("state.loop_rows", "wrenches_of", "sign of a row", after(entry(-1)), "fixed"),
    Place("state.loop_rows", "jacobian_of", "sign of a row", after(entry(0)), "planar"),
    Place("state.loop_rows", "jacobian_of", "rows in another order", after(swapped(0, 1)), "cylindrical"),
    Place("state.loop_rows", "jacobian_of", "slope of a coupling", after(entry(-1, 1.5)), "gear_train"),
    Place("state.loop_rows", "bias_of", "sign", after(lambda b: -b)),
    Place("state.loop_rows", "bias_of", "nothing", after(lambda b: 0 * b), "distance"),
    Place("state.loop_rows", "bias_of", "rows in another order", after(swapped(0, 1)), "point_on_line"),
    Place("state.loop_rows", "cross", "sign", after(lambda x: -x), "universal"),
    # the tree and its motions
    Place("model.tree", "_joint_model", "axis of a slide", joint_of(other_axis)),
    Place(
        "state.freedom",
        "split_motions",
        "a motion left out",
        after(lambda m: replace(m, basis=m.basis[:, 1:])),
    ),
    Place("mechanics.inverse_dynamics", "least_norm", "sign", after(lambda t: -t)),
    Place("mechanics.inverse_dynamics", "least_reactions", "rows in another order", after(swapped(0, 1))),
    Place("mechanics.inverse_dynamics", "let_idle_go", "gravity", after(lambda x: (0.9 * x[0], x[1]))),
    # kernels
    Place("kernels.graph.loop_rows", "loop_columns", "a row", after(column_sign), "planar"),
    Place("kernels.graph.loop_rows", "loop_bias", "sign", after(lambda b: -b)),
    Place("kernels.graph.loop_rows", "loop_bias", "nothing", after(lambda b: 0 * b), "distance"),
    Place(
        "kernels.graph.loop_rows", "follower", "slope of a coupling", after(lambda x: 1.5 * x), "gear_train"
    ),
    Place("kernels.graph.bodies", "joint_velocity", "axis of a slide", joint_of(other_axis)),
    Place("kernels.graph.bodies", "joint_placement", "axis of a slide", joint_of(other_axis)),
    Place("kernels.graph.bodies", "joint_effort", "axis of a slide", joint_of(other_axis)),
    Place("kernels.graph.bodies", "moments_of", "sign", after(lambda m: -m)),
    Place("kernels.planning.tree", "masses_of", "sign of the lever", after(less_inertia)),
    # maximal coordinates
    Place(
        "mechanics.constraint_matrix.columns",
        "transmitted",
        "reactions in another order",
        after(lambda t: (t[1], t[0], *t[2:])),
        "spherical",
    ),
    Place("mechanics.constraint_matrix.columns", "transmitted", "axis", loop_of(other_axis), "planar"),
    Place(
        "mechanics.constraint_matrix.columns",
        "axes_beside",
        "sign of the second",
        after(lambda b: (b[0], -b[1])),
        "prismatic",
    ),
    Place(
        "mechanics.constraint_matrix.columns",
        "_loop_row",
        "sign of the demand",
        after(lambda x: (x[0], -x[1])),
    ),
    Place(
        "mechanics.constraint_matrix.columns",
        "passive_columns",
        "a column left out",
        after(lambda c: replace(c, wrenches=c.wrenches[:, 1:], acceleration=c.acceleration[1:])),
    ),
    Place("mechanics.constraint_matrix.kinematics", "cross_force", "sign", after(lambda f: -f)),
    Place(
        "mechanics.constraint_matrix.kinematics",
        "force_at",
        "sign of the arm",
        lambda right: lambda point, *args: right(-point, *args),
    ),
    Place(
        "mechanics.constraint_matrix.system",
        "coupling_parts",
        "sign of the ratio",
        after(lambda p: [p[0], (*p[1][:2], replace(p[1][2], wrenches=-p[1][2].wrenches))]),
        "gear_train",
    ),
    # articulated bodies
    Place("mechanics.articulated_body.bodies", "motion_subspace", "axis of a slide", joint_of(other_axis)),
    Place(
        "mechanics.articulated_body.loops",
        "loop_wrenches",
        "sign on body 1",
        after(lambda x: replace(x, wrench1=-x.wrench1)),
    ),
    Place(
        "mechanics.articulated_body.loops",
        "loop_wrenches",
        "bias",
        after(lambda x: replace(x, bias=-x.bias)),
    ),
    Place("mechanics.articulated_body.bodies", "cross_motion", "sign", after(lambda x: -x)),
)


def mechanism(kind: str) -> stp.ClosedChain:
    """Build anew: nothing that was looked up before may help."""
    rng = np.random.default_rng(11)
    return gear_train(rng) if kind == "gear_train" else two_bodies(JointKind(kind), rng)


def formulations(
    chain: stp.ClosedChain, rng: np.random.Generator
) -> dict[str, Callable[[], list[np.ndarray]]]:
    """Motor efforts, reactions and accelerations of one motion, by each formulation."""
    from stewart_pin.kernels.graph.state_functions import forward_dynamics_function, inverse_dynamics_function
    from stewart_pin.kernels.graph.whole_tree import close_tree

    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    known = stp.inverse_dynamics(chain, q, v, a)

    def effort(method: str) -> list[np.ndarray]:
        found = stp.inverse_dynamics(chain, q, v, a, method=method)
        return [found.tau_motor, found.lambda_c, found.a]

    def forward(verb: Callable[..., Any]) -> list[np.ndarray]:
        found = verb(chain, q, v, known.tau_motor)
        return [known.tau_motor, found.lambda_c, found.a]

    def kernels() -> list[np.ndarray]:
        closed = close_tree(chain)
        tau, reactions = inverse_dynamics_function(closed).call([q, v, a])
        motion = forward_dynamics_function(closed).call([q, v, known.tau_motor])[0]
        return [np.array(x).ravel() for x in (tau, reactions, motion)]

    return {
        "pinocchio": lambda: effort("pinocchio"),
        "constraint_matrix": lambda: effort("constraint_matrix"),
        "forward_dynamics": lambda: forward(stp.forward_dynamics),
        "articulated bodies": lambda: forward(stp.dynamics.closed_chain_articulated_body),
        "kernels": kernels,
    }


def seen(kind: str) -> list[str]:
    """Say who sees that something is wrong: who refuses, and who differs from the first."""
    rng, witnesses = np.random.default_rng(5), []
    try:
        chain = mechanism(kind)
        ways = formulations(chain, rng)
    except (StewartPinError, AssertionError, np.linalg.LinAlgError, ValueError, IndexError) as error:
        return [f"closing or its check refuses ({type(error).__name__})"]
    first: list[np.ndarray] | None = None
    for name, way in ways.items():
        try:
            found = way()
        except (StewartPinError, np.linalg.LinAlgError, ValueError, IndexError, RuntimeError) as error:
            witnesses.append(f"{name} refuses ({type(error).__name__})")
            continue
        if first is None:
            first = found
            continue
        for what, one, two in zip(("efforts", "reactions", "motion"), first, found, strict=True):
            size = max(float(np.abs(one).max(initial=0.0)), float(np.abs(two).max(initial=0.0)), 1e-9)
            if one.shape != two.shape or not np.abs(one - two).max(initial=0.0) <= DIFFERS * size:
                witnesses.append(f"{name} differs ({what})")
                break
    return witnesses


def exchange(monkeypatch: pytest.MonkeyPatch, place: Place) -> None:
    right = getattr(importlib.import_module(f"stewart_pin.{place.module}"), place.name)
    wrong = place.wrong(right)
    for name, module in list(sys.modules.items()):
        if name.startswith("stewart_pin") and vars(module).get(place.name) is right:
            monkeypatch.setattr(module, place.name, wrong)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted({place.kind for place in PLACES}))
def test_nothing_is_seen_where_nothing_is_exchanged(kind: str) -> None:
    assert seen(kind) == []


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES, ids=str)
def test_every_exchange_is_seen(
    place: Place, monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, object], None]
) -> None:
    exchange(monkeypatch, place)
    witnesses = seen(place.kind)
    record_property("seen by", "; ".join(witnesses))
    sys.stdout.write(f"| {place} | {'; '.join(witnesses)} |\n")  # the table, with -s
    assert witnesses, f"nobody sees {place}"
