"""What joints do by themselves, in kernels: as the verbs of one state, or refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels import choosing
from tests.closed_states import robot


@pytest.mark.parametrize(
    ("name", "joint", "own", "says"),
    [
        ("stewart", "leg1", {"damping": 3.0}, "'leg1' has damping 3"),
        ("stewart", "leg2_x", {"friction": 0.1}, "'leg2_x' has friction 0.1"),
        ("stewart", "leg3_ball", {"damping": 0.1}, "'turn' of loop 'leg3_ball' has damping 0.1"),
        ("five_bar", "left_hip", {"stiffness": 2.0}, "joint 'left_hip' has a spring"),
        ("five_bar", "left_hip", {"force": 2.0}, "joint 'left_hip' has a spring or a force"),
        ("five_bar", "tip_pin", {"damping": 2.0}, "'angle' of loop 'tip_pin' has damping 2"),
    ],
)
def test_what_has_no_graph_is_refused(name: str, joint: str, own: dict[str, float], says: str) -> None:
    chain = stp.with_joint_physics(robot(name), {joint: own})
    for coordinates in ("motor", "tree"):
        with pytest.raises(UnsupportedError, match=says):
            stp.compile_kernels(chain, coordinates=coordinates)
    assert choosing.kernels_for(chain, choosing.HANDFUL) is None
    assert choosing.simulation_kernels(chain, choosing.MANY_CALLS) is None
    with pytest.raises(UnsupportedError, match=says):
        choosing.kernels_for(chain, 1, wanted=True)
    with pytest.raises(UnsupportedError, match=says):
        choosing.simulation_kernels(chain, 1, wanted=True)


@pytest.mark.parametrize("field", ["armature", "damping", "friction"])
def test_kernels_of_joints_that_are_no_more_say_so(field: str) -> None:
    chain = robot("five_bar")
    chain = replace(chain, model=chain.model.copy())
    kernels = stp.compile_kernels(chain, coordinates="motor", engine="numpy")
    given = np.zeros((3, 1, chain.nu))
    before = kernels.inverse_dynamics(*given)
    getattr(chain.model, field)[1] = 2.0
    with pytest.raises(UnsupportedError, match=r"was 0 when .* is 2 now; compile them again"):
        kernels.inverse_dynamics(*given)
    with pytest.raises(UnsupportedError, match="compile them again"):
        kernels.casadi("inverse_dynamics")
    getattr(chain.model, field)[1] = 0.0
    np.testing.assert_array_equal(kernels.inverse_dynamics(*given), before)


def test_kernels_that_are_kept_are_those_of_the_model_as_it_is() -> None:
    chain = robot("five_bar")
    chain = replace(chain, model=chain.model.copy())
    kept = choosing.kernels_for(chain, choosing.HANDFUL)
    chain.model.armature[:] = 3.0
    other = choosing.kernels_for(chain, choosing.HANDFUL)
    assert other is not kept and other is not None
    chain.model.armature[:] = 0.0
    assert choosing.kernels_for(chain, choosing.HANDFUL) is kept
    chain.model.damping[0] = 1.0
    assert choosing.kernels_for(chain, choosing.HANDFUL) is None
