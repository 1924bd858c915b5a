"""Pinocchio's data with views of the placements in it, a pool of them, and quantities that are computed once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, NoReturn, TypeVar, overload

import numpy as np
import pinocchio as pin
from numpy import ndarray
from scipy.spatial.transform import Rotation

from stewart_pin.typing import Configuration, FloatArray, Tangent

T = TypeVar("T")

_POOL = 8
"""Memories that a chain keeps for its next states."""
_LARGE = 200
"""Freedoms from which on joints are placed without Pinocchio's memory: that of 340 has 0.9 GB, and takes seconds."""


class PlacedJoints(NamedTuple):
    """Where the joints of a chain are at one configuration.

    Attributes
    ----------
    jacobian
        (6, nv) spatial velocity at the world origin, in world axes, per tangent velocity: the columns of all joints; a
        body moves by those of the joints below it [m, rad per m or rad].
    rotation
        (njoints, 3, 3) rotations of the joints in the world.
    translation
        (njoints, 3) origins of the joints in the world [m].
    """

    jacobian: FloatArray
    rotation: FloatArray
    translation: FloatArray


class Scratch:
    """One `pinocchio.Data`, used for one computation at a time: of 3 nv³ numbers, too much for every state to keep.

    Parameters
    ----------
    model
        Pinocchio's model.

    Attributes
    ----------
    data
        Pinocchio's data, made when it is first asked for.
    rotation
        (njoints, 3, 3) rotations of the joints in the world, as the last call left them.
    translation
        (njoints, 3) origins of the joints in the world [m].
    """

    data: pin.Data
    rotation: FloatArray
    translation: FloatArray

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self._levels = _Levels(model) if model.nv >= _LARGE else None

    def __getattr__(self, name: str) -> Any:
        if name not in ("data", "rotation", "translation"):
            raise AttributeError(name)
        self.data = pin.Data(self.model)
        self.rotation, self.translation = _views(self.data)
        return getattr(self, name)

    def __reduce__(self) -> NoReturn:
        raise TypeError("scratch memory is of one process; pass the chain or the state it belongs to")

    def place(self, q: Configuration) -> FloatArray:
        """Compute placements and Jacobians of all joints.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].

        Returns
        -------
        numpy.ndarray
            (6, nv) spatial velocity at the world origin, in world axes, per tangent velocity: a view of the columns of
            all joints; a body moves by those of the joints below it [m, rad per m or rad].
        """
        # Pinocchio hands a matrix of one column over as a vector.
        return pin.computeJointJacobians(self.model, self.data, q).reshape(6, -1)

    def placed(self, q: Configuration) -> PlacedJoints:
        """Compute placements and Jacobians of all joints, and take them along.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].

        Returns
        -------
        PlacedJoints
            Copies.
        """
        if self._levels is not None:
            return self._levels.placed(q)
        return PlacedJoints(self.place(q).copy("K"), self.rotation.copy("K"), self.translation.copy())

    def place_rates(self, q: Configuration, v: Tangent) -> tuple[FloatArray, FloatArray]:
        """Compute placements, Jacobians of all joints, and their time derivatives along a velocity.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        tuple of numpy.ndarray
            (6, nv) Jacobian as `place`, and its derivative: views [m, rad per m or rad; per s].
        """
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, v)
        return self.data.J.reshape(6, -1), self.data.dJ.reshape(6, -1)


