"""Each pass keeps the values, judged in long double, and does what it is for."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from stewart_pin.programs.passes import drop_dead, fuse, prepare, share_reciprocals, simplify
from stewart_pin.programs.program import Kind, Program, n_operations, operation_counts, run_program
from stewart_pin.programs.symbolic import program_from_casadi
from tests.kernels.hexapod_graph import sample_inverse_dynamics, sample_states
from tests.programs.examples import random_program, round_off, unpolished_program

PASSES = [drop_dead, simplify, share_reciprocals, fuse, prepare]
LONG = np.longdouble


def counts(program: Program) -> dict[Kind, int]:
    found = operation_counts(program)
    return {kind: found.get(kind, 0) for kind in Kind}


def read(*outputs: ca.SX, inputs: ca.SX) -> Program:
    return program_from_casadi(ca.Function("f", [inputs], [ca.vertcat(*outputs)]))


@pytest.mark.parametrize("change", PASSES, ids=lambda f: f.__name__)
@pytest.mark.parametrize("make", [random_program, unpolished_program], ids=lambda f: f.__name__)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 5))])
def test_pass_keeps_the_values(
    change: Callable[[Program], Program], make: Callable[[np.random.Generator], Program], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    program = make(rng)
    inputs = [rng.uniform(-2, 2, size=(200, 5)), rng.uniform(-2, 2, size=(200, 6))]
    changed = change(program)
    exact = run_program(program, inputs, dtype=LONG)
    # Both sides are rounded, each within its own bound; long double sees what doubles would hide, 2000 times finer.
    for dtype in (LONG, np.float64):
        unit = float(np.finfo(dtype).eps)
        bounds = [
            a + b for a, b in zip(*(round_off(p, inputs, unit) for p in (program, changed)), strict=True)
        ]
        for got, value, bound in zip(run_program(changed, inputs, dtype=dtype), exact, bounds, strict=True):
            assert np.all(np.abs(got - value) <= bound)


@pytest.mark.parametrize("change", PASSES, ids=lambda f: f.__name__)
def test_pass_keeps_a_hexapod(change: Callable[[Program], Program], rng: np.random.Generator) -> None:
    program = program_from_casadi(sample_inverse_dynamics())
    states = list(sample_states(rng, 300))
    exact = run_program(program, states, dtype=LONG)[0]
    got = run_program(change(program), states, dtype=LONG)[0]
    # Condition of the leg Jacobian, some tens, times a thousand operations in long double.
    assert np.abs(got - exact).max() < 1e4 * np.finfo(LONG).eps * np.abs(exact).max()


def test_dead_operations_go_and_constants_fold() -> None:
    x = ca.SX.sym("x", 2)
    program = read(x[0] * x[1], ca.sin(x[0]), inputs=x)
    first = Program(
        program.name, program.inputs, program.outputs, program.instructions, (program.results[0][:1],)
    )
    assert counts(drop_dead(first))[Kind.SIN] == 0
    assert n_operations(drop_dead(first)) == 1


def test_value_by_its_root_is_the_root() -> None:
    x = ca.SX.sym("x")
    found = counts(share_reciprocals(read(x / ca.sqrt(x), inputs=x)))
    assert (found[Kind.DIV], found[Kind.SQRT]) == (0, 1)


def test_neutral_operands_and_double_signs_go() -> None:
    rng = np.random.default_rng(7)
    program = unpolished_program(rng)
    before, after = counts(program), counts(simplify(program))
    assert after[Kind.NEG] < before[Kind.NEG] / 4
    assert n_operations(simplify(program)) < 0.7 * n_operations(program)


def test_signs_are_moved_into_sums() -> None:
    x = ca.SX.sym("x", 3)
    program = simplify(read(x[0] + (-x[1]) * x[2], -(x[0] * (-x[1])), inputs=x))
    found = counts(program)
    assert (found[Kind.NEG], found[Kind.ADD], found[Kind.SUB]) == (0, 0, 1)


def test_one_division_for_each_denominator() -> None:
    x = ca.SX.sym("x", 4)
    length = ca.sqrt(x[0])
    program = read(x[1] / length, x[2] / length, x[3] / x[0], x[2] / (x[0] * length), inputs=x)
    assert counts(program)[Kind.DIV] == 4
    # 1/s = (1/√s)², and the inverse of the product is the product of the inverses.
    assert counts(share_reciprocals(program))[Kind.DIV] == 1


def test_inverse_of_a_quotient_needs_no_division() -> None:
    x = ca.SX.sym("x", 3)
    inverse = 1 / x[0]
    program = read(inverse * x[1], x[2] / inverse, x[2] * inverse, inputs=x)
    assert counts(share_reciprocals(program))[Kind.DIV] == 1


def test_negative_values_keep_their_inverse_where_the_root_is_not_taken() -> None:
    x = ca.SX.sym("x")
    root = ca.if_else(x > 0, 1 / ca.sqrt(x), 0)
    program = prepare(read(root, 1 / x, 2 / x, inputs=x))
    got = run_program(program, [np.array([[-4.0], [4.0]])])[0]
    assert np.array_equal(got, [[0.0, -0.25, -0.5], [0.5, 0.25, 0.5]])


def test_single_division_is_left_alone() -> None:
    x = ca.SX.sym("x", 2)
    found = counts(share_reciprocals(read(x[0] / x[1], inputs=x)))
    assert (found[Kind.DIV], found[Kind.MUL]) == (1, 0)


def test_hexapod_divides_eighteen_times() -> None:
    program = program_from_casadi(sample_inverse_dynamics())
    shorter = prepare(program)
    assert counts(program)[Kind.DIV] > 100
    assert counts(shorter)[Kind.DIV] == 18  # a length and a tilt for each of six legs, and six pivots
    found = counts(shorter)
    assert n_operations(shorter) - found[Kind.NEG] < 0.75 * n_operations(program)


def test_fusing_saves_a_product_and_keeps_those_in_use() -> None:
    x = ca.SX.sym("x", 4)
    product = x[0] * x[1]
    assert counts(fuse(read(product + x[2], inputs=x))) == {
        **dict.fromkeys(Kind, 0),
        Kind.FMA: 1,
        Kind.INPUT: 3,
    }
    kept = counts(fuse(read(product + x[2], product, inputs=x)))
    assert (kept[Kind.FMA], kept[Kind.MUL]) == (0, 1)
    both = counts(fuse(read(product + x[2], x[3] - product, inputs=x)))
    assert (both[Kind.FMA], both[Kind.MUL], both[Kind.NEG]) == (2, 0, 1)


def test_long_chains_of_products_are_followed_in_linear_time() -> None:
    x = ca.SX.sym("x")
    value, older = x, x + 1
    for _ in range(3000):
        value, older = value * older, value
    program = read(1 / x, 1 / (x + 1), 1 / value, 2 / value, inputs=x)
    assert counts(share_reciprocals(program))[Kind.DIV] == 2


def test_division_by_a_constant_is_a_product() -> None:
    x = ca.SX.sym("x", 2)
    program = simplify(share_reciprocals(read(x[0] / 4.0, (x[1] * 1.0) / (2 * ca.SX(3.0)), inputs=x)))
    assert counts(program)[Kind.DIV] == 0
    got = run_program(program, [np.array([[3.0, 5.0]])])[0]
    assert got[0, 0] == 0.75
    assert abs(got[0, 1] - 5.0 / 6.0) < 2e-16


@pytest.mark.parametrize(
    "denominator",
    [
        lambda x, y: x * y,
        lambda x, y: -x,
        lambda x, y: x / y,
        lambda x, y: 1 / x,
        lambda x, y: ca.sqrt(x),
        lambda x, y: x * x,
        lambda x, y: 3 * x,
        lambda x, y: -(x * y) / (x * x),
    ],
)
def test_derived_inverses_are_right(denominator: Callable[[ca.SX, ca.SX], ca.SX]) -> None:
    x = ca.SX.sym("x", 2)
    d = denominator(x[0], x[1])
    program = read(1 / x[0], 2 / x[0], 5 / x[1], 7 / x[1], 3 / d, x[1] / d, x[0] / ca.sqrt(x[0]), inputs=x)
    states = np.array([[0.3, 7.0], [4.0, 0.7]])
    for change in (share_reciprocals, prepare):
        changed = change(program)
        # A few roundings each, in long double; the inverse of 3 is rounded to a double.
        error = (
            run_program(changed, [states], dtype=LONG)[0] / run_program(program, [states], dtype=LONG)[0] - 1
        )
        assert np.abs(error).max() < 2e-16
        assert counts(changed)[Kind.DIV] <= 3
