"""What every motion of a family asks of the motors: amplitudes and frequencies, directions, designs of the robot."""

from __future__ import annotations

import functools
import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from stewart_pin.errors import InputError
from stewart_pin.kernels.choosing import require_choice
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.studies.carried import Carried
from stewart_pin.studies.comparison import Progress
from stewart_pin.studies.demand_study import DemandStudy, motions_in_a_task
from stewart_pin.studies.in_flight import require_portable
from stewart_pin.studies.points import as_points, function_name, require_parameters
from stewart_pin.studies.record import Sweep
from stewart_pin.studies.sweep import sweep_study
from stewart_pin.typing import ArrayLike


def sweep_demand(
    chain: ClosedChain | Callable[..., ClosedChain],
    motion: Callable[..., PlatformSamples],
    axes: Mapping[str, ArrayLike],
    *,
    paired: bool = False,
    kernels: bool | None = None,
    limits: bool = False,
    executor: Executor | None = None,
    journal: str | Path | None = None,
    name: str | None = None,
    progress: Progress | None = None,
    chunk: int | None = None,
    in_flight: int | None = None,
) -> Sweep:
    """Compute what motions ask of the motors, over a grid of their parameters.

    Parameters
    ----------
    chain
        Closed chain; or a function of some of the parameters that builds it, for a sweep over designs.
    motion
        Function of the other parameters that gives the samples of a motion, in equal steps of time, a whole number of
        periods for means. If it has a parameter ``chain`` that is not bound, it is given the chain.
    axes
        Values along each axis, by the name of its parameter: numbers or strings [any unit].
    paired
        Whether the k-th values of all axes belong together: a list of points instead of a grid.
    kernels
        Whether to use compiled kernels; None: where a design has enough states, and can be compiled. Without them each
        motion is computed by `motor_demand`, to the same numbers.
    limits
        Whether each motion is judged by all limits that are stated, of passive joints and joints that close loops too,
        which takes a tenth of a millisecond for every instant at which the motors keep theirs.
    executor, journal
        As in `sweep`.
    name
        What to call the study, which tells its journal from others; default: the names of chain and motion, with a
        digest of a chain that is given.
    progress
        As in `sweep`.
    chunk
        Motions in a task; None: as many as keep a worker busy for some ten milliseconds.
    in_flight
        As in `sweep`.

    Returns
    -------
    Sweep
        For each motor in the order of ``chain.motors``, arrays ``(*shape, nu)``: ``peak_effort`` and ``rms_effort``
        [N or N m]; ``lowest_position``, ``highest_position`` and their difference ``travel`` [m or rad]; ``peak_rate``
        [m/s or rad/s]; ``peak_power``, the largest of abs(effort · rate), and ``mean_power``, its mean: that of a drive
        that gets nothing back when it brakes [W]. Peaks are those of the samples. With `limits`, ``within_limits`` as
        well, ``(*shape,)``: 1 where every limit holds, else 0 [dimensionless].

    Raises
    ------
    InputError
        If a parameter is unknown or missing, the functions give no chain or no samples, or as in `sweep`.
    MissingExtraError
        If kernels are wanted and CasADi is not installed.
    UnsupportedError
        If kernels are wanted and the chain cannot be compiled.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> home, phase = stp.platform_pose(chain, chain.q_home), np.arange(40) / 40
    >>> def shake(amplitude, frequency):
    ...     along_x = {"amplitude": [amplitude, 0, 0], "frequency": [frequency, 0, 0]}
    ...     return stp.motions.sinusoidal_motion(phase / frequency, home=home, **along_x)
    >>> found = stp.sweep_demand(chain, shake, {"amplitude": [0.01, 0.1], "frequency": [1.0, 5.0]})
    >>> found["peak_effort"].max(axis=-1).round()
    array([[  64.,  327.],
           [ 185., 2825.]])
    """
    points = as_points(axes, paired=paired)
    require_choice(kernels)
    of_chain, of_motion = _parameters(chain, motion, list(points.axes))
    groups = points.groups(of_chain) if of_chain else None
    designs = 1 if groups is None else int(groups.max(initial=-1)) + 1
    carried = Carried(_digest(chain), chain) if isinstance(chain, ClosedChain) else chain
    study = DemandStudy(
        carried, motion, of_chain, of_motion, kernels, points.size / max(1, designs), limits=limits
    )
    if not isinstance(chain, ClosedChain):
        require_portable(executor, chain, function_name(chain))
    require_portable(executor, motion, function_name(motion))
    return sweep_study(
        study,
        points,
        name=_name(chain, motion, limits) if name is None else name,
        chunk=motions_in_a_task(study, points) if chunk is None else chunk,
        groups=groups,
        executor=executor,
        journal=journal,
        progress=progress,
        in_flight=in_flight,
    )


