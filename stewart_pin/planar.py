"""Planar platforms on three legs (3-RPR) in closed form."""

from stewart_pin.building.legs import planar_rpr as planar_rpr
from stewart_pin.geometry.planar import planar_leg_jacobian as planar_leg_jacobian
from stewart_pin.geometry.planar import planar_leg_lengths as planar_leg_lengths
from stewart_pin.geometry.planar_modes import PlanarModes as PlanarModes
from stewart_pin.geometry.planar_modes import PlanarModesBatch as PlanarModesBatch
from stewart_pin.geometry.planar_modes import planar_assembly_modes_batch as planar_assembly_modes_batch
from stewart_pin.geometry.planar_polynomial import planar_pose_polynomial as planar_pose_polynomial
from stewart_pin.geometry.planar_transitions import PlanarTransitions as PlanarTransitions
from stewart_pin.geometry.planar_transitions import planar_transition_lengths as planar_transition_lengths
