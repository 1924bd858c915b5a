"""Calls with one state in fixed places."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from stewart_pin.errors import InputError
from stewart_pin.programs.array_kernel import ArrayKernel, Engine
from stewart_pin.programs.status import StateBound, StateStatus
from stewart_pin.programs.symbolic import program_from_casadi

pytest.importorskip("llvmlite")
each_engine = pytest.mark.parametrize("engine", ["llvm", "numpy"])


def kernel(engine: Engine) -> ArrayKernel:
    """Compile y = √x₀ + x₁, z = A x, judged by x₁."""
    x, a = ca.SX.sym("x", 2), ca.SX.sym("A", 2, 2)
    function = ca.Function("f", [x, a], [ca.sqrt(x[0]) + x[1], a @ x, x[1]], ["x", "A"], ["y", "z", "c"])
    return ArrayKernel(program_from_casadi(function), bounds=[StateBound("c", upper=10.0)], engine=engine)


@each_engine
def test_results_are_fresh_unless_a_place_is_given(engine: Engine) -> None:
    single = kernel(engine).single_state()
    y, z = single(np.array([4.0, 1.0]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    assert (y[0], *z, single.status) == (3.0, 6.0, 16.0, StateStatus.OK)
    out = np.empty(1), np.empty(2)
    given = single(np.array([9.0, 1.0]), np.eye(2), out=out)
    assert (y[0], *z) == (3.0, 6.0, 16.0)
    assert given[0] is out[0] and (out[0][0], *out[1]) == (4.0, 9.0, 1.0)
    for wrong in (out[:1], (out[0], np.empty(3)), (out[0], np.empty(2, dtype=np.float32))):
        with pytest.raises(InputError, match="out must"):
            single(np.array([9.0, 1.0]), np.eye(2), out=wrong)
    single.inputs[0][:] = 16.0, 2.0
    single.run()
    assert (single.outputs[0][0], *single.outputs[1]) == (6.0, 16.0, 2.0)


@each_engine
def test_one_output_comes_alone(engine: Engine) -> None:
    x = ca.SX.sym("x", 3)
    single = ArrayKernel(program_from_casadi(ca.Function("f", [x], [2 * x])), engine=engine).single_state()
    assert np.array_equal(single(np.arange(3.0)), [0.0, 2.0, 4.0])


@each_engine
def test_bad_state_gives_nan_and_a_code(engine: Engine) -> None:
    single = kernel(engine).single_state()
    for x, code in [
        ([np.nan, 1.0], StateStatus.INPUT_NOT_FINITE),
        ([-1.0, 1.0], StateStatus.RESULT_NOT_FINITE),
        ([1.0, 11.0], StateStatus.OUT_OF_BOUNDS),
    ]:
        y, z = single(np.array(x), np.eye(2))
        assert single.status is code
        assert np.isnan([*y, *z]).all()
    y, _ = single(np.array([1.0, 1.0]), np.eye(2))
    assert (y[0], single.status) == (2.0, StateStatus.OK)


@each_engine
def test_any_array_of_the_right_shape_is_taken(engine: Engine) -> None:
    single = kernel(engine).single_state()
    for x in ([4, 1], (4.0, 1.0), np.array([4, 1], dtype=np.float32), np.array([4.0, 0, 1.0, 0])[::2]):
        assert single(x, np.eye(2, order="F"))[0][0] == 3.0


@each_engine
def test_what_does_not_fit_is_refused(engine: Engine) -> None:
    single = kernel(engine).single_state()
    x, a = np.ones(2), np.eye(2)
    for arguments, message in [
        ((x,), "takes 2 arrays, got 1"),
        ((np.ones(3), a), "x must have shape"),
        ((1.0, a), "x must have shape"),
        ((x, np.ones(2)), "A must have shape"),
        ((x[None], a), "x must be one state"),
        ((x + 1j, a), "x must be an array of real numbers"),
        (("no", a), "x must be an array of real numbers"),
    ]:
        with pytest.raises(InputError, match=message):
            single(*arguments)
