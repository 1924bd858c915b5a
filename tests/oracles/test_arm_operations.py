"""Operations as an emulated Arm processor computes them: the bits of this machine, where it fuses as Arm does."""

from __future__ import annotations

import numpy as np
import pytest

from stewart_pin.programs.array_kernel import ArrayKernel
from stewart_pin.programs.llvm.machine_code import Target, object_file
from stewart_pin.programs.llvm.operations import WRITTEN
from stewart_pin.programs.passes import prepare
from stewart_pin.programs.program import LIBRARY, Kind, run_program
from tests.programs.examples import (
    kinds_of_every_operation,
    one_operation,
    random_program,
    reversed_row,
    round_off,
    special_values,
)

pytest.importorskip("lief", reason="needs LIEF: pip install 'stewart_pin[oracles]'")
pytest.importorskip("unicorn", reason="needs Unicorn: pip install 'stewart_pin[oracles]'")

from tests.oracles.arm_kernels import SYSTEMS, UNTOUCHED, ArmKernel, same
from tests.oracles.arm_machine import ArmMachine, unicorn

each_system = pytest.mark.parametrize("target", SYSTEMS.values(), ids=SYSTEMS)
each_type = pytest.mark.parametrize("dtype", [np.dtype(np.float64), np.dtype(np.float32)], ids=str)


@each_system
@each_type
def test_every_operation(target: Target, dtype: np.dtype, rng: np.random.Generator) -> None:
    for kind in kinds_of_every_operation():
        kernel = ArrayKernel(one_operation(kind), dtype=dtype)
        by_library = kind in LIBRARY - set(WRITTEN)
        states = special_values(dtype, rng)[:: 25 if by_library else 3]  # its calls are slow to emulate
        answer = ArmKernel(kernel, target)(states)
        codes = np.empty(len(states), dtype=np.int8)
        assert same(answer.outputs[0], kernel(states, status=codes)), kind
        assert same(answer.codes, codes)
        if by_library:
            assert len(answer.library_calls) >= len(states)


@each_system
@each_type
@pytest.mark.parametrize("kind", [Kind.SIN, Kind.COS, Kind.ATAN2], ids=str)
def test_seldom_needed_library(kind: Kind, target: Target, dtype: np.dtype, rng: np.random.Generator) -> None:
    """Values too large for the formula go to the C library, by a call in the middle of the loop."""
    kernel = ArrayKernel(one_operation(kind), dtype=dtype)
    states = rng.uniform(-4, 4, size=(300, 3)).astype(dtype)
    far = rng.choice(300, 20, replace=False)
    states[far, 0] = (1e307 if dtype == np.float64 else 1e37) * rng.uniform(2, 9, 20)
    answer = ArmKernel(kernel, target)(states)
    assert same(answer.outputs[0], kernel(states))
    name = kind.value if dtype == np.float64 else f"{kind.value}f"
    assert set(answer.library_calls) == {name}
    lanes = target.vector_bytes // dtype.itemsize
    assert len(answer.library_calls) == lanes * len({k // lanes for k in far})


@each_system
@pytest.mark.parametrize("seed", range(3))
def test_random_programs(target: Target, seed: int) -> None:
    rng = np.random.default_rng(seed)
    program = prepare(random_program(rng))
    inputs = [rng.uniform(-2, 2, size=(51, 5)), rng.uniform(-2, 2, size=(51, 2, 3))]
    got = ArmKernel(ArrayKernel(program), target)(*inputs).outputs
    exact = run_program(program, [x.reshape(51, -1) for x in inputs], dtype=np.longdouble)
    for value, reference, bound in zip(got, exact, round_off(program, inputs), strict=True):
        assert np.all(np.abs(value.reshape(51, -1) - reference) <= bound)


@each_system
@each_type
def test_rows_of_any_length(target: Target, dtype: np.dtype, rng: np.random.Generator) -> None:
    """Entries are given back in reverse order; what lies beside an array may not even be read."""
    for size in (*range(1, 20), 33):
        arm = ArmKernel(ArrayKernel(reversed_row(size), dtype=dtype, engine="numpy"), target)
        for n in (1, 4, 7):
            states = rng.normal(size=(n, size)).astype(dtype)
            for at_end in (True, False):
                assert np.array_equal(arm(states, at_end=at_end).outputs[0], states[:, ::-1])


@each_system
def test_spans_and_codes_are_written_alone(target: Target, rng: np.random.Generator) -> None:
    """Threads share an array by spans."""
    arm = ArmKernel(ArrayKernel(reversed_row(3)), target)
    states = rng.normal(size=(11, 3))
    for begin, end in ((0, 0), (5, 5), (0, 1), (3, 8), (10, 11)):
        answer = arm(states, span=(begin, end))
        inside = (np.arange(11) >= begin) & (np.arange(11) < end)
        assert np.array_equal(answer.outputs[0][inside], states[inside, ::-1])
        assert np.all(answer.outputs[0][~inside] == UNTOUCHED)
        assert np.array_equal(answer.codes, np.where(inside, 0, UNTOUCHED))
    unjudged = arm(states, judged=False)
    assert np.array_equal(unjudged.outputs[0], states[:, ::-1])
    assert np.all(unjudged.codes == UNTOUCHED)


@pytest.mark.parametrize("entry", [-1, 3])
def test_a_read_beside_an_array_would_be_noticed(entry: int) -> None:
    """Judge the judge: the entries of a row of three."""
    text = f"""
define void @run(i64 %begin, i64 %end, ptr %table) nounwind {{
  %x = load ptr, ptr %table
  %at = getelementptr double, ptr %x, i64 {entry}
  %y = load volatile double, ptr %at
  ret void
}}"""
    machine = ArmMachine(linux=True)
    machine.load(object_file(text, SYSTEMS["Linux"]))
    x = machine.place(np.ones(3).tobytes(), writable=False, at_end=entry > 0)
    with pytest.raises(unicorn.UcError, match="READ_UNMAPPED"):
        machine.run(0, 1, machine.place(x.to_bytes(8, "little"), writable=False))
