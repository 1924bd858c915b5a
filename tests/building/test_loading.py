"""Loading: names and paths, motors, platform and gravity; errors list the candidates."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.building import loading
from stewart_pin.errors import (
    FileMissingError,
    InputError,
    MechanismError,
    MissingRoleError,
    UnsupportedError,
)
from tests.small_urdf import ARM, bundled, robot, write


@pytest.mark.parametrize("name", stp.robots())
def test_names_and_paths_lead_to_the_same_robot(name: str, tmp_path: Path) -> None:
    by_name = stp.load(name)
    copied = shutil.copy(bundled(name), tmp_path / "other.urdf")
    for by_path in (stp.load(copied), stp.load(str(copied))):
        assert by_path.name == by_name.name == name
        assert by_path.motors == by_name.motors and by_path.platform == by_name.platform == "platform"
        np.testing.assert_array_equal(by_path.q_home, by_name.q_home)


def test_a_bundled_name_wins_over_a_file_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, robot(*ARM), "stewart")
    monkeypatch.chdir(tmp_path)
    assert stp.load("stewart").nu == 6


@pytest.mark.parametrize("name", ["stewart", "stewart_sps", "stewart_cad", "stewart_s1"])
def test_motors_stand_in_the_order_of_the_base_points(name: str) -> None:
    assert stp.load(name).motors == tuple(f"leg{k}" for k in range(1, 7))


def test_motors_may_be_chosen(tmp_path: Path) -> None:
    path = write(tmp_path, robot(*ARM))
    assert stp.load(path).motors == ("shoulder", "elbow")
    assert stp.load(path, motors=["elbow"]).motors == ("elbow",)
    chain = stp.load(path, motors=("elbow", "shoulder"))
    assert chain.motors == ("elbow", "shoulder")
    np.testing.assert_array_equal(chain.motor_index, [1, 0])
    np.testing.assert_array_equal(stp.motor_positions(chain, [0.1, 0.2]), [0.2, 0.1])


@pytest.mark.parametrize("motor", ["wrist", "glue", None])
def test_wrong_motors_list_the_candidates(tmp_path: Path, motor: str | None) -> None:
    glue = '<link name="c"/><joint name="glue" type="fixed"><parent link="arm"/><child link="c"/></joint>'
    with pytest.raises(MechanismError, match="the candidates are: shoulder, elbow") as caught:
        stp.load(write(tmp_path, robot(*ARM, glue)), motors=[motor])  # type: ignore[list-item]
    assert caught.value.culprit == str(motor)


@pytest.mark.parametrize(
    ("motors", "words"),
    [("elbow", "sequence of joint names, got 'elbow'"), (3, "sequence"), (["elbow", "elbow"], "twice")],
)
def test_motors_of_another_type_are_refused(tmp_path: Path, motors: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.load(write(tmp_path, robot(*ARM)), motors=motors)  # type: ignore[arg-type]


def test_the_platform_may_be_chosen(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM)), platform="arm")
    assert chain.platform == "arm"
    assert chain.model.frames[chain.platform_id].name == "arm"


@pytest.mark.parametrize("platform", ["wing", "base", "elbow", ""])
def test_a_wrong_platform_lists_the_candidates(tmp_path: Path, platform: str) -> None:
    with pytest.raises(
        MechanismError, match=f"no moving link '{platform}'.*the candidates are: platform, arm"
    ):
        stp.load(write(tmp_path, robot(*ARM)), platform=platform)


def test_a_platform_that_nothing_names_lists_the_candidates(tmp_path: Path) -> None:
    text = robot(*ARM).replace('"platform"', '"hand"')
    with pytest.raises(MissingRoleError, match=r"has no platform.*platform=.*best guess first: hand, arm"):
        stp.platform_pose(stp.load(write(tmp_path, text)), np.zeros(2))
    assert stp.load(write(tmp_path, text), platform="hand").platform == "hand"


@pytest.mark.parametrize("gravity", [9.81, (0, 0), (0, 0, np.nan), "down"])
def test_gravity_is_a_vector(gravity: object) -> None:
    with pytest.raises(InputError, match="gravity must"):
        stp.load("stewart", gravity=gravity)  # type: ignore[arg-type]


def test_side_cars_of_other_kinds_are_named_as_unsupported() -> None:
    with pytest.raises(UnsupportedError, match=r"loops='loops\.toml'"):
        stp.load("stewart", loops="loops.toml")
    with pytest.raises(InputError, match="loops must be a path, got 3"):
        stp.load("stewart", loops=3)  # type: ignore[arg-type]


def test_robots_are_found_in_a_wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel has its robots inside the package, a checkout beside it."""
    package = tmp_path / "stewart_pin"
    shutil.copytree(bundled("stewart").parent, package / "urdf" / "stewart")
    (package / "urdf" / "empty").mkdir()
    try:
        monkeypatch.setattr(loading, "_PACKAGE", package)
        loading.urdf_root.cache_clear()
        assert loading.urdf_root() == package / "urdf"
        assert stp.robots() == ("stewart",)
        assert stp.load("stewart").mechanism.source.startswith(str(package))
        monkeypatch.setattr(loading, "_PACKAGE", tmp_path / "elsewhere" / "stewart_pin")
        loading.urdf_root.cache_clear()
        with pytest.raises(FileMissingError, match="reinstall"):
            stp.robots()
    finally:
        loading.urdf_root.cache_clear()


def test_the_description_is_frozen() -> None:
    chain = stp.load("stewart")
    with pytest.raises(ValueError, match="read-only"):
        chain.q_home[0] = 1.0
    with pytest.raises(AttributeError):
        chain.platform = "base"  # type: ignore[misc]
