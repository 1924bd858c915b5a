"""Sweeps that are stopped and go on: by a kill, an interrupt, an error; and journals that do not fit."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import signal
import subprocess
import sys
import time
import zlib
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, InputError
from tests.studies import functions
from tests.studies.test_sweep import same

A, B = np.linspace(0.1, 2.3, 6), np.geomspace(0.3, 4.0, 5)
AXES = {"a": A, "b": B}
ROOT = Path(__file__).parents[2]


@pytest.fixture
def whole() -> stp.sweeps.Sweep:
    return stp.sweep(functions.wave, AXES)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "new folder" / "study.journal"


def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """Note at which points the function is still asked, its name being the same."""
    points: list[tuple[float, float]] = []
    plain = functions.wave

    def wave(a: float, b: float) -> dict[str, object]:
        points.append((a, b))
        return plain(a, b)

    wave.__module__, wave.__qualname__ = plain.__module__, plain.__qualname__
    monkeypatch.setattr(functions, "wave", wave)
    return points


def test_what_is_done_is_not_done_again(
    path: Path, whole: stp.sweeps.Sweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    same(stp.sweep(functions.wave, AXES, journal=path), whole)
    written = path.read_bytes()
    points = asked(monkeypatch)
    told: list[tuple[str, int, int]] = []
    again = stp.sweep(functions.wave, AXES, journal=path, progress=lambda *report: told.append(report))
    same(again, whole)
    assert points == [] and told == [("points", 30, 30)] and path.read_bytes() == written


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT], ids=["killed", "interrupted"])
@pytest.mark.parametrize("workers", [0, 2])
def test_a_sweep_that_was_ended_goes_on_as_if_nothing_had_been(
    path: Path, workers: int, how: signal.Signals
) -> None:
    script = (
        "from concurrent.futures import ProcessPoolExecutor\n"
        "import stewart_pin as stp, numpy as np\n"
        "from tests.studies import functions\n"
        f"pool = ProcessPoolExecutor({workers}) if {workers} else None\n"
        "axes = {'a': np.linspace(0.1, 2.3, 30), 'b': np.geomspace(0.3, 4.0, 20)}\n"
        f"stp.sweep(functions.slow_wave, axes, journal={str(path)!r}, executor=pool)\n"
    )
    # A group of its own, so that workers whose parent is gone can be ended as well.
    child = subprocess.Popen(
        [sys.executable, "-c", script], cwd=ROOT, start_new_session=True, stderr=subprocess.DEVNULL
    )
    try:
        begin = time.monotonic()
        while not path.exists() or path.read_bytes().count(b"\n") < 25:
            assert child.poll() is None and time.monotonic() - begin < 60
            time.sleep(0.005)
        child.send_signal(how)
        assert child.wait(timeout=30) == -how
        lines = path.read_bytes().count(b"\n")
        assert 25 <= lines < 500
        axes = {"a": np.linspace(0.1, 2.3, 30), "b": np.geomspace(0.3, 4.0, 20)}
        told: list[int] = []
        with ThreadPoolExecutor(8) as pool:
            found = stp.sweep(
                functions.slow_wave,
                axes,
                journal=path,
                executor=pool,
                progress=lambda stage, done, total: told.append(done),
            )
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    assert told[0] == lines - 1 and told[-1] == 600  # every line but the first is a point kept
    same(found, stp.sweep(functions.wave, axes))


@pytest.mark.parametrize("cut", [1, 7, 60])
def test_a_line_that_was_cut_off_is_done_again(
    path: Path, whole: stp.sweeps.Sweep, monkeypatch: pytest.MonkeyPatch, cut: int
) -> None:
    stp.sweep(functions.wave, AXES, journal=path)
    text = path.read_bytes()
    path.write_bytes(text[:-cut])
    points = asked(monkeypatch)
    same(stp.sweep(functions.wave, AXES, journal=path), whole)
    assert points == [(A[-1], B[-1])]
    assert path.read_bytes() == text


@pytest.mark.parametrize("kept", [0, 1, 100])
def test_a_first_line_that_was_cut_off_is_written_again(
    path: Path, whole: stp.sweeps.Sweep, kept: int
) -> None:
    stp.sweep(functions.wave, AXES, journal=path)
    text = path.read_bytes()
    path.write_bytes(text[:kept])
    same(stp.sweep(functions.wave, AXES, journal=path), whole)
    assert path.read_bytes() == text


def test_an_interrupt_keeps_what_was_done(
    path: Path, whole: stp.sweeps.Sweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(stage: str, done: int, total: int) -> None:
        if done == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stp.sweep(functions.wave, AXES, journal=path, progress=interrupt)
    points = asked(monkeypatch)
    same(stp.sweep(functions.wave, AXES, journal=path), whole)
    assert len(points) == 18


def test_an_interrupt_keeps_what_workers_had_done(path: Path) -> None:
    def interrupt(stage: str, done: int, total: int) -> None:
        if done == 1:
            time.sleep(0.2)  # the others in flight get done meanwhile
            raise KeyboardInterrupt

    with functions.processes(2) as pool, pytest.raises(KeyboardInterrupt):
        stp.sweep(functions.wave, AXES, journal=path, executor=pool, progress=interrupt)
    lines = [json.loads(line) for line in path.read_text().splitlines()[1:]]
    assert 4 <= len(lines) <= 8  # all in flight but the few that a worker had not begun
    assert len({line["task"]["points"][0] for line in lines}) == len(lines)


def test_an_error_keeps_what_was_done(path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        stp.sweep(functions.broken_at_two, {"a": [5, 4, 3, 2]}, journal=path)
    assert len(path.read_text().splitlines()) == 1 + 3


def test_a_dead_worker_is_told_with_the_points_in_hand(path: Path) -> None:
    with functions.processes(1) as pool, pytest.raises(BrokenExecutor) as stopped:
        stp.sweep(functions.deadly_at_two, {"a": [0, 1, 2, 3]}, journal=path, executor=pool, in_flight=1)
    assert stopped.value.__notes__[-1].endswith("points of the sweep in hand were a=2")
    assert len(path.read_text().splitlines()) == 1 + 2
    with pytest.raises(BrokenExecutor) as again:  # the pool stays broken, and is so before anything is begun
        stp.sweep(functions.deadly_at_two, {"a": [0, 1, 2, 3]}, journal=path, executor=pool)
    assert "a=2" in again.value.__notes__[-1]


def test_failures_are_kept_with_their_reason(path: Path) -> None:
    axes = {"a": [1.0, 3.0, 2.0, 4.0]}
    first = stp.sweep(functions.unreachable_above_two, axes, journal=path, chunk=3)
    again = stp.sweep(functions.unreachable_above_two, axes, journal=path)
    same(again, first)
    assert again.failures == first.failures and again.failures[0].message == "3 is too far"


def test_special_numbers_are_kept(path: Path) -> None:
    values = [np.nan, np.inf, -np.inf, -0.0, 5e-324]
    for _ in range(2):
        found = stp.sweep(lambda k: values[k], {"k": range(5)}, journal=path)
        assert found["value"].tobytes() == np.array(values).tobytes() and found.success


@pytest.mark.parametrize(
    ("function", "axes", "options", "words"),
    [
        (functions.slow_wave, AXES, {}, r"its study is 'tests.*\.wave', this one 'tests.*\.slow_wave'"),
        (
            functools.partial(functions.wave, b=2.0),
            {"a": A},
            {},
            r"this one 'tests.*\.wave\(b=2\.0\)'; its axes are",
        ),
        (functions.wave, AXES, {"name": "20 kg"}, "this one '20 kg'"),
        (functions.wave, {"b": B, "a": A}, {}, "its axes are a, b, here b, a"),
        (
            functions.wave,
            {"a": A[:5], "b": B},
            {},
            "its axis 'a' has 6 values from 0.1 to 2.3 .* here 5 values",
        ),
        (functions.wave, {"a": np.r_[A[:2], A[2] + 1e-9, A[3:]], "b": B}, {}, "its axis 'a'"),
        (functions.wave, {"a": A[:5], "b": B}, {"paired": True}, "it holds a grid, this is a list of points"),
    ],
)
def test_the_journal_of_another_study_is_refused(path: Path, function, axes, options, words: str) -> None:
    stp.sweep(functions.wave, AXES, journal=path)
    text = path.read_bytes()
    with pytest.raises(
        InputError, match=f"belongs to another study: .*{words}.*choose another file, or delete"
    ):
        stp.sweep(function, axes, journal=path, **options)
    assert path.read_bytes() == text


@pytest.mark.parametrize(
    "text", [b"my thesis", b"a,b\n1,2\n", b'{"format": "other"}\n', b"[1]\n", b"\x00\xff\n"]
)
def test_another_file_is_left_alone(path: Path, text: bytes) -> None:
    path.parent.mkdir()
    path.write_bytes(text)
    with pytest.raises(FileFormatError, match="is no journal of a sweep"):
        stp.sweep(functions.wave, AXES, journal=path)
    assert path.read_bytes() == text


@pytest.mark.parametrize(
    "line",
    [
        b"{",
        b"[1, 2]",
        b'{"points": [30], "failed": [], "results": {}}',
        b'{"points": [1], "failed": [], "results": {"sum": [[2], "AAAAAAAAAAA="]}}',
        b'{"points": [1], "failed": [[5, "E", "m"]], "results": {}}',
        b'{"points": [1], "failed": [], "results": {"sum": [[1], "AAAA"]}}',
    ],
)
def test_a_damaged_line_is_named(path: Path, line: bytes) -> None:
    stp.sweep(functions.wave, AXES, journal=path)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[4] = b'{"crc32": %d, "task": %s}\n' % (zlib.crc32(line), line)
    path.write_bytes(b"".join(lines))
    with pytest.raises(FileFormatError, match="line 5 of the journal is damaged"):
        stp.sweep(functions.wave, AXES, journal=path)


def test_a_changed_digit_is_named(path: Path) -> None:
    """Every byte of a line counts, also where what is left of it can be read."""
    stp.sweep(functions.wave, AXES, journal=path)
    written, rng = path.read_bytes(), np.random.default_rng(5)
    begin = written.index(b"\n") + 1
    for at in rng.integers(begin, len(written) - 1, 60):
        other = b"A" if written[at : at + 1] != b"A" else b"B"
        path.write_bytes(written[:at] + other + written[at + 1 :])
        with pytest.raises(FileFormatError, match="of the journal is damaged"):
            stp.sweep(functions.wave, AXES, journal=path)


def test_a_journal_in_use_is_refused(path: Path) -> None:
    script = (
        "import time, stewart_pin as stp\n"
        f"stp.sweep(lambda a: time.sleep(60), {{'a': [1.0]}}, journal={str(path)!r}, name='x')\n"
    )
    child = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT)
    try:
        begin = time.monotonic()
        while not path.exists() or not path.read_bytes().endswith(b"\n"):
            assert child.poll() is None and time.monotonic() - begin < 60
            time.sleep(0.005)
        with pytest.raises(InputError, match="in use by another sweep"):
            stp.sweep(lambda a: a, {"a": [1.0]}, journal=path, name="x")
    finally:
        child.kill()
        child.wait()


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        stp.sweep(functions.wave, AXES, journal=tmp_path)


def test_a_full_disk_leaves_whole_lines(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # the limit then is an error, as a full disk is
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
        with pytest.raises(InputError, match=r"cannot be written .*the lines in it are kept"):
            stp.sweep(functions.wave, AXES, journal=path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    kept = path.read_bytes()
    assert 1000 < len(kept) <= 2000 and kept.endswith(b"\n")
    same(stp.sweep(functions.wave, AXES, journal=path), stp.sweep(functions.wave, AXES))
