"""Random six-legged platforms of every class with a known number of complex poses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

import stewart_pin as stp

Points = tuple[np.ndarray, np.ndarray]


def _spatial(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=(6, 3))


def _planar(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=(6, 3)) * [1, 1, 0]


def _shared(rng: np.random.Generator, *groups: tuple[int, ...]) -> np.ndarray:
    points = _spatial(rng)
    for first, *others in groups:
        points[others] = points[first]
    return points


def _semi_regular(rng: np.random.Generator) -> np.ndarray:
    half = rng.uniform(0.1, 0.9)
    angle = (2 * np.pi / 3 * np.arange(3)[:, None] + np.array([-half, half]) / 2).ravel()
    return rng.uniform(0.5, 2.0) * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(6)])


def _mirrored(rng: np.random.Generator) -> np.ndarray:
    half = _planar(rng)[:3]
    return np.vstack([half, half * [-1, 1, 1]])


def _mapped(base: np.ndarray, matrix: np.ndarray) -> Points:
    return base, base @ matrix.T


PAIRS = ((0, 1), (2, 3), (4, 5))
SHIFTED = ((1, 2), (3, 4), (5, 0))

# Finite complex poses for generic lengths, and how to draw base and platform.
CLASSES: dict[str, tuple[int, Callable[[np.random.Generator], Points]]] = {
    "general 6-6": (40, lambda r: (_spatial(r), _spatial(r))),
    "planar 6-6": (40, lambda r: (_planar(r), _planar(r))),
    "6-5": (40, lambda r: (_spatial(r), _shared(r, (0, 1)))),
    "5-5 adjacent": (40, lambda r: (_shared(r, (0, 1)), _shared(r, (1, 2)))),
    "5-5 disjoint": (24, lambda r: (_shared(r, (0, 1)), _shared(r, (2, 3)))),
    "6-4": (32, lambda r: (_spatial(r), _shared(r, (0, 1), (2, 3)))),
    "4-4": (24, lambda r: (_shared(r, *PAIRS[:2]), _shared(r, *SHIFTED[:2]))),
    "6-3": (16, lambda r: (_spatial(r), _shared(r, *PAIRS))),
    "5-3": (16, lambda r: (_shared(r, (1, 2)), _shared(r, *PAIRS))),
    "3-3": (16, lambda r: (_shared(r, *PAIRS), _shared(r, *SHIFTED))),
    "mirror-symmetric planar": (36, lambda r: (_mirrored(r), _mirrored(r))),
    "semi-regular hexagons": (28, lambda r: (_semi_regular(r), np.roll(_semi_regular(r), 1, axis=0))),
    "similar planar": (16, lambda r: _mapped(_planar(r), r.uniform(0.3, 0.8) * np.eye(3))),
    "affine planar": (16, lambda r: _mapped(_planar(r), np.diag([1, 1, 0]) @ r.normal(size=(3, 3)))),
    "similar spatial": (24, lambda r: _mapped(_spatial(r), r.uniform(0.3, 0.8) * np.eye(3))),
    "affine spatial": (32, lambda r: _mapped(_spatial(r), r.normal(size=(3, 3)))),
}


def draw(name: str, rng: np.random.Generator) -> tuple[stp.Hexapod, np.ndarray, np.ndarray]:
    """Draw a platform of a class and a pose."""
    hexapod = stp.Hexapod(*CLASSES[name][1](rng))
    return hexapod, rng.normal(size=3), Rotation.random(random_state=rng).as_matrix()


def distance_to(modes: stp.hexapods.AssemblyModes, position: np.ndarray, rotation: np.ndarray) -> float:
    """Give the distance of a pose to the nearest of a set; infinite for an empty set."""
    gaps = np.abs(modes.position - position).max(axis=1) + np.abs(modes.rotation - rotation).max(axis=(1, 2))
    return float(gaps.min(initial=np.inf))
