"""Law 10: the same mechanism told in another legal way gives the same answers, from every public verb that takes a chain."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from tests.retelling.case import case, plain
from tests.retelling.tellings import TELLINGS, Telling, tell
from tests.retelling.verbs import SLOW, VERBS, Answers, Sized, Verb

QUESTIONS: dict[str, Verb] = {name: verb for table in VERBS.values() for name, verb in table.items()}


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


def disagreement(one: Answers | str, two: Answers | str, tolerance: float) -> str:
    """Say where two answers differ by more than a part of their size; empty where they agree."""
    if isinstance(one, str) or isinstance(two, str):
        return "" if one == two else f"{_said(one)} and {_said(two)}"
    for name in one.keys() & two.keys():
        first, second = one[name], two[name]
        size = 0.0
        if isinstance(first, Sized):
            first, second, size = first.value, second.value, first.size
        first, second = np.asarray(first), np.asarray(second)
        if first.shape != second.shape:
            return f"{name}: shapes {first.shape} and {second.shape}"
        if first.dtype.kind in "biU":
            if (first != second).any():
                return f"{name}: {first} and {second}"
            continue
        size = max(size, float(np.abs(first[np.isfinite(first)]).max(initial=0.0)))
        same = (first == second) | (np.isnan(first) & np.isnan(second))  # infinite, or out of reach
        first, second = np.where(same, 0.0, first), np.where(same, 0.0, second)
        error = float(np.abs(first - second).max(initial=0.0))
        if not error <= tolerance * size:
            return f"{name}: {error / (size or 1):.2g}"
    return ""


def _said(answers: Answers | str) -> str:
    return answers if isinstance(answers, str) else "an answer"


@pytest.mark.parametrize("telling", TELLINGS)
@pytest.mark.parametrize("robot", stp.robots())
def test_told_otherwise(robot: str, telling: str, tmp_path: Path) -> None:
    told = tell(telling, plain(robot), tmp_path)
    if told is None:
        pytest.skip(f"no words for {robot}")
    found = {
        question: disagreement(plainly(robot, question), answer(verb, told), told.tolerance)
        for question, verb in QUESTIONS.items()
    }
    assert {question: text for question, text in found.items() if text} == {}
