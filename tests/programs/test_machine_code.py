"""Machine code of every vector width computes what the interpreter computes; the same machine, the same bits."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stewart_pin.programs.array_kernel import ArrayKernel
from stewart_pin.programs.llvm.machine_code import Target, assembly, load_llvm
from stewart_pin.programs.llvm.module import module_for_ranges
from stewart_pin.programs.passes import prepare
from stewart_pin.programs.program import (
    LIBRARY,
    Kind,
    Port,
    Program,
    ProgramBuilder,
    operation_counts,
    run_program,
)
from stewart_pin.programs.symbolic import program_from_casadi
from tests.kernels.hexapod_graph import sample_inverse_dynamics, sample_states
from tests.programs.examples import (
    dense_solve,
    every_operation,
    kinds_of_every_operation,
    one_operation,
    random_program,
    reversed_row,
    round_off,
    special_values,
)
from tests.programs.targets import TARGETS

pytest.importorskip("llvmlite")

DOUBLE, SINGLE = np.dtype(np.float64), np.dtype(np.float32)
HEXAPOD = prepare(program_from_casadi(sample_inverse_dynamics()))


each_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
each_type = pytest.mark.parametrize("dtype", [DOUBLE, SINGLE], ids=str)


@each_type
@pytest.mark.parametrize("kind", kinds_of_every_operation(), ids=str)
def test_operation_as_in_numpy(kind: Kind, dtype: np.dtype, rng: np.random.Generator) -> None:
    states = special_values(dtype, rng)
    program = one_operation(kind)
    expected = run_program(program, [states], dtype=dtype)[0]
    for target in TARGETS.values():
        got = ArrayKernel(program, dtype=dtype, target=target)(states)
        assert np.array_equal(np.isnan(got), ~np.isfinite(expected))
        fine = np.isfinite(expected)
        product = np.abs(states[:, :1] * states[:, 1:2]) if kind is Kind.FMA else 0.0
        size = product + np.abs(expected)
        # Exact where the machine has the operation; the C library and NumPy differ by few units in the last place.
        exact = kind is not Kind.FMA and kind not in LIBRARY - {Kind.FMOD}
        tolerance = 0.0 if exact else 8 * np.finfo(dtype).eps
        lost = 0.0 if exact else np.finfo(dtype).smallest_subnormal  # of a product that NumPy rounds to zero
        assert np.all(np.abs(got - expected)[fine] <= tolerance * size[fine] + lost)


@each_target
@pytest.mark.parametrize("seed", range(3))
def test_random_programs(target: Target, seed: int) -> None:
    rng = np.random.default_rng(seed)
    program = random_program(rng)
    inputs = [rng.uniform(-2, 2, size=(101, 5)), rng.uniform(-2, 2, size=(101, 2, 3))]
    got = ArrayKernel(prepare(program), target=target)(*inputs)
    exact = run_program(program, [x.reshape(101, -1) for x in inputs], dtype=np.longdouble)
    bounds = zip(*(round_off(p, inputs) for p in (program, prepare(program))), strict=True)
    for value, reference, (a, b) in zip(got, exact, bounds, strict=True):
        assert np.all(np.abs(value.reshape(101, -1) - reference) <= a + b)


@each_target
@each_type
def test_dense_solve_has_a_small_residual(target: Target, dtype: np.dtype, rng: np.random.Generator) -> None:
    matrix = (rng.normal(size=(77, 6, 6)) + 6 * np.eye(6)).astype(dtype)
    right = rng.normal(size=(77, 6)).astype(dtype)
    x, pivot = ArrayKernel(prepare(dense_solve()), dtype=dtype, target=target)(matrix, right)
    residual = np.einsum("nij,nj->ni", matrix.astype(float), x.astype(float)) - right
    # Dominant diagonal: no growth of the elements, so a few units of round-off of ‖A‖ ‖x‖.
    assert np.abs(residual).max() < 50 * np.finfo(dtype).eps * np.abs(matrix).max() * np.abs(x).max()
    assert np.all(pivot > 0)


@each_type
@pytest.mark.parametrize("which", ["hexapod", "operations", "random"])
def test_scalar_and_vector_agree_bit_for_bit(which: str, dtype: np.dtype, rng: np.random.Generator) -> None:
    if which == "hexapod":
        program, states = HEXAPOD, sample_states(rng, 41)
    elif which == "operations":
        program, states = every_operation(), (rng.uniform(0.1, 0.9, size=(41, 3)),)
    else:
        program = prepare(random_program(rng))
        states = (rng.normal(size=(41, 5)), rng.normal(size=(41, 2, 3)))
    for target in TARGETS.values():
        states = tuple(x.astype(dtype) for x in states)
        kernel = ArrayKernel(program, dtype=dtype, target=target)
        single = kernel.single_state()
        rows = kernel(*states)
        for k in range(41):
            one = single(*(x[k] for x in states))
            pairs = [(one, rows)] if isinstance(rows, np.ndarray) else list(zip(one, rows, strict=True))
            assert all(a.tobytes() == b[k].tobytes() for a, b in pairs)


@each_type
def test_vector_width_changes_no_bit(dtype: np.dtype, rng: np.random.Generator) -> None:
    """Machines with fused multiply-add agree bit for bit, whatever their width."""
    program = HEXAPOD
    states = [x.astype(dtype) for x in sample_states(rng, 100)]
    results = {
        name: ArrayKernel(program, dtype=dtype, target=t)(*states).tobytes()
        for name, t in TARGETS.items()
        if t.fused
    }
    assert len(set(results.values())) <= 1


def test_without_fused_operations_the_interpreter_agrees_bit_for_bit(rng: np.random.Generator) -> None:
    if "128 bits" not in TARGETS:
        pytest.skip("no machine without fused multiply-add to compile for")
    program = HEXAPOD
    states = sample_states(rng, 100)
    assert operation_counts(program)[Kind.FMA] > 500
    expected = run_program(program, list(states))[0]
    assert np.array_equal(ArrayKernel(program, target=TARGETS["128 bits"])(*states), expected)


def test_fused_operations_change_the_last_digits_only(rng: np.random.Generator) -> None:
    """Hold what `prepare` says of round-off."""
    program = program_from_casadi(sample_inverse_dynamics())
    states = sample_states(rng, 2000)
    exact = run_program(program, list(states), dtype=np.longdouble)[0]
    plain = run_program(program, list(states))[0]
    largest = np.abs(exact).max(axis=1, keepdims=True)
    errors = {
        "plain": np.abs(plain - exact) / largest,
        "prepared": np.abs(ArrayKernel(prepare(program))(*states) - exact) / largest,
    }
    eps = np.finfo(float).eps
    assert all(np.median(e) < eps and e.max() < 20 * eps for e in errors.values())
    assert errors["prepared"].max() < 2 * errors["plain"].max() + eps


def test_infinite_and_zero_results_are_not_simplified_away() -> None:
    """No fast-math: what is nan stays nan, x · 0 is not 0."""
    source = Program("p", (Port("x", (1,)),), (Port("y", (1,)),), (), ())
    builder = ProgramBuilder(source)
    x = builder.append(every_operation().instructions[0])
    zero = builder.constant(0.0)
    root = builder.operation(Kind.SQRT, builder.operation(Kind.NEG, x))
    program = builder.finish(iter([(builder.operation(Kind.MUL, root, zero),)]))
    got = ArrayKernel(prepare(program))(np.array([[1.0], [-4.0], [0.0]]))
    assert np.isnan(got[0, 0])
    assert np.array_equal(np.abs(got[1:, 0]), [0.0, 0.0])


@each_type
def test_code_for_arm_uses_its_vectors(dtype: np.dtype) -> None:
    program = HEXAPOD
    target = Target("aarch64-unknown-linux-gnu", "generic", "+neon", 16, fused=True)
    try:
        load_llvm().initialize_all_targets()
        load_llvm().Target.from_triple(target.triple)
    except RuntimeError:
        pytest.skip("this llvmlite cannot generate code for Arm")
    text = assembly(module_for_ranges(program, (), dtype, target), target)
    lanes = "2d" if dtype == DOUBLE else "4s"
    assert len(re.findall(rf"fml[as]\s+v\d+\.{lanes}", text)) > 500
    assert not re.search(r"bl\s+fma", text)


@each_target
def test_hot_loop_is_made_of_full_vectors(target: Target) -> None:
    if not target.triple.startswith("x86_64"):
        pytest.skip("reads x86 assembly")
    program = HEXAPOD
    text = assembly(module_for_ranges(program, (), DOUBLE, target), target)
    register = {16: "xmm", 32: "ymm", 64: "zmm"}[target.vector_bytes]
    counts = operation_counts(program)
    assert len(re.findall(rf"\tv?divpd\t.*%{register}", text)) == counts[Kind.DIV]
    assert len(re.findall(rf"\tv?sqrtpd\t.*%{register}", text)) == counts[Kind.SQRT]
    if target.fused:  # one more for each entry that is checked to be finite
        fused = len(re.findall(rf"\tvfn?m(?:add|sub)\d+pd\t.*%{register}", text))
        assert fused == counts[Kind.FMA] + 19 + 6
    assert "call" not in text


@each_target
@each_type
def test_rows_of_any_length_are_turned_to_vectors_and_back(
    target: Target, dtype: np.dtype, rng: np.random.Generator
) -> None:
    for size in (*range(1, 20), 33):
        kernel = ArrayKernel(reversed_row(size), dtype=dtype, target=target)
        states = rng.normal(size=(21, size)).astype(dtype)
        assert np.array_equal(kernel(states), states[:, ::-1])
