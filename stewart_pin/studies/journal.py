"""Answers of a sweep in a file, so that a sweep that was stopped goes on where it was.

A first line says which study it is; then comes one line per task. Lines are only ever added, each in one piece; one
that was cut off by a kill or a full disk is taken away when the file is opened again. A ledger gathers the results as
they come in.
"""

from __future__ import annotations

import base64
import fcntl
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import FileFormatError, InputError
from stewart_pin.studies.answers import Answer, FailedPoint, NoAnswer, Results, Sweep
from stewart_pin.studies.points import Point, Points, words
from stewart_pin.typing import BoolArray, FloatArray

_FORMAT = "stewart_pin sweep, version 2"
_NUMBERS = "<f8"
"""Little-endian doubles on every machine."""
_HEADER = 1 << 24
"""Bytes that a first line has at most."""


@dataclass(frozen=True, eq=False)
class Journal:
    """An open journal.

    Attributes
    ----------
    path
        Where it is.
    file
        What is written to, without a buffer.
    begin
        Where its first task stands [byte].
    """

    path: Path
    file: FileIO
    begin: int

    def entries(self, size: int) -> Iterator[tuple[list[int], list[Answer]]]:
        """Read what was answered.

        Parameters
        ----------
        size
            Number of points of the study.

        Yields
        ------
        numbers : list of int
            Numbers of the points of a task.
        answers : list
            Answer of each.

        Raises
        ------
        FileFormatError
            If a line is damaged.
        """
        with _reading(self.file, self.begin) as lines:
            for k, line in enumerate(lines, start=2):
                try:
                    yield _decoded(_checked(line), size)
                except (ValueError, KeyError, TypeError, AttributeError) as error:
                    raise FileFormatError(
                        f"line {k} of the journal is damaged ({error}); remove that line, and its points are "
                        "evaluated again",
                        path=str(self.path),
                    ) from None

    def append(self, numbers: Sequence[int], answers: Sequence[Answer]) -> None:
        """Write down a task.

        Parameters
        ----------
        numbers
            Numbers of its points.
        answers
            Answer of each.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        _write_line(self.path, self.file, _encoded(numbers, answers))


@contextmanager
def open_journal(path: str | Path, study: Mapping[str, Any]) -> Iterator[Journal]:
    """Open the journal of a study, or begin one.

    Parameters
    ----------
    path
        File; created, with its folders, where there is none.
    study
        What tells the study from others, JSON-ready.

    Yields
    ------
    Journal
        For this process alone.

    Raises
    ------
    InputError
        If the file cannot be opened, is in use, or belongs to another study.
    FileFormatError
        If it is no journal.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("ab+", buffering=0)
    except OSError as error:
        raise InputError(f"journal {path} cannot be opened ({error.strerror}); choose another file") from None
    with file:
        _lock(path, file)
        header = _encode({"format": _FORMAT, **study})
        found = _repaired(path, file, header)
        if found is None:
            _write_line(path, file, header)
            found = header
        _require_same(path, study, json.loads(found))
        yield Journal(path, file, len(found))


def _encode(line: Mapping[str, Any]) -> bytes:
    return json.dumps(line).encode() + b"\n"


def _encoded(numbers: Sequence[int], answers: Sequence[Answer]) -> bytes:
    failed = {k: answer for k, answer in enumerate(answers) if isinstance(answer, NoAnswer)}
    given = [answer for answer in answers if not isinstance(answer, NoAnswer)]
    stacked = {name: np.stack([answer[name] for answer in given]) for name in (given[0] if given else ())}
    content = json.dumps(
        {
            "points": [int(number) for number in numbers],
            "failed": [[k, answer.error, answer.message] for k, answer in failed.items()],
            "results": {
                name: [values.shape, base64.b64encode(values.astype(_NUMBERS).tobytes()).decode()]
                for name, values in stacked.items()
            },
        }
    ).encode()
    return b'{"crc32": %d, "task": %s}\n' % (zlib.crc32(content), content)


def _checked(line: bytes) -> Mapping[str, Any]:
    """Read a line, if it is what was written."""
    head, _, rest = line.partition(b', "task": ')
    content = rest.removesuffix(b"}\n")
    if head != b'{"crc32": %d' % zlib.crc32(content):
        raise ValueError("its digits are not those that were written")
    return json.loads(content)


