"""Records of a simulation, its events and its end."""

from stewart_pin.motion.simulation.events import Event as Event
from stewart_pin.motion.simulation.motors import Motors as Motors
from stewart_pin.motion.simulation.record import EnergyAudit as EnergyAudit
from stewart_pin.motion.simulation.record import Simulation as Simulation
from stewart_pin.motion.simulation.record import SimulationInterrupted as SimulationInterrupted
from stewart_pin.motion.simulation.record import SimulationState as SimulationState
from stewart_pin.motion.simulation.simulate import resume as resume
