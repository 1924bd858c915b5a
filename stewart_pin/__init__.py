"""Closed-chain (parallel-robot) dynamics on Pinocchio.

``import stewart_pin as stp`` gives the verbs; a robot with loops is a `ClosedChain`, read by `load`.
"""

from stewart_pin.geometry.hexapod import Hexapod as Hexapod
from stewart_pin.geometry.hexapod import leg_jacobian as leg_jacobian
from stewart_pin.geometry.hexapod import leg_lengths as leg_lengths
from stewart_pin.geometry.hexapod import point_mass_forces as point_mass_forces
from stewart_pin.geometry.hexapod_bodies import HexapodBodies as HexapodBodies
from stewart_pin.geometry.hexapod_bodies import RigidBody as RigidBody
from stewart_pin.geometry.hexapod_dynamics import HexapodForces as HexapodForces
from stewart_pin.geometry.hexapod_dynamics import hexapod_inverse_dynamics as hexapod_inverse_dynamics
from stewart_pin.geometry.leg_motion import leg_accelerations as leg_accelerations
from stewart_pin.geometry.leg_motion import leg_rates as leg_rates

__version__ = "0.1.0"
