"""Controllers for a simulation."""

from stewart_pin.motion.control import ComputedTorque as ComputedTorque
from stewart_pin.motion.control import Feedforward as Feedforward
from stewart_pin.motion.control import GravityCompensation as GravityCompensation
from stewart_pin.motion.control import LegPID as LegPID
from stewart_pin.motion.control import SampledController as SampledController