def _decoded(line: Mapping[str, Any], size: int) -> tuple[list[int], list[Answer]]:
    numbers = [int(number) for number in line["points"]]
    if not all(0 <= number < size for number in numbers):
        raise ValueError(f"the study has {size} points, the line is of {max(numbers)}")
    failed = {k: NoAnswer(error, message) for k, error, message in line["failed"]}
    stacked = {
        name: np.frombuffer(base64.b64decode(data, validate=True), _NUMBERS).astype(np.float64).reshape(shape)
        for name, (shape, data) in line["results"].items()
    }
    rows = [k for k in range(len(numbers)) if k not in failed]
    if any(len(values) != len(rows) for values in stacked.values()) or not set(failed) <= set(
        range(len(numbers))
    ):
        raise ValueError("points and results are not of the same number")
    at = {k: row for row, k in enumerate(rows)}
    return numbers, [
        failed[k] if k in failed else {name: values[at[k]] for name, values in stacked.items()}
        for k in range(len(numbers))
    ]


@contextmanager
def _reading(file: FileIO, begin: int) -> Iterator[BufferedReader[FileIO]]:
    """Read by the descriptor that holds the lock: closing any other one of the same file would give it up."""
    file.seek(begin)
    reader = BufferedReader(file)
    try:
        yield reader
    finally:
        reader.detach()


def _lock(path: Path, file: FileIO) -> None:
    # This kind of lock stays with the process: forked workers, which may outlive a killed one, do not keep it.
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        raise InputError(
            f"journal {path} is in use by another sweep; wait for it, or choose another file"
        ) from None
    except OSError:  # a file system without locks
        return


