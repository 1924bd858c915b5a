"""Sine, cosine, arctangent and relatives of all lanes at once: a few units in the last place, everywhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stewart_pin.programs.array_kernel import ArrayKernel
from stewart_pin.programs.program import Kind
from tests.programs.examples import one_operation
from tests.programs.targets import TARGETS

pytest.importorskip("llvmlite")

each_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
each_type = pytest.mark.parametrize("dtype", [np.float64, np.float32])
LARGEST = {np.float64: 1e6, np.float32: 8e3}
"""Angles up to here are reduced by all lanes at once."""


def units_off(got: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest error in units in the last place of the exact value."""
    return float((np.abs(got - exact) / np.spacing(np.abs(exact).astype(got.dtype))).max())


def angles(dtype: type, rng: np.random.Generator) -> np.ndarray:
    """Draw angles of all sizes, and the numbers next to multiples of a quarter turn."""
    exponents = np.finfo(dtype).minexp * 0.3, np.log10(LARGEST[dtype])
    quarters = (np.arange(-5000, 5000) * np.pi / 2).astype(dtype)
    drawn = [
        rng.uniform(-7, 7, 30_000),
        rng.uniform(-1, 1, 30_000) * LARGEST[dtype],
        10.0 ** rng.uniform(*exponents, 10_000),
        quarters,
        np.nextafter(quarters, dtype(np.inf)),
        np.nextafter(quarters, dtype(-np.inf)),
        [0.0, -0.0, LARGEST[dtype], -LARGEST[dtype]],
    ]
    return np.concatenate(drawn).astype(dtype)


@each_target
@each_type
@pytest.mark.parametrize(("kind", "exact"), [(Kind.SIN, np.sin), (Kind.COS, np.cos)])
def test_sine_and_cosine(kind: Kind, exact: Callable, dtype: type, target, rng: np.random.Generator) -> None:
    x = angles(dtype, rng)
    got = ArrayKernel(one_operation(kind), dtype=dtype, target=target)(np.stack([x, x, x], axis=1))[:, 0]
    assert units_off(got, exact(x.astype(np.longdouble))) < 2.5
    assert np.array_equal(np.signbit(got[x == 0.0]), np.signbit(exact(x[x == 0.0])))


@each_target
@each_type
def test_large_angles_do_not_disturb_their_neighbours(dtype: type, target, rng: np.random.Generator) -> None:
    x = rng.uniform(-3, 3, 200).astype(dtype)
    kernel = ArrayKernel(one_operation(Kind.SIN), dtype=dtype, target=target)
    alone = kernel(np.stack([x, x, x], axis=1))[:, 0]
    x[5::16] = 10.0 ** rng.uniform(8, 30, len(x[5::16]))
    got = kernel(np.stack([x, x, x], axis=1))[:, 0]
    assert units_off(got, np.sin(x.astype(np.longdouble))) < 2.5
    near = np.abs(x) < 4
    assert np.array_equal(got[near], alone[near])


@each_target
@each_type
def test_arctangent_of_two(dtype: type, target, rng: np.random.Generator) -> None:
    size = 0.9 * np.log10(np.finfo(dtype).max)
    t = rng.uniform(-np.pi, np.pi, 30_000)
    largest = float(np.finfo(dtype).max)
    special = np.array([0.0, -0.0, 1.0, -1.0, 1e-44, largest, -largest, 0.6 * largest])
    points = np.concatenate(
        [
            np.stack([np.sin(t), np.cos(t)], axis=1),
            10.0 ** rng.uniform(-3, 3, (30_000, 2)) * rng.choice([-1, 1], (30_000, 2)),
            10.0 ** rng.uniform(-size, size, (10_000, 2)) * rng.choice([-1, 1], (10_000, 2)),
            np.stack(np.meshgrid(special, special), axis=-1).reshape(-1, 2),
        ]
    ).astype(dtype)
    states = np.concatenate([points, points[:, :1]], axis=1)
    got = ArrayKernel(one_operation(Kind.ATAN2), dtype=dtype, target=target)(states)[:, 0]
    exact = np.arctan2(*points.T.astype(np.longdouble))
    assert units_off(got, exact) < 2.5
    assert np.array_equal(np.signbit(got), np.signbit(exact))


@each_target
@each_type
@pytest.mark.parametrize(
    ("kind", "exact"), [(Kind.ASIN, np.arcsin), (Kind.ACOS, np.arccos), (Kind.ATAN, np.arctan)]
)
def test_inverse_functions(
    kind: Kind, exact: Callable, dtype: type, target, rng: np.random.Generator
) -> None:
    x = np.concatenate(
        [rng.uniform(-1, 1, 30_000), 1 - 10.0 ** rng.uniform(-16, 0, 5000), 10.0 ** rng.uniform(-30, 0, 5000)]
    )
    x = np.concatenate([x, -x, [0.0, 1.0, -1.0]]).astype(dtype)
    kernel = ArrayKernel(one_operation(kind), dtype=dtype, target=target)
    got = kernel(np.stack([x, x, x], axis=1))[:, 0]
    assert units_off(got, exact(x.astype(np.longdouble))) < 3.5
    if kind is not Kind.ATAN:
        assert np.isnan(kernel(np.full((3, 3), np.nextafter(dtype(1), dtype(2))))).all()
