"""Programs to test on, and how large the round-off of a program may be."""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.programs.passes import drop_dead
from stewart_pin.programs.program import Instruction, Kind, Port, Program, ProgramBuilder, n_operands
from stewart_pin.programs.symbolic import program_from_casadi
from tests.kernels.hexapod_graph import eliminate

EPS = np.finfo(np.float64).eps
EXACT = {Kind.INPUT, Kind.CONSTANT, Kind.NEG}


def random_program(rng: np.random.Generator, n_operations: int = 300) -> Program:
    """Build sums, products, quotients, roots and signs of two inputs in random order, with values of size one."""
    a, b = ca.SX.sym("a", 5), ca.SX.sym("b", 2, 3)
    # No constants among them: a pass rounds what it computes from constants to doubles.
    pool = [*ca.vertsplit(a), *(b[i, j] for i in range(2) for j in range(3))]
    for _ in range(n_operations):
        x, y = (pool[-k] for k in rng.choice(min(40, len(pool)), 2, replace=False) + 1)
        pool.append(_combination(int(rng.integers(8)), x, y))
    outputs = [ca.vertcat(*pool[-6:]), ca.reshape(ca.vertcat(*pool[-12:-6]), 2, 3)]
    return program_from_casadi(ca.Function("random", [a, b], outputs, ["a", "b"], ["c", "d"]))


def _combination(which: int, x: ca.SX, y: ca.SX) -> ca.SX:
    size = ca.sqrt(1 + x * x)
    choices = [x * y / (1 + y * y), (x + y) / size, (x - y) / size, -x, size, x / size, 1 / (1 + x * x)]
    return [*choices, (x * y - x) / (size * (2 + y * y))][which]


def unpolished_program(rng: np.random.Generator, n_operations: int = 120) -> Program:
    """Build what CasADi would have simplified: signs everywhere, neutral constants, quotients of quotients."""
    source = Program(
        "unpolished", (Port("a", (5,)), Port("b", (6,))), (Port("c", (6,)), Port("d", (6,))), (), ()
    )
    builder = ProgramBuilder(source)
    pool = [builder.append(Instruction(Kind.INPUT, place=(0, k))) for k in range(5)]
    pool += [builder.append(Instruction(Kind.INPUT, place=(1, k))) for k in range(6)]
    pool += [builder.constant(value) for value in (0.0, -0.0, 1.0, -1.0)]
    one = pool[-2]
    kinds = [Kind.ADD, Kind.SUB, Kind.MUL, Kind.NEG, Kind.NEG, Kind.DIV]
    for _ in range(n_operations):
        x, y = (pool[-k] for k in rng.choice(min(25, len(pool)), 2, replace=False) + 1)
        kind = kinds[rng.integers(len(kinds))]
        if kind is Kind.DIV:  # by a value above one, or below minus one
            y = builder.operation(Kind.ADD, one, builder.operation(Kind.MUL, y, y))
            y = builder.operation(Kind.NEG, y) if rng.integers(2) else y
        value = builder.operation(kind, x) if kind is Kind.NEG else builder.operation(kind, x, y)
        pool.append(value)
    return builder.finish(iter([tuple(pool[-6:]), tuple(pool[-12:-6])]))


def dense_solve() -> Program:
    """Solution of a dense system of six equations by elimination down the diagonal."""
    matrix, right = ca.SX.sym("A", 6, 6), ca.SX.sym("b", 6)
    x, smallest = eliminate(matrix, right, np.array([(k, k) for k in range(6)]))
    return program_from_casadi(
        ca.Function("solve", [matrix, right], [x, smallest], ["A", "b"], ["x", "smallest_pivot"])
    )


def every_operation() -> Program:
    """Each operation once, on three inputs, with an output for each."""
    source = Program("every", (Port("x", (3,)),), (), (), ())
    builder = ProgramBuilder(source)
    x = [builder.append(Instruction(Kind.INPUT, place=(0, k))) for k in range(3)]
    results = []
    for kind in Kind:
        if kind not in {Kind.INPUT, Kind.CONSTANT}:
            results.append(builder.operation(kind, *x[: n_operands(kind)]))
    program = builder.finish(iter([tuple(results)]))
    return Program(
        "every", source.inputs, (Port("y", (len(results),)),), program.instructions, program.results
    )


