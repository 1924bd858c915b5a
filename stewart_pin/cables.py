"""Robots on cables."""

from stewart_pin.building.cables import cable_lengths as cable_lengths
from stewart_pin.building.cables import cable_robot as cable_robot
