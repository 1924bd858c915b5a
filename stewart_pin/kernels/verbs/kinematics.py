"""Positions, rates and conditioning of arrays of states."""

from __future__ import annotations

from functools import partial

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.kernels.verbs.calling import Caller, Places
from stewart_pin.kernels.verbs.configurations import as_poses, as_rows, lost_on_the_way, normalised
from stewart_pin.kernels.verbs.newton import solve_on_branch, straight
from stewart_pin.programs.arrays import require_out
from stewart_pin.typing import ArrayLike, FloatArray


class KinematicsVerbs(Caller):
    """Verbs of position and rate."""

    def inverse_kinematics(
        self,
        pose: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the motor positions of poses.

        Parameters
        ----------
        pose
            (N, 7) position and unit quaternion x y z w of the platform frame [m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu) in the order of ``chain.motors``, on the branch of home; joint limits are not looked at [m or rad].
        """
        self._require_platform("inverse_kinematics")
        if self._functions.placed is not None:
            if conditioning is not None:
                self._grade(self._states(pose)[0], conditioning, threads)
            return self._call("inverse_kinematics", (pose,), Places(out, status, None, threads))
        states, single = self._states(pose)
        solved = self._configurations(states, threads)
        self._grade(solved.states, conditioning, threads)
        found = self._given(solved, (solved.states[:, self.chain.motor_q_index],), status, single=single)
        return _copied(found, out)

    def forward_kinematics(
        self,
        q_motor: ArrayLike,
        pose_guess: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Find the poses of motor positions, by Newton steps from guesses.

        Parameters
        ----------
        q_motor
            (N, nu) in the order of ``chain.motors`` [m or rad].
        pose_guess
            (N, 7) or (7,) poses to start from, which choose the assembly mode; quaternions of other lengths become
            unit ones on the way [m, unit quaternion].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, 7) position and unit quaternion x y z w of the platform frame [m]; nan where no pose was found.
        """
        self._require_platform("forward_kinematics")
        target, single = as_rows("q_motor", q_motor, self.chain.nu)
        guess = as_rows("pose_guess", pose_guess, 7)[0]
        if len(guess) not in (1, len(target)):
            raise InputError(f"there are {len(guess)} guesses for {len(target)} motor positions")
        if self._functions.placed is not None:
            plans, begin = self._plans("forward_kinematics"), partial(self._beginning, guess, target)
            room = None if single else out
            start = guess[0] if len(guess) == 1 else guess
            solved = solve_on_branch(plans, start, begin, target, straight, out=room, threads=threads)
            found = self._given(solved, (solved.states,), status, single=single)
            self._grade(solved.states, conditioning, threads)
            return found if room is not None else _copied(found, out)
        begun = self._configurations(normalised(np.broadcast_to(guess, (len(target), 7))), threads)
        states, motors = begun.states, self.chain.motor_q_index
        solved = solve_on_branch(
            self._plans("motor_closing"),
            states,
            lambda rows: (states[rows], states[np.ix_(rows, motors)]),
            target,
            straight,
            threads=threads,
        )
        self._grade(solved.states, conditioning, threads)
        position, rotation = self._kernel("platform_pose")(solved.states, threads=threads)
        return _copied(self._given(solved, (as_poses(position, rotation),), status, single=single), out)

    def motor_jacobian(
        self,
        pose: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Map twists of the platform to motor rates.

        Parameters
        ----------
        pose
            (N, 7) position and unit quaternion x y z w of the platform frame [m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu, 6) motor rates per twist in world axes [m/s or rad/s per m/s or rad/s]; for a platform with fewer
            than six freedoms it holds for the twists that it can do.
        """
        self._require_platform("motor_jacobian")
        return self._call("motor_jacobian", (pose,), Places(out, status, conditioning, threads))

    def conditioning(
        self,
        pose: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Tell how near states are to a singularity, by the smallest pivot that the kernels divide by.

        Parameters
        ----------
        pose
            Position in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions].
        out, status, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N,) each pivot relative to its median over samples around home, dimensionless: near one where the robot
            is as regular as there, near zero at a singularity, where efforts or accelerations lose their digits.
        """
        room = None if out is None or np.ndim(out) != 1 else out[:, None]
        found = self._call("conditioning", (pose,), Places(room, status, None, threads))[..., 0]
        if not self._takes_state(self._kernel("conditioning")):
            lost_on_the_way(found)
        return found

    def _beginning(
        self, guess: FloatArray, target: FloatArray, rows: np.ndarray
    ) -> tuple[FloatArray, FloatArray]:
        """Guesses with motor positions, the turns of those that turn counted as targets count them."""
        poses = normalised(np.broadcast_to(guess, (len(target), 7))[rows])
        own, turns = self._kernel("inverse_kinematics")(poses), self._functions.turning
        return poses, own + np.where(turns, 2 * np.pi * np.round((target[rows] - own) / (2 * np.pi)), 0.0)

    def _grade(self, states: FloatArray, conditioning: FloatArray | None, threads: int) -> None:
        """Write the conditioning of poses or configurations."""
        if conditioning is not None:
            require_out("conditioning", conditioning, (len(states),), self._dtype)
            self._kernel("conditioning")(states, out=conditioning[:, None], threads=threads)


def _copied(found: FloatArray, out: FloatArray | None) -> FloatArray:
    if out is None:
        return found
    require_out("out", out, found.shape, found.dtype)
    out[...] = found
    return out
