"""One pose from six lengths: the printed figures S1.8, random robots, many digits, typed failures."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import ClosureError, InputError, MissingExtraError, SingularityError
from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation

HOME = ([0.0, 0.0, 20.0], np.eye(3))
LENGTHS = [20.0, 25.0, 26.0, 20.0, 20.0, 20.0]
# S1.8 as printed; the last entries are psi, theta, phi.
PRINTED = {
    "x": "-3.4469557159719698767603820145102",
    "y": "7.967616235254526202721299530723",
    "z": "18.017646567180649831017508642222",
    "psi": "0.023390306070863206015935701738644",
    "theta": "-0.078688271816232459173105224884905",
    "phi": "0.19162395249659578920609236083318",
}


def _exact_residual(robot: stp.Hexapod, numbers: dict[str, str]) -> float:
    """Evaluate |p + Rz Ry Rx P - B| - l from decimal strings alone, sharing no code with the package."""
    mp = pytest.importorskip("mpmath")
    with mp.workdps(80):
        x, y, z, psi, theta, phi = (mp.mpf(numbers[n]) for n in PRINTED)
        rz = mp.matrix([[mp.cos(psi), -mp.sin(psi), 0], [mp.sin(psi), mp.cos(psi), 0], [0, 0, 1]])
        ry = mp.matrix([[mp.cos(theta), 0, mp.sin(theta)], [0, 1, 0], [-mp.sin(theta), 0, mp.cos(theta)]])
        rx = mp.matrix([[1, 0, 0], [0, mp.cos(phi), -mp.sin(phi)], [0, mp.sin(phi), mp.cos(phi)]])
        gaps = [
            mp.norm(mp.matrix([x, y, z]) + rz * ry * rx * mp.matrix(p.tolist()) - mp.matrix(b.tolist()))
            - length
            for p, b, length in zip(robot.platform_points, robot.base_points, LENGTHS, strict=True)
        ]
        return float(max(abs(g) for g in gaps))


def test_source_example_in_double_precision(source_hexapod: stp.Hexapod) -> None:
    pose = stp.hexapod_pose(source_hexapod, LENGTHS, guess=HOME)
    position, rotation = pose
    printed = [float(PRINTED[n]) for n in ("x", "y", "z", "phi", "theta", "psi")]
    # Round-off of lengths near 20 through a Jacobian of condition ten.
    np.testing.assert_allclose([*position, *rpy_from_rotation(rotation)], printed, atol=1e-13)
    assert pose.success and pose.residual < 1e-13 and pose.decimals is None
    np.testing.assert_array_equal(pose[:2][0], position)


def test_source_example_to_fifty_digits(source_hexapod: stp.Hexapod) -> None:
    pytest.importorskip("mpmath")
    pose = stp.hexapod_pose(source_hexapod, LENGTHS, guess=HOME, digits=50)
    assert pose.decimals is not None
    assert pose.residual < 1e-50
    # 50 significant digits of numbers up to 18.
    assert _exact_residual(source_hexapod, pose.decimals) < 1e-48
    # The printed numbers agree to 16 significant digits or more. Beyond those they solve nothing:
    # their own residual is 1.9e-18, where the source claims 1e-50.
    for name, printed in PRINTED.items():
        assert float(pose.decimals[name]) == pytest.approx(float(printed), rel=1e-15)
    assert 1e-18 < _exact_residual(source_hexapod, PRINTED) < 2e-18


def test_convergence_is_quadratic(source_hexapod: stp.Hexapod) -> None:
    pytest.importorskip("mpmath")
    pose = stp.hexapod_pose(source_hexapod, LENGTHS, guess=HOME, digits=400)
    orders = np.diff(np.log(np.log(1.0 / np.array(pose.residuals[-4:-1])))) / np.log(2.0)
    # Each step doubles the digits; the constant fades as they grow.
    np.testing.assert_allclose(orders, 1.0, atol=0.1)


def test_random_poses_return(report_cad: stp.Hexapod, rng: np.random.Generator) -> None:
    home = (np.array([0.0, 0.0, 2.2]), np.eye(3))
    for _ in range(50):
        position = home[0] + rng.uniform(-0.15, 0.15, 3)
        rotation = rotation_from_rpy(*np.radians(rng.uniform(-10, 10, 3)))
        found = stp.hexapod_pose(report_cad, stp.leg_lengths(report_cad, position, rotation), guess=home)
        # Round-off times a condition number near 1e2.
        np.testing.assert_allclose(found.position, position, atol=1e-12)
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
        assert found.iterations <= 7


def test_far_guesses_never_change_side(report_cad: stp.Hexapod, rng: np.random.Generator) -> None:
    failures = 0
    for _ in range(100):
        position, start = rng.uniform(-0.5, 0.5, (2, 3)) + [0, 0, 1.5]
        rotation, turned = rotation_from_rpy(*rng.uniform(-0.8, 0.8, (3, 2)))
        pose = stp.hexapod_pose(
            report_cad,
            stp.leg_lengths(report_cad, position, rotation),
            guess=(start, turned),
            throw=False,
        )
        sides = [
            np.linalg.det(stp.leg_jacobian(report_cad, p, r)) > 0 for p, r in ((start, turned), tuple(pose))
        ]
        assert sides[0] == sides[1]
        failures += not pose.success
    # A solution on the guess's side need not exist; most draws have one.
    assert failures < 20


def test_generic_platforms_never_change_side(rng: np.random.Generator) -> None:
    # Shorter errors beyond det J = 0 tempt one search in seven; only the comparison of signs keeps it back.
    for _ in range(60):
        hexapod = stp.Hexapod(*rng.normal(size=(2, 6, 3)))
        position, rotation = rng.normal(size=3), Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        lengths = stp.leg_lengths(hexapod, position, rotation)
        turn = Rotation.from_rotvec(0.4 * rng.normal(size=3)).as_matrix()
        guess = (position + 0.3 * rng.normal(size=3), turn @ rotation)
        pose = stp.hexapod_pose(hexapod, lengths, guess=guess, throw=False)
        before, after = (np.linalg.slogdet(stp.leg_jacobian(hexapod, *p))[0] for p in (guess, tuple(pose)))
        assert before == after


def test_lengths_out_of_reach_say_so(report_cad: stp.Hexapod) -> None:
    lengths = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 9.0])
    guess = ([0.0, 0.0, 1.5], np.eye(3))
    with pytest.raises((ClosureError, SingularityError)) as caught:
        stp.hexapod_pose(report_cad, lengths, guess=guess)
    assert "residual" in str(caught.value) or "singular" in str(caught.value)
    pose = stp.hexapod_pose(report_cad, lengths, guess=guess, throw=False)
    assert not pose.success and pose.residual > 0.1
    assert np.isfinite(pose.position).all() and np.isfinite(pose.rotation).all()


def test_singular_guess_gives_the_singular_value(report_ideal: stp.Hexapod) -> None:
    guess = ([0.0, 0.0, 1.0], rotation_from_rpy(0.0, 0.0, np.pi / 2))
    with pytest.raises(SingularityError, match="guess is a singular pose") as caught:
        stp.hexapod_pose(report_ideal, np.ones(6), guess=guess)
    assert caught.value.smallest_singular_value < 1e-12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lengths": [1.0] * 5}, "lengths must have shape"),
        ({"lengths": [1.0] * 5 + [-1.0]}, "lengths must be above zero"),
        ({"guess": ([0, 0], np.eye(3))}, r"guess\[0\] must have shape"),
        ({"guess": ([0, 0, 1], 2 * np.eye(3))}, "rotation matrices"),
        ({"digits": 0}, "digits must lie"),
    ],
)
def test_bad_input_is_named(report_cad: stp.Hexapod, change, words) -> None:
    arguments = {"lengths": np.ones(6), "guess": ([0.0, 0.0, 1.0], np.eye(3))} | change
    with pytest.raises(InputError, match=words):
        stp.hexapod_pose(report_cad, arguments.pop("lengths"), **arguments)


def test_missing_mpmath_names_the_extra(source_hexapod: stp.Hexapod, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "mpmath", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[precision\]"):
        stp.hexapod_pose(source_hexapod, LENGTHS, guess=HOME, digits=30)
