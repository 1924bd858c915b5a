"""The energy account of a run, which tells when a step is too large for the motion."""

from __future__ import annotations

from stewart_pin.tolerances import EPS

SHARE = 0.01
"""Energy that may be missing, as a share of what the motion has exchanged: half of it is the error of a speed, which a
reader of a plot begins to see. The methods lose less than a hundredth of it with a step that resolves the motion."""
_DOUBT = 0.05
"""Largest share by which the work's own quadrature may excuse a difference at the end of a run: with more, the step
does not resolve the work. A transient at its start may be a little coarse, while little is exchanged."""
_STILL = EPS**0.5
"""Share of the weight times the size of a robot below which a difference is round-off: half of the digits."""


class EnergyAccount:
    """What energy there is, what was supplied and what became heat, compared since the first start.

    Parameters
    ----------
    floor
        Weight times size of the robot [J].
    start
        Energy less work plus heat at the start, lowest and highest potential energy, largest kinetic energy since, as
        `memory` gave them [J]; None at a first start.
    """

    def __init__(self, floor: float, start: tuple[float, float, float, float] | None = None) -> None:
        self._floor, self.memory = _STILL * floor, start

    def off(
        self, kinetic: float, potential: float, supplied: float, heat: float, doubt: float, last: bool
    ) -> tuple[float, float]:
        """Compare the account with its start.

        Parameters
        ----------
        kinetic, potential
            Energies now, springs with the latter [J].
        supplied, heat
            Work and heat since the first start [J].
        doubt
            Estimated error of their quadrature [J].
        last
            Whether the run ends here.

        Returns
        -------
        error : float
            Energy gained from nowhere, or lost, where it is more than the account allows; else zero [J].
        scale : float
            Energy that the motion has exchanged or held in motion [J].
        """
        balance = kinetic + potential - supplied + heat
        if self.memory is None:
            self.memory = (balance, potential, potential, kinetic)
        first, lowest, highest, fastest = self.memory
        lowest, highest, fastest = min(lowest, potential), max(highest, potential), max(fastest, kinetic)
        self.memory = (first, lowest, highest, fastest)
        scale = max(fastest, highest - lowest, abs(supplied), heat)
        error = balance - first
        allowed = (
            SHARE * scale
            + (min(doubt, _DOUBT * scale) if last else doubt)
            + self._floor
            + 64 * EPS * abs(potential)
        )
        return (0.0 if abs(error) <= allowed else error), scale
