"""Pictures of sweeps show the numbers that the sweep holds."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError

A, F = np.geomspace(0.01, 1.0, 5), np.linspace(1.0, 4.0, 7)


def force(a: float, f: float) -> dict[str, object]:
    if a > 0.9 and f > 3.9:
        raise SingularityError("here", smallest_singular_value=0.0)
    return {"force": [a * f**2, -1.0], "rate": a * f}


@pytest.fixture(scope="module")
def found() -> stp.sweeps.Sweep:
    return stp.sweep(force, {"a": A, "f": F})


def test_a_map_has_rows_for_the_first_parameter(found: stp.sweeps.Sweep) -> None:
    ax = stp.viz.plot_sweep(
        found, "force", lines={"one": ("rate", 1.0)}, labels={"f": "frequency [Hz]", "force": "[N]"}
    )
    mesh = ax.collections[0]
    np.testing.assert_array_equal(np.ma.filled(mesh.get_array(), np.nan), found["force"].max(axis=-1))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("frequency [Hz]", "a")
    # Equal ratios upwards, equal steps to the right; cells lie around their values.
    assert ax.get_yscale() == "log" and ax.get_xscale() == "linear"
    corners = np.asarray(mesh.get_coordinates())
    np.testing.assert_allclose(corners[0, :, 0], np.linspace(0.75, 4.25, 8))
    np.testing.assert_allclose(corners[:, 0, 1], np.geomspace(0.01 / 10**0.25, 10**0.25, 6))
    assert mesh.norm.__class__.__name__ == "LogNorm"
    assert ax.figure.axes[1].get_ylabel() == "[N]"
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["no answer"]
    # The line runs where a f = 1.
    vertices = np.concatenate([path.vertices for path in ax.collections[1].get_paths()])
    assert len(vertices) > 4
    np.testing.assert_allclose(
        np.prod(vertices, axis=1), 1.0, rtol=0.35
    )  # straight between the points of the grid


def test_a_single_parameter_is_a_curve(found: stp.sweeps.Sweep) -> None:
    ax = stp.viz.plot_sweep(found, "rate", at={"f": 2.5}, lines={"most": ("rate", 2.0)})
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), np.column_stack([A, 2.5 * A]))
    assert ax.get_xscale() == "log" and ax.get_xlabel() == "a" and ax.get_ylabel() == "rate"
    assert ax.lines[1].get_ydata() == [2.0, 2.0]


def test_words_stand_in_their_order() -> None:
    found = stp.sweep(lambda robot, k: len(robot) * k, {"robot": ["delta", "stewart"], "k": [1, 2]})
    ax = stp.viz.plot_sweep(found, "value")
    assert [label.get_text() for label in ax.get_yticklabels()] == ["delta", "stewart"]
    np.testing.assert_array_equal(ax.collections[0].get_array(), [[5, 10], [7, 14]])


def test_lists_of_points_are_dots(rng: np.random.Generator) -> None:
    a, f = rng.uniform(0.5, 1.0, 30), rng.uniform(3.0, 4.5, 30)
    found = stp.sweep(force, {"a": a, "f": f}, paired=True)
    lost = np.isnan(found["rate"])
    assert 0 < lost.sum() < 30
    ax = stp.viz.plot_sweep(found, "rate")
    np.testing.assert_array_equal(ax.collections[0].get_offsets(), np.column_stack([f, a])[~lost])
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), np.column_stack([f, a])[lost])
    one = stp.sweep(lambda a: a**2, {"a": a}, paired=True)
    np.testing.assert_array_equal(stp.viz.plot_sweep(one, "value").lines[0].get_ydata(), a**2)


def test_arrays_of_ones_own_and_single_rows(found: stp.sweeps.Sweep) -> None:
    ax = stp.viz.plot_sweep(found, found["force"][..., 1], labels={"": "own"})
    assert ax.figure.axes[1].get_ylabel() == "own"
    row = stp.sweep(force, {"a": [0.1], "f": F})
    ax = stp.viz.plot_sweep(row, "rate", lines={"x": ("rate", 0.2)})  # no line through a single row
    assert ax.collections[0].get_array().shape == (1, 7) and len(ax.collections) == 1


@pytest.mark.parametrize(
    ("values", "options", "words"),
    [
        ("speed", {}, "gives force, rate, not 'speed'"),
        (np.zeros((5, 6)), {}, r"must have the shape \(5, 7\)"),
        ("rate", {"at": {"g": 1.0}}, "at names 'g'; the parameters are a, f"),
        ("rate", {"at": {"f": 1.7}}, r"f has no value 1\.7; it has 1\.0, 1\.5"),
        ("rate", {"at": {"f": 1.0, "a": 1.0}}, "one or two parameters, this one none"),
        ("rate", {"lines": {"x": ("speed", 1.0)}}, "not 'speed'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(found: stp.sweeps.Sweep, values, options, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.viz.plot_sweep(found, values, **options)


def test_three_parameters_need_a_cut() -> None:
    found = stp.sweep(lambda a, b, c: a + 10 * b + 100 * c, {"a": [1, 2], "b": [3, 4, 5], "c": [6, 7]})
    with pytest.raises(InputError, match=r"this one a, b, c; choose values of others by at="):
        stp.viz.plot_sweep(found, "value")
    ax = stp.viz.plot_sweep(found, "value", at={"b": 4})
    np.testing.assert_array_equal(ax.collections[0].get_array(), [[641, 741], [642, 742]])


def test_points_without_any_answer_are_told_before_the_picture() -> None:
    found = stp.sweep(force, {"a": [1.0], "f": [4.0]})
    with pytest.raises(InputError, match="all 1 points failed"):
        stp.viz.plot_sweep(found, "rate")
