"""Law 10: the same mechanism told in another legal way gives the same answers, from every verb that takes a chain."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from tests.retelling.case import REAL, case, plain
from tests.retelling.changes import CHANGES
from tests.retelling.telling import Telling
from tests.retelling.tellings import TELLINGS, tell
from tests.retelling.verbs.everything import KINDS, QUESTIONS, Answers, Sized, Verb
from tests.zoo.table import ROBOTS

ALIKE = ("stewart_cad", "stewart_s1")
"""Robots that differ from `stewart` by their numbers only."""


TOLD_REAL = tuple(f"{name}{REAL}" for name in ("four_bar", "five_bar", "stewart", "rpr_planar"))
"""Robots with springs, damping, dry friction and rotors, told in the ways that keep them in the file."""
_CUT = frozenset({"export", "joint_physics"})
"""Asked joint by joint: one of the tree is a loop now, which MJCF has no springs for; and the other way round."""
OTHERWISE: dict[tuple[str, str], frozenset[str]] = {
    # Its ball may stand in the tree, but no balls for the hinge that is the loop now.
    (TOLD_REAL[0], "cut elsewhere"): _CUT | {"loops_by_balls"},
    (TOLD_REAL[1], "cut elsewhere"): _CUT,
}
"""Questions of a robot and a telling that are answered otherwise, all of them and no more, with the reason."""


_SPREAD = 10.0
"""Times that few digits may move an answer of what they moved it at most in three tellings with the last digit rounded
up or down. Those errors are twice the ones of the nearest digit; of normal variables one in ten thousand goes beyond.
"""


def answer(verb: Verb, telling: Telling) -> Answers | str:
    """Ask, and take a refusal for an answer."""
    try:
        return verb(telling, case(telling.plain.name))
    except stp.errors.StewartPinError as error:
        return type(error).__name__


@cache
def plainly(robot: str, question: str) -> Answers | str:
    chain = plain(robot)
    return answer(QUESTIONS[question], Telling("plain", chain, chain))


def disagreement(
    one: Answers | str, two: Answers | str, tolerance: float, printed: tuple[Answers | str, ...] = ()
) -> str:
    """Say where two answers differ by more than a part of their size; empty where they agree.

    With few digits by more than answers move that are asked of the same digits rounded up or down as it happens.
    """
    if two == {}:
        return ""  # not asked: there are no words for it in this telling
    if isinstance(one, str) or isinstance(two, str):
        return "" if one == two else f"{_said(one)} and {_said(two)}"
    for name in one.keys() & two.keys():
        error, text = _difference(one[name], two[name])
        allowed = tolerance
        if printed:
            moved = [
                _difference(one[name], other[name])[0]
                for other in printed
                if not isinstance(other, str) and name in other
            ]
            allowed = max([1e-9, *(_SPREAD * by for by in moved if np.isfinite(by))])
        if not error <= allowed:
            return f"{name}: {text or f'{error:.2g}'}" + (
                f", digits move it by {allowed:.2g}" if printed else ""
            )
    return ""


def _difference(first: object, second: object) -> tuple[float, str]:
    """Largest difference of two answers as a share of their size; infinite, with words, where they are incomparable."""
    size = 0.0
    if isinstance(first, Sized) and isinstance(second, Sized):
        first, second, size = first.value, second.value, first.size
    first, second = np.asarray(first), np.asarray(second)
    if first.shape != second.shape:
        return np.inf, f"shapes {first.shape} and {second.shape}"
    if first.dtype.kind in "biU":
        return (np.inf, f"{first} and {second}") if (first != second).any() else (0.0, "")
    size = max(size, float(np.abs(first[np.isfinite(first)]).max(initial=0.0)))
    same = (first == second) | (np.isnan(first) & np.isnan(second))  # infinite, or out of reach
    first, second = np.where(same, 0.0, first), np.where(same, 0.0, second)
    error = float(np.abs(first - second).max(initial=0.0))
    return (error / size if size else np.inf if error else 0.0), ""


def _said(answers: Answers | str) -> str:
    return answers if isinstance(answers, str) else "an answer"


def disagreements(told: Telling, questions: list[str]) -> dict[str, str]:
    """Ask everything, and list what is answered otherwise."""
    found: dict[str, str] = {}
    for question in questions:
        first, second = plainly(told.plain.name, question), answer(QUESTIONS[question], told)
        printed = tuple(answer(QUESTIONS[question], other) for other in told.printed_otherwise)
        text = disagreement(first, second, told.tolerance, printed)
        if text:
            found[question] = text
    return found


FEW_DIGITS = ("nine digits", "all at once with six digits")
"""Tellings that ask each question four times: some robots are told so, all of them with six digits, and all at once
with nine."""
TOLD_ONCE = tuple(name for name in stp.robots() if name not in ROBOTS)
"""Robots that the zoo tells of: all its ways at once."""
TOLD_FOUR_WAYS = ("four_bar", "stewart", "delta", "rpr_planar")


def told_robots() -> list[object]:
    """All robots and tellings; other hexapods of the same build as `stewart` in those that hold all the others."""
    return [
        (robot, telling)
        for robot in ROBOTS
        for telling in TELLINGS
        if (robot not in ALIKE or telling.startswith(("all at once", "base", "cut")))
        and (robot in TOLD_FOUR_WAYS or telling not in FEW_DIGITS)
    ]


def tell_or_skip(robot: str, telling: str, folder: Path) -> Telling:
    told = tell(telling, plain(robot), folder)
    if told is None:
        pytest.skip(f"this way has no words for {robot}")
    return told


@pytest.mark.parametrize(
    ("robot", "telling"),
    [("four_bar", t) for t in TELLINGS if not t.startswith("all at once with") and t != "six digits"]
    + [("five_bar", "hinges as balls"), ("stewart", "all at once"), ("stewart", "cut elsewhere")]
    + [(TOLD_REAL[0], "every second axis reversed")],
)
def test_a_few_answers(robot: str, telling: str, tmp_path: Path) -> None:
    told = tell_or_skip(robot, telling, tmp_path)
    assert disagreements(told, [name for name, kind in KINDS.items() if kind == "quick"]) == {}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "telling"),
    [
        *told_robots(),
        *((name, "all at once") for name in TOLD_ONCE),
        *((name, telling) for name in TOLD_REAL for telling in (*CHANGES, "on a pedestal")),
        *((name, "cut elsewhere") for name in TOLD_REAL[:3]),
    ],
)
def test_every_answer(robot: str, telling: str, tmp_path: Path) -> None:
    told = tell_or_skip(robot, telling, tmp_path)
    found = disagreements(told, [name for name, kind in KINDS.items() if kind != "compiled"])
    assert set(found) == OTHERWISE.get((robot, telling), frozenset()), found


@pytest.mark.slow
@pytest.mark.parametrize("robot", [*ROBOTS, *TOLD_REAL])
def test_kernels(robot: str, tmp_path: Path) -> None:
    """Programs are written anew for each telling, which takes seconds: of one that tells everything otherwise."""
    told = tell_or_skip(robot, "all at once", tmp_path)
    assert disagreements(told, [name for name, kind in KINDS.items() if kind == "compiled"]) == {}
