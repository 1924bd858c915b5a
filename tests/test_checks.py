"""Checks at the door, and errors that travel between processes."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin import errors
from stewart_pin.checks import as_array, as_batch, as_count, as_positive, require_broadcast
from stewart_pin.errors import InputError, StewartPinError


@pytest.mark.parametrize(
    "value",
    [
        "up",
        None,
        object(),
        [[1.0], [1.0, 2.0]],
        1j,
        np.array([1.0 + 2.0j]),
        [1j],
        pytest.param(10**400, id="huge"),
        {"a": 1},
    ],
)
def test_what_is_no_array_of_reals_is_named(value: object) -> None:
    for check in (lambda: as_array("x", value, (None,)), lambda: as_batch("x", value, (1,))):
        with pytest.raises(InputError, match=r"^x must"):
            check()


@pytest.mark.parametrize(
    ("value", "words"),
    [(np.zeros((2, 3)), r"must have shape \(3,\), got \(2, 3\)"), ([0, np.inf, 0], r"inf at index \(1,\)")],
)
def test_shape_and_value_are_named(value: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        as_array("x", value, (3,))  # type: ignore[arg-type]


def test_arrays_pass() -> None:
    given = np.ones(3)
    assert as_array("x", given, (3,)) is given
    assert as_array("x", [1, 2, 3], (3,)).dtype == np.float64
    assert as_array("x", [[1, 2]], (None, 2)).shape == (1, 2)
    assert as_batch("x", np.ones((4, 5, 3)), (3,)).shape == (4, 5, 3)
    assert as_positive("m", np.float32(2)) == as_positive("m", np.array(2.0)) == 2.0


@pytest.mark.parametrize(
    "value",
    [
        0,
        -1,
        np.nan,
        np.inf,
        "heavy",
        None,
        1j,
        [1.0],
        np.ones(1),
        np.ones(2),
        pytest.param(10**400, id="huge"),
    ],
)
def test_what_is_not_positive_is_named(value: object) -> None:
    with pytest.raises(InputError, match=r"^m must be a (finite )?number above zero, got"):
        as_positive("m", value)  # type: ignore[arg-type]


def test_batches_that_do_not_fit_are_named() -> None:
    require_broadcast(a=(2, 1), b=(3,), c=())
    with pytest.raises(InputError, match=r"a \(2,\), b \(3,\)"):
        require_broadcast(a=(2,), b=(3,))


EXAMPLES = [
    errors.InputError("x must be"),
    errors.FileFormatError("broken", path="a.urdf", culprit="<loop>"),
    errors.FileMissingError("no such file", path="a.urdf"),
    errors.MechanismError("two parents", path="a.urdf", culprit="link"),
    errors.UnsupportedError("not yet"),
    errors.MissingRoleError("no platform", missing="platform", candidates=["hand", "finger"]),
    errors.ClosureError("open", residual=0.1, iterations=3, q=np.arange(3.0)),
    errors.UnreachableError(
        "far", violations={"leg1": (3.0, 1.0, 2.0)}, residual=0.0, iterations=1, q=np.zeros(2)
    ),
    errors.SingularityError("flat", smallest_singular_value=1e-17, direction=np.ones(2), names=["a", "b"]),
    errors.ActuationError("loose", smallest_singular_value=0.0),
    errors.ConvergenceError("slow", residual=1e-3),
    errors.EffortLimitError("no efforts", residual=1.0, violations={"leg1": (3.0, -2.0, 2.0)}),
    errors.MissingExtraError("matplotlib", "plot"),
]


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda error: type(error).__name__)
def test_errors_survive_a_process_pool(error: StewartPinError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)
    assert again.__dict__.keys() == error.__dict__.keys()
    for key, value in error.__dict__.items():
        np.testing.assert_equal(again.__dict__[key], value)


def test_every_error_is_tried() -> None:
    defined = {
        kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, StewartPinError)
    }
    assert defined - {StewartPinError} == {type(error) for error in EXAMPLES}


@pytest.mark.parametrize(
    "value",
    [pytest.param(10**5000, id="huge"), pytest.param(-(10**5000), id="far below"), 2.0, "3", None, 10**7],
)
def test_counts_beyond_reason_are_named(value: object) -> None:
    with pytest.raises(InputError, match=r"^starts must be"):
        as_count("starts", value)
    assert as_count("seed", 10**400, most=None) == 10**400


def test_counts_seeds_types_and_axes_are_refused_by_name() -> None:
    chain = stp.load("stewart")
    home = chain.q_home[chain.motor_q_index]
    with pytest.raises(InputError, match=r"^starts must be 1000000 or less"):
        stp.loops.all_forward_kinematics(chain, home, starts=10**400)
    for seed in ("x", 1.5, -1, None):
        with pytest.raises(InputError, match=r"^seed must be"):
            stp.loops.all_forward_kinematics(chain, home, starts=1, seed=seed)
        with pytest.raises(InputError, match=r"^seed must be"):
            stp.motions.synthetic_accelerogram(seed=seed)
    with pytest.raises(InputError, match=r"^duration / dt must be 10000000 or less"):
        stp.motions.synthetic_accelerogram(duration=1e300)
    for dtype in ("nonsense", 3, int, object()):
        with pytest.raises(InputError, match=r"^dtype must be float64 or float32"):
            stp.compile_kernels(chain, dtype=dtype, engine="numpy")
    for axes in (5, "vx", [["vx"]], np.array([1.0, 2.0]), []):
        with pytest.raises(InputError, match=r"^axes must be some of vx"):
            stp.loops.generic_freedom(chain, axes)
        with pytest.raises(InputError, match=r"^axes must be some of vx"):
            stp.singularities.classify_singularity(chain, chain.q_home, axes=axes)
        with pytest.raises(InputError, match=r"^axes must be some of vx"):
            stp.singularities.singularity_map(chain, [0.0, 0.1], [0.0, 0.1], axes=axes)
    with pytest.raises(InputError, match=r"^plane must be two of vx"):
        stp.singularities.singularity_map(chain, [0.0, 0.1], [0.0, 0.1], plane=5)
