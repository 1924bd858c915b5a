"""What is read from CasADi computes what CasADi computes."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.programs.program import Kind, operation_counts, require_output, run_program
from stewart_pin.programs.symbolic import program_from_casadi


def evaluated_by_casadi(function: ca.Function, inputs: list[np.ndarray]) -> list[np.ndarray]:
    """Evaluate to outputs (N, rows, columns) by CasADi's own interpreter, state after state."""
    states = [
        [np.array(y) for y in function.call([ca.DM(x) for x in state])] for state in zip(*inputs, strict=True)
    ]
    return [np.array(y) for y in zip(*states, strict=True)]


def test_matrices_count_in_c_order(rng: np.random.Generator) -> None:
    m, x = ca.SX.sym("m", 2, 3), ca.SX.sym("x", 3)
    function = ca.Function("f", [m, x], [m @ x, 2 * m + 1, m.T @ m], ["m", "x"], ["a", "b", "c"])
    program = program_from_casadi(function)
    assert [p.shape for p in program.outputs] == [(2,), (2, 3), (3, 3)]
    inputs = [rng.normal(size=(4, 2, 3)), rng.normal(size=(4, 3))]
    a, b, c = run_program(program, [x.reshape(4, -1) for x in inputs])
    expected = evaluated_by_casadi(function, inputs)
    assert np.abs(a - expected[0][..., 0]).max() < 1e-14
    assert np.array_equal(b.reshape(4, 2, 3), 2 * inputs[0] + 1)
    assert np.abs(c.reshape(4, 3, 3) - expected[2]).max() < 1e-14


def test_structural_zeros_are_zeros() -> None:
    x = ca.SX.sym("x", ca.Sparsity.lower(3))
    program = program_from_casadi(ca.Function("f", [x], [2 * x, ca.SX(2, 2)], ["x"], ["y", "z"]))
    full = np.arange(1.0, 10.0)[None]
    y, z = run_program(program, [full])
    assert np.array_equal(y.reshape(3, 3), 2 * np.tril(full.reshape(3, 3)))
    assert np.array_equal(z, np.zeros((1, 4)))


UNARY = [
    ca.fabs,
    ca.sqrt,
    ca.sin,
    ca.cos,
    ca.tan,
    ca.asin,
    ca.acos,
    ca.atan,
    ca.sinh,
    ca.cosh,
    ca.tanh,
    ca.exp,
    ca.log,
]
UNARY += [ca.floor, ca.ceil, ca.sign, ca.log1p, ca.expm1, ca.asinh, ca.atanh]


def test_every_operation_reads_as_casadi_evaluates(rng: np.random.Generator) -> None:
    x = ca.SX.sym("x", 2)
    a, b = x[0], x[1]
    outputs = [f(a) for f in UNARY]
    outputs += [ca.acosh(1 + a), ca.atan2(a, b), a**b, a**2.5, a**3, a**2, 2 * a, 1 / a, -a, ca.fmin(a, b)]
    outputs += [
        ca.fmax(a, b),
        a < b,
        a <= b,
        a == b,
        a != b,
        ca.logic_not(a < b),
        ca.if_else(a < b, a * a, b),
    ]
    outputs += [ca.logic_and(a < b, b < 0.9), ca.logic_or(a < b, b < 0.1), ca.fmod(a, b), ca.hypot(a, b)]
    outputs += [ca.copysign(a, b - 0.5), a / b, a - b, a + a, ca.norm_2(x)]
    function = ca.Function("f", [x], [ca.vertcat(*outputs)])
    states = rng.uniform(0.05, 0.95, size=(50, 2))
    got = run_program(program_from_casadi(function), [states])[0]
    expected = evaluated_by_casadi(function, [states])[0][..., 0]
    # Library functions of NumPy and of C differ by units in the last place.
    assert np.abs(got - expected).max() < 1e-14


def test_matrix_functions_are_expanded(rng: np.random.Generator) -> None:
    x = ca.MX.sym("x", 3)
    function = ca.Function("f", [x], [ca.mtimes(x.T, x)])
    state = rng.normal(size=(1, 3))
    assert run_program(program_from_casadi(function), [state])[0][0, 0] == pytest.approx(state[0] @ state[0])


def test_repeated_operations_are_read_once() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x], [x[0] * x[1], x[1] * x[0] + 1])
    counts = operation_counts(program_from_casadi(function))
    assert counts[Kind.MUL] == 1


def test_what_cannot_be_read_is_refused() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    with pytest.raises(InputError, match=r"no inputs.*p"):
        program_from_casadi(ca.Function("f", [x], [x * p], {"allow_free": True}))
    with pytest.raises(InputError, match=r"casadi\.Function, got int"):
        program_from_casadi(3)
    with pytest.raises(UnsupportedError, match="OP_ERFINV"):
        program_from_casadi(ca.Function("f", [x], [ca.erfinv(x)]))
    y = ca.MX.sym("y", 2)
    solver = ca.rootfinder("s", "newton", {"x": y, "g": y - 1})
    with pytest.raises(UnsupportedError, match=r"OP_CALL.*inline"):
        program_from_casadi(ca.Function("f", [y], [solver(x0=y)["x"]]))
    with pytest.raises(InputError, match="no output 'z', only y"):
        require_output(program_from_casadi(ca.Function("f", [x], [x], ["x"], ["y"])), "z")
