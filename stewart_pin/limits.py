"""What joints and motors may do, and what goes beyond it."""

from stewart_pin.mechanics.capability.limits import (
    velocity_limits_of_jacobian as velocity_limits_of_jacobian,
)
from stewart_pin.model.tree import Limits as Limits
from stewart_pin.state.limits import Excess as Excess
