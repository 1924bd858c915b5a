"""Platforms on legs with cranks: delta robots and rotary hexapods in closed form."""

from stewart_pin.building.legs import rotary_legs as rotary_legs
from stewart_pin.geometry.rotary import CrankAngles as CrankAngles
from stewart_pin.geometry.rotary import DeltaPositions as DeltaPositions
from stewart_pin.geometry.rotary import RotaryLegs as RotaryLegs
from stewart_pin.geometry.rotary import crank_angles as crank_angles
from stewart_pin.geometry.rotary import crank_jacobian as crank_jacobian
from stewart_pin.geometry.rotary import delta_legs as delta_legs
from stewart_pin.geometry.rotary import delta_positions as delta_positions