class _Levels:
    """The tree of a model, level by level from the ground: its joints are placed all of a level at once."""

    def __init__(self, model: pin.Model) -> None:
        joints = list(model.joints)[1:]
        self._parents = np.array(list(model.parents))
        depth = np.zeros(model.njoints, dtype=int)
        for k in range(1, model.njoints):
            depth[k] = depth[self._parents[k]] + 1
        self._levels = [np.flatnonzero(depth == level) for level in range(1, depth.max() + 1)]
        self._rotation = np.array([at.rotation for at in model.jointPlacements])
        self._translation = np.array([at.translation for at in model.jointPlacements])
        self._carrier = np.repeat(np.arange(1, model.njoints), [joint.nv for joint in joints])
        self._axes = np.zeros((model.nv, 6))
        single, self._others = [], []
        for k, joint in enumerate(joints, start=1):
            data = joint.createData()
            joint.calc(data, pin.neutral(model))
            self._axes[joint.idx_v : joint.idx_v + joint.nv] = np.reshape(data.S, (6, -1)).T
            if joint.nq == joint.nv == 1:
                single.append((k, joint.idx_q, joint.idx_v))
            else:
                self._others.append((k, joint, data))
        self._single, self._single_q, self._single_v = np.array(single, dtype=int).reshape(-1, 3).T

    def placed(self, q: Configuration) -> PlacedJoints:
        """Place the joints, and write their Jacobians, as Pinocchio does."""
        rotation, translation = (
            np.tile(np.eye(3), (len(self._parents), 1, 1)),
            np.zeros((len(self._parents), 3)),
        )
        # Hinges, slides and screws move along one axis, whose direction stays: about it by q, along it in proportion.
        moved = self._axes[self._single_v] * q[self._single_q, None]
        rotation[self._single] = Rotation.from_rotvec(moved[:, 3:]).as_matrix()
        translation[self._single] = moved[:, :3]
        for k, joint, data in self._others:
            joint.calc(data, q)
            rotation[k], translation[k] = data.M.rotation, data.M.translation
        translation = self._translation + _turned(self._rotation, translation)
        rotation = self._rotation @ rotation
        for level in self._levels:
            below = self._parents[level]
            translation[level] = translation[below] + _turned(rotation[below], translation[level])
            rotation[level] = rotation[below] @ rotation[level]
        carrier = rotation[self._carrier]
        turning = _turned(carrier, self._axes[:, 3:])
        moving = _turned(carrier, self._axes[:, :3]) + np.cross(translation[self._carrier], turning)
        return PlacedJoints(np.hstack([moving, turning]).T, rotation, translation)


def _turned(rotation: FloatArray, vectors: FloatArray) -> FloatArray:
    return (rotation @ vectors[:, :, None])[:, :, 0]


class Pool(Generic[T]):
    """Memory of one chain that nobody uses at the moment; safe for any number of threads.

    Parameters
    ----------
    make
        Makes another one.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._free: deque[T] = deque(maxlen=_POOL)  # append and pop are atomic

    def take(self) -> T:
        """Return one that nobody uses.

        Returns
        -------
        object
            To be given back.
        """
        try:
            return self._free.pop()
        except IndexError:
            return self._make()

    def give(self, memory: T) -> None:
        """Take one back.

        Parameters
        ----------
        memory
            What `take` gave.
        """
        self._free.append(memory)


def _views(data: pin.Data) -> tuple[FloatArray, FloatArray]:
    """Look at ``data.oMi`` as two arrays: reading placements one by one costs microseconds each.

    Pinocchio keeps them in one block of memory, at equal distances; the first, the second and the last one prove it.
    """
    placements, last = data.oMi, len(data.oMi) - 1
    rotation, translation = placements[0].rotation, placements[0].translation

    def address(array: FloatArray) -> int:
        return array.__array_interface__["data"][0]

    stride = address(placements[min(1, last)].rotation) - address(rotation)
    if address(placements[last].rotation) != address(rotation) + last * stride or stride <= 0:
        raise RuntimeError("this build of Pinocchio keeps its placements in an order that is not known here")
    strided = np.lib.stride_tricks.as_strided
    return (
        strided(rotation, (last + 1, 3, 3), (stride, *rotation.strides), writeable=False),
        strided(translation, (last + 1, 3), (stride, *translation.strides), writeable=False),
    )


# ----------------------------------------------------------------------------------------------------
# Quantities that are computed when they are first asked for, and kept
# ----------------------------------------------------------------------------------------------------


class once(Generic[T]):
    """A property that is computed once: `functools.cached_property` without its lock, which costs as much as the sums.

    Arrays are read-only from then on.

    Parameters
    ----------
    compute
        The property.
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self._compute, self._name = compute, compute.__name__
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> once[T]: ...
    @overload
    def __get__(self, instance: object, owner: type[Any]) -> T: ...
    def __get__(self, instance: object | None, owner: type[Any]) -> once[T] | T:
        """Compute the property; from then on the instance's own attribute stands before this one."""
        if instance is None:
            return self
        value = instance.__dict__[self._name] = self._compute(instance)
        if type(value) is ndarray:
            # What is kept is everybody's. ``write`` goes by place: by its name the call takes twice as long.
            value.setflags(False)  # pyright: ignore[reportCallIssue]
        return value
