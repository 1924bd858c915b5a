"""Exceptions that carry the numbers behind them, so that a caller can act and a reader can understand.

Every exception of the package derives from `StewartPinError`; its text names the culprit (file, joint or
argument), the offending value, and the remedy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


class StewartPinError(Exception):
    """Base of all exceptions that the package raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Exceptions are unpickled by calling the class with `args`, which lacks the keywords of the subclasses; an
        # error in a worker process would break its pool.
        return _restore, (type(self), self.args, self.__dict__)


def _restore(kind: type[StewartPinError], args: tuple[Any, ...], state: dict[str, Any]) -> StewartPinError:
    builtin = FileNotFoundError if issubclass(kind, FileNotFoundError) else Exception
    error = builtin.__new__(kind)
    error.args = args
    error.__dict__.update(state)
    return error


class InputError(StewartPinError, ValueError):
    """An argument has the wrong shape, type or value."""


class FileFormatError(StewartPinError, ValueError):
    """A file cannot be read as what it claims to be, or says something that cannot be honoured.

    Attributes
    ----------
    path
        The file.
    culprit
        The tag, link or joint at fault.
    """

    def __init__(self, message: str, *, path: str = "", culprit: str = "") -> None:
        super().__init__(f"{path}: {message}" if path else message)
        self.path = path
        self.culprit = culprit


class FileMissingError(FileFormatError, FileNotFoundError):
    """A file or a bundled robot does not exist."""


class MechanismError(FileFormatError):
    """The description is well-formed but no mechanism: unphysical masses, broken tree, open loops."""


class UnsupportedError(StewartPinError, NotImplementedError):
    """The request is meaningful, but not for this kind of mechanism."""


class MissingRoleError(InputError):
    """A chain has no platform, or no motors, and what was asked for needs them.

    Attributes
    ----------
    missing
        ``"platform"`` or ``"motors"``.
    candidates
        Links, or joints, that could be it; best guess first.
    """

    def __init__(self, message: str, *, missing: str, candidates: Sequence[str]) -> None:
        super().__init__(message)
        self.missing = missing
        self.candidates = tuple(candidates)


class ClosureError(StewartPinError):
    """The loops could not be closed, or the pose could not be reached.

    Attributes
    ----------
    residual
        Norm of the residual reached [m, rad].
    iterations
        Newton steps taken.
    q
        Configuration reached [m, rad].
    sample
        Which sample of a motion could not be followed [index]; None: there is no motion.
    """

    def __init__(self, message: str, *, residual: float, iterations: int, q: np.ndarray) -> None:
        super().__init__(message)
        self.residual = residual
        self.iterations = iterations
        self.q = q
        self.sample: int | None = None


class UnreachableError(ClosureError):
    """A pose asks for joint values outside their limits.

    Attributes
    ----------
    violations
        ``{joint: (value, lower, upper)}`` [m or rad].
    """

    def __init__(
        self, message: str, *, violations: dict[str, tuple[float, float, float]], **reached: Any
    ) -> None:
        super().__init__(message, **reached)
        self.violations = violations


class SingularityError(StewartPinError):
    """The matrix to be inverted is singular at this configuration.

    Attributes
    ----------
    smallest_singular_value
        Of the matrix named in the message.
    direction
        The motion that is lost or gained, as a dimensionless vector over `names`.
    names
        Names of the entries of `direction`.
    """

    def __init__(
        self,
        message: str,
        *,
        smallest_singular_value: float,
        direction: np.ndarray | None = None,
        names: Sequence[str] = (),
    ) -> None:
        super().__init__(message)
        self.smallest_singular_value = smallest_singular_value
        self.direction = direction
        self.names = tuple(names)


class ActuationError(SingularityError):
    """The motors cannot hold the robot: a freedom is left over.

    `direction` is that freedom as tangent-space components over the joints in `names`.
    """


class ConvergenceError(StewartPinError):
    """A numerical solver stopped before its tolerance.

    Attributes
    ----------
    residual
        What was reached.
    """

    def __init__(self, message: str, *, residual: float) -> None:
        super().__init__(message)
        self.residual = residual


class EffortLimitError(ConvergenceError):
    """No motor efforts within their limits carry a load.

    Attributes
    ----------
    residual
        Effort of some motion that is left over [N m].
    violations
        ``{motor: (value, least, greatest)}`` of the motors in the way, passing their limits as little as can be [N or
        N m].
    sample
        At which sample of a motion [index]; None: there is no motion.
    """

    def __init__(
        self, message: str, *, residual: float, violations: dict[str, tuple[float, float, float]]
    ) -> None:
        super().__init__(message, residual=residual)
        self.violations = violations
        self.sample: int | None = None

    def at(self, time: float, sample: int) -> EffortLimitError:
        """Tell the same of an instant of a motion.

        Parameters
        ----------
        time
            When [s].
        sample
            Number of the instant [index].

        Returns
        -------
        EffortLimitError
            With the same numbers.
        """
        words = f"at {time:.6g} s, instant {sample}: {self}"
        there = EffortLimitError(words, residual=self.residual, violations=self.violations)
        there.sample = sample
        return there


class MissingExtraError(StewartPinError, ImportError):
    """An optional dependency is not installed.

    Attributes
    ----------
    package
        The package that is missing.
    extra
        The extra of this package that installs it.
    """

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"this needs the package {package!r}, which is not installed: pip install 'stewart_pin[{extra}]'"
        )
        self.package = package
        self.extra = extra