def _repaired(path: Path, file: FileIO, header: bytes) -> bytes | None:
    """Return the first line, with a cut-off last line taken away; None where nothing was written yet."""
    with _reading(file, 0) as lines:
        first = lines.readline(_HEADER)
        if not first.endswith(b"\n"):
            if not header.startswith(first):
                raise FileFormatError("is no journal of a sweep; choose another file", path=str(path))
            file.truncate(0)
            return None
        end = len(first)
        for line in lines:
            end += len(line) if line.endswith(b"\n") else 0
    try:
        head = json.loads(first)
        known = head["format"] == _FORMAT and all(
            {"values", "ends", "sha256"} <= set(x) for x in head["axes"].values()
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        known = False
    if not known:
        raise FileFormatError("is no journal of a sweep; choose another file", path=str(path))
    file.truncate(end)
    return first


def _require_same(path: Path, here: Mapping[str, Any], there: Mapping[str, Any]) -> None:
    here = json.loads(json.dumps(here))  # tuples become lists, as in the file
    differences: list[str] = []
    if there.get("study") != here["study"]:
        differences.append(f"its study is {there.get('study')!r}, this one {here['study']!r}")
    if there.get("paired") != here["paired"]:
        before, now = ("a list of points" if of.get("paired") else "a grid" for of in (there, here))
        differences.append(f"it holds {before}, this is {now}")
    before, now = there.get("axes", {}), here["axes"]
    if list(before) != list(now):
        differences.append(f"its axes are {', '.join(before)}, here {', '.join(now)}")
    else:
        differences += [
            f"its axis {name!r} has {_words(before[name])}, here {_words(now[name])}"
            for name in now
            if before[name] != now[name]
        ]
    if differences:
        raise InputError(
            f"journal {path} belongs to another study: {'; '.join(differences)}; choose another file, or delete it "
            "to begin anew"
        )


def _words(axis: Mapping[str, Any]) -> str:
    ends = " to ".join(map(str, axis["ends"]))
    return f"{axis['values']} values{f' from {ends}' if ends else ''} (digest {axis['sha256'][:8]})"


def _write_line(path: Path, file: FileIO, line: bytes) -> None:
    end = file.seek(0, 2)
    try:
        left = memoryview(line)
        while left:
            left = left[file.write(left) or 0 :]
    except BaseException as error:  # an interrupt, a full disk: whole lines only
        file.truncate(end)
        if isinstance(error, OSError):
            raise InputError(
                f"journal {path} cannot be written ({error.strerror}); the lines in it are kept"
            ) from None
        raise


# ----------------------------------------------------------------------------------------------------
# Results of a sweep as they come in, in any order
# ----------------------------------------------------------------------------------------------------


class Ledger:
    """Arrays that fill up while a sweep goes on.

    Parameters
    ----------
    points
        Points of the sweep.
    """

    def __init__(self, points: Points) -> None:
        self.points = points
        self.done: BoolArray = np.zeros(points.size, dtype=bool)
        self.begun: BoolArray = np.zeros(points.size, dtype=bool)
        self.count = 0
        self._results: dict[str, FloatArray] = {}
        self._failed: dict[int, NoAnswer] = {}
        self._model = -1

    def tasks(self, groups: np.ndarray | None, chunk: int) -> Iterator[tuple[list[int], list[Point]]]:
        """Cut what is left to do into tasks.

        Parameters
        ----------
        groups
            (N,) index of the group of each point; a task holds points of one group. None: all are of one.
        chunk
            Most points in a task.

        Yields
        ------
        numbers : list of int
            Numbers of the points.
        points : list of dict
            Their parameters.
        """
        left = np.flatnonzero(~self.done)
        ends = [left.size]
        if groups is not None:
            left = left[np.argsort(groups[left], kind="stable")]
            ends = [*(np.flatnonzero(np.diff(groups[left])) + 1), left.size]
        begin = 0
        for end in ends:
            for start in range(begin, end, chunk):
                numbers = left[start : min(start + chunk, end)].tolist()
                self.begun[numbers] = True
                yield numbers, [self.points.at(number) for number in numbers]
            begin = end

    def in_hand(self, most: int) -> list[Point]:
        """List points that were begun and are not done.

        Parameters
        ----------
        most
            How many to list.

        Returns
        -------
        list of dict
            The first of them.
        """
        return [self.points.at(int(number)) for number in np.flatnonzero(self.begun & ~self.done)[:most]]

    def require_alike(self, numbers: Sequence[int], answers: Sequence[Answer]) -> None:
        """Check that answers have the names and shapes of those before.

        Parameters
        ----------
        numbers
            Numbers of the points.
        answers
            Answer of each.

        Raises
        ------
        InputError
            If one has not; names both points.
        """
        for number, answer in zip(numbers, answers, strict=True):
            if isinstance(answer, NoAnswer):
                continue
            if self._model < 0:
                self._begin(number, answer)
            known = {name: values.shape[1:] for name, values in self._results.items()}
            given = {name: values.shape for name, values in answer.items()}
            if given != known:
                raise InputError(
                    f"every point needs results of the same names and shapes: at {self._words(self._model)} they are "
                    f"{known}, at {self._words(number)} {given}"
                )

    def enter(self, numbers: Sequence[int], answers: Sequence[Answer]) -> None:
        """Enter answers.

        Parameters
        ----------
        numbers
            Numbers of the points.
        answers
            Answer of each.

        Raises
        ------
        InputError
            If one has other names or shapes than those before.
        """
        self.require_alike(numbers, answers)
        for number, answer in zip(numbers, answers, strict=True):
            if isinstance(answer, NoAnswer):
                self._failed[number] = answer
            else:
                for name, values in answer.items():
                    self._results[name][number] = values
            self.count += not self.done[number]
            self.done[number] = True

    def closed(self, name: str) -> Sweep:
        """Give the record.

        Parameters
        ----------
        name
            What was evaluated.

        Returns
        -------
        Sweep
            Results in the shape of the grid.
        """
        points = self.points
        failures = tuple(
            FailedPoint(points.index(number), points.at(number), answer.error, answer.message)
            for number, answer in sorted(self._failed.items())
        )
        results = {
            key: values.reshape(*points.shape, *values.shape[1:]) for key, values in self._results.items()
        }
        return Sweep(name, points.axes, points.paired, results, failures)

    def _begin(self, number: int, answer: Results) -> None:
        self._model = number
        self._results = {
            name: np.full((self.points.size, *values.shape), np.nan) for name, values in answer.items()
        }

    def _words(self, number: int) -> str:
        return words(self.points.at(number))
