"""MJCF, the native format of MuJoCo, read through MuJoCo's own compiler (extra ``mjcf``).

The tree, its loops and couplings, the motors and the home configuration are those of the compiled model: defaults,
units, frames and inertias from shapes mean what they mean in MuJoCo. Constraints become rigid. The world is the
ground; bodies on free joints hang on it by floating joints.

References
----------
.. [1] MuJoCo documentation, "XML reference" and "Modeling: kinematic tree".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Mechanism, Note, Outcome
from stewart_pin.model.formats.mjcf.compiling import compile_mjcf, import_mujoco
from stewart_pin.model.formats.mjcf.left_out import left_out
from stewart_pin.model.formats.mjcf.loops import read_ties
from stewart_pin.model.formats.mjcf.motors import read_motors
from stewart_pin.model.formats.mjcf.names import given_names
from stewart_pin.model.formats.mjcf.tree import read_tree
from stewart_pin.model.formats.xml import UNLIMITED

_USED = (
    "body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "jnt_pos", "jnt_axis", "jnt_range",
    "site_pos", "site_quat", "eq_data", "qpos0", "key_qpos", "key_mpos", "key_mquat", "tendon_length0", "wrap_prm",
    "actuator_gear", "actuator_gainprm", "actuator_forcerange", "actuator_ctrlrange", "jnt_actfrcrange",
    "geom_pos", "geom_quat",
)  # fmt: skip
"""Arrays of the compiled model that the mechanism is made of."""


def read_mjcf(path: Path) -> Mechanism:
    """Read an MJCF file.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    Mechanism
        Description, not yet validated. Home is the keyframe ``home``, or else the first, or else the configuration
        in which the file draws the bodies; the platform is the body or the site that ``<text name="platform">`` of
        ``<custom>`` names, or else the one called ``platform``.

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.
    FileFormatError
        If MuJoCo refuses the file, or it holds what has no counterpart.
    """
    model, asides, warned = compile_mjcf(path)
    _require_numbers(model, str(path))
    key, key_notes = _home_key(model)
    tree = read_tree(model, asides, key=key, source=str(path))
    ties = read_ties(model, tree, source=str(path))
    drive = read_motors(model, tree)
    off = import_mujoco().mjtDisableBit.mjDSBL_GRAVITY
    x, y, z = (0.0 if model.opt.disableflags & off else float(value) for value in model.opt.gravity)
    said = [Note("MuJoCo", f"warns: {text}") for text in warned]
    name = str(model.names[: model.names.index(b"\0")].decode("utf-8", "replace"))
    return Mechanism(
        name=name if name not in ("", "MuJoCo Model") else path.stem,
        links=tree.links,
        joints=drive.joints,
        motor_hints=drive.hints,
        loops=ties.loops,
        couplings=ties.couplings,
        platform=tree.platform,
        home=tree.home,
        home_is_guess=not asides.assembled,
        source=str(path),
        notes=(*said, *tree.notes, *ties.notes, *drive.notes, *key_notes, *left_out(model, tree)),
        gravity=(x, y, z),
        assembled=asides.assembled,
    )


def _require_numbers(model: Any, source: str) -> None:
    for array in _USED:
        if not (np.abs(np.asarray(getattr(model, array))) <= UNLIMITED).all():
            raise FileFormatError(
                f"the compiled model holds numbers in '{array}' that are not finite, or beyond {UNLIMITED:g}; "
                "correct the numbers of the file",
                path=source,
                culprit=array,
            )


def _home_key(model: Any) -> tuple[int | None, list[Note]]:
    """Choose the keyframe that is home."""
    names = given_names(model, "key", model.nkey)
    if not names:
        return None, []
    chosen = names.index("home") if "home" in names else 0
    notes = [
        Note(f"keyframe '{name or k + 1}'", "only one keyframe is home")
        for k, name in enumerate(names)
        if k != chosen
    ]
    if names[chosen] != "home":
        text = "taken as home, as none is called 'home'"
        notes.insert(0, Note(f"keyframe '{names[chosen] or 1}'", text, Outcome.KEPT))
    return chosen, notes