def _parameters(
    chain: object, motion: Callable[..., Any], names: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Share the parameters out between the chain and the motion, by what each takes."""
    of_chain: list[str] = []
    if not isinstance(chain, ClosedChain):
        if not callable(chain):
            raise InputError(f"chain must be a ClosedChain or a function that builds one, got {chain!r:.60}")
        of_chain = _taken(chain, names)
        require_parameters(chain, of_chain, what="chain")
    if not callable(motion):
        raise InputError(f"motion must be a function that gives PlatformSamples, got {motion!r:.60}")
    of_motion = _taken(motion, names)
    if (unknown := [name for name in names if name not in (*of_chain, *of_motion)]) or "chain" in names:
        raise InputError(
            f"axis {(unknown or ['chain'])[0]!r} is no parameter of the motion {function_name(motion)}"
            f"{_signature(motion)}" + (" or of the chain" if callable(chain) else "")
        )
    bound = motion.keywords if isinstance(motion, functools.partial) else {}
    if "chain" in _signature(motion).parameters and "chain" not in bound:
        of_motion.append("chain")
    require_parameters(motion, of_motion, what="motion")
    return tuple(of_chain), tuple(of_motion)


def _taken(function: Callable[..., Any], names: Sequence[str]) -> list[str]:
    parameters = _signature(function).parameters.values()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return list(names)
    known = {parameter.name for parameter in parameters}
    return [name for name in names if name in known]


def _signature(function: Callable[..., Any]) -> inspect.Signature:
    try:
        return inspect.signature(function)
    except (TypeError, ValueError):  # some functions written in C do not say what they take
        return inspect.Signature([inspect.Parameter("any", inspect.Parameter.VAR_KEYWORD)])


def _name(chain: ClosedChain | Callable[..., ClosedChain], motion: Callable[..., Any], limits: bool) -> str:
    given = isinstance(chain, ClosedChain)
    robot = f"{chain.name} (digest {_digest(chain)[:8]})" if given else function_name(chain)
    return f"motor demand of {robot} under {function_name(motion)}" + (" within limits" if limits else "")


def _digest(chain: ClosedChain) -> str:
    """Tell chains apart by all that their dynamics depend on."""
    loops = [
        (
            loop.kind,
            loop.link1,
            loop.link2,
            loop.placement1.homogeneous.tolist(),
            loop.placement2.homogeneous.tolist(),
            loop.axis.tolist(),
            loop.axis2.tolist(),
            loop.length,
            loop.bounds,
        )
        for loop in chain.loops
    ]
    couplings = [(one.joint1, one.joint2, one.polynomial) for one in chain.couplings]
    roles = (chain.motors, chain.platform, chain.q_home.tolist())
    # Of the limits, the text of the model does not have these.
    further = [chain.limits.of(kind).tolist() for kind in ("acceleration", "jerk")]
    text = chain.model.saveToString() + repr((loops, couplings, roles, further))
    return hashlib.sha256(text.encode()).hexdigest()
