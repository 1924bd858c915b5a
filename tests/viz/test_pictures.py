"""Pictures show what they are given."""

from __future__ import annotations

import builtins

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import MissingExtraError


@pytest.fixture(scope="module")
def chain() -> stp.ClosedChain:
    return stp.load("stewart")


def test_constraint_picture_labels_bodies_and_joints(chain: stp.ClosedChain) -> None:
    rest = np.zeros(chain.nv)
    figure = stp.viz.plot_constraint_matrix(stp.constraint_matrix_system(chain, chain.q_home, rest, rest))
    (axis,) = figure.axes
    assert axis.images[0].get_array().shape == (84, 84)
    labels = [label.get_text() for label in axis.get_xticklabels()]
    assert labels == [
        "ground\n1 × 6",
        "universal\n6 × 4",
        "prismatic\n6 × 5",
        "spherical\n6 × 3",
        "motor\n6 × 1",
    ]
    assert [label.get_text() for label in axis.get_yticklabels()][:2] == ["base", "platform"]


def test_comparison_picture_draws_every_method(chain: stp.ClosedChain) -> None:
    motion = stp.motions.sinusoidal_motion([0.0, 0.1, 0.2], home=stp.platform_pose(chain, chain.q_home))
    comparison = stp.compare_methods(chain, motion)
    figure = stp.viz.plot_comparison(comparison)
    lines = {line.get_label(): line.get_ydata() for line in figure.axes[4].get_lines()}
    assert set(lines) == {"pinocchio", "constraint_matrix", "closed_form", "point_mass"}
    np.testing.assert_array_equal(lines["pinocchio"], comparison.forces["pinocchio"][:, 4])
    assert figure.axes[6].get_yscale() == "log"


def test_missing_matplotlib_is_said(chain: stp.ClosedChain, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return genuine(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    rest = np.zeros(chain.nv)
    system = stp.constraint_matrix_system(chain, chain.q_home, rest, rest)
    with pytest.raises(MissingExtraError, match=r"pip install 'stewart_pin\[plot\]'"):
        stp.viz.plot_constraint_matrix(system)