def kinds_of_every_operation() -> list[Kind]:
    """List the operation behind each entry of the output of `every_operation`."""
    return [kind for kind in Kind if kind not in {Kind.INPUT, Kind.CONSTANT}]


def one_operation(kind: Kind) -> Program:
    """Take the program of one operation on three inputs."""
    whole = every_operation()
    k = kinds_of_every_operation().index(kind)
    results = ((whole.results[0][k],),)
    return drop_dead(Program(kind.value, whole.inputs, (Port("y", (1,)),), whole.instructions, results))


def reversed_row(size: int) -> Program:
    """Entries of a row in reverse order, so that no column can stand for another."""
    source = Program("reverse", (Port("x", (size,)),), (Port("y", (size,)),), (), ())
    builder = ProgramBuilder(source)
    entries = [builder.append(Instruction(Kind.INPUT, place=(0, k))) for k in range(size)]
    return builder.finish(iter([tuple(reversed(entries))]))


def special_values(dtype: np.dtype, rng: np.random.Generator) -> np.ndarray:
    """Triples of zeros of both signs, small, large and usual numbers; all finite."""
    tiny, huge = np.finfo(dtype).smallest_subnormal, np.sqrt(np.finfo(dtype).max) / 4
    values = np.array([0.0, -0.0, 1.0, -1.0, 0.5, 2.5, -3.25, tiny, -tiny, huge, -huge], dtype=dtype)
    grid = np.array(np.meshgrid(values, values, values[:8])).reshape(3, -1).T
    return np.concatenate([grid, rng.normal(size=(500, 3)).astype(dtype)])


def round_off(program: Program, inputs: list[np.ndarray], unit: float = EPS) -> list[np.ndarray]:
    """Bound of the error of each output: half a unit for each operation, carried on to first order.

    Running error analysis, Higham, "Accuracy and stability of numerical algorithms", 2002, section 3.3.
    """
    values: list[np.ndarray] = []
    errors: list[np.ndarray] = []
    flat = [x.reshape(len(x), -1).astype(np.longdouble) for x in inputs]
    for kind, args, constant, place in program.instructions:
        x, e = [values[k] for k in args], [errors[k] for k in args]
        if kind is Kind.INPUT:
            value, carried = flat[place[0]][:, place[1]], np.longdouble(0)
        elif kind is Kind.CONSTANT:
            value, carried = np.longdouble(constant), np.longdouble(0)
        elif kind is Kind.NEG:
            value, carried = -x[0], e[0]
        elif kind in {Kind.ADD, Kind.SUB}:
            value, carried = x[0] + x[1] if kind is Kind.ADD else x[0] - x[1], e[0] + e[1]
        elif kind is Kind.MUL:
            value, carried = x[0] * x[1], abs(x[0]) * e[1] + abs(x[1]) * e[0]
        elif kind is Kind.FMA:
            value, carried = x[0] * x[1] + x[2], abs(x[0]) * e[1] + abs(x[1]) * e[0] + e[2]
            carried = carried + unit / 2 * abs(x[0] * x[1])  # for those that round the product as well
        elif kind is Kind.DIV:
            value = x[0] / x[1]
            carried = (e[0] + abs(value) * e[1]) / abs(x[1])
        elif kind is Kind.SQRT:
            value = np.sqrt(x[0])
            carried = e[0] / (2 * value)
        else:  # fabs, fmin: selections
            value, carried = (np.fabs if kind is Kind.FABS else np.fmin)(*x), np.maximum.reduce(e)
        values.append(value)
        errors.append(carried + (0 if kind in EXACT else unit / 2 * abs(value)))
    return [
        np.stack(np.broadcast_arrays(*(errors[k] for k in entries)), axis=1) for entries in program.results
    ]
