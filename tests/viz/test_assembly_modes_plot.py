"""The picture of all assembly modes holds what it should."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MissingExtraError

LENGTHS = np.array([20.0, 25.0, 26.0, 20.0, 20.0, 20.0])


def test_one_panel_for_each_mode(source_hexapod: stp.Hexapod) -> None:
    pytest.importorskip("matplotlib")
    from stewart_pin.viz.planar import plot_assembly_modes

    modes = stp.assembly_modes(source_hexapod, LENGTHS)
    figure = plot_assembly_modes(source_hexapod, modes, columns=3)
    assert len(figure.axes) == len(modes) > 1
    facts = stp.hexapods.describe_modes(source_hexapod, modes)
    for axes, side in zip(figure.axes, facts.side, strict=True):
        assert ("det J > 0" in axes.get_title()) == (side > 0)
        # Six legs of the given lengths.
        legs = [np.linalg.norm(np.diff(line.get_data_3d(), axis=1)) for line in axes.lines]
        np.testing.assert_allclose(legs, LENGTHS, atol=1e-9)


def test_bad_requests_are_named(source_hexapod: stp.Hexapod, monkeypatch) -> None:
    from stewart_pin.viz.planar import plot_assembly_modes

    modes = stp.assembly_modes(source_hexapod, LENGTHS)
    none = stp.assembly_modes(source_hexapod, [1.0, 1.0, 1.0, 1.0, 1.0, 99.0])
    assert len(none) == 0
    with pytest.raises(InputError, match="nothing to draw"):
        plot_assembly_modes(source_hexapod, none)
    with pytest.raises(InputError, match="columns"):
        plot_assembly_modes(source_hexapod, modes, columns=0)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[plot\]"):
        plot_assembly_modes(source_hexapod, modes)
