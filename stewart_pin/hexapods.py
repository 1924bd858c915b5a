"""Platforms on six legs: designs, rates, bodies, poses from lengths, assembly modes."""

from stewart_pin.analysis.assembly_modes import AssemblyModes as AssemblyModes
from stewart_pin.analysis.assembly_modes import ModeDescription as ModeDescription
from stewart_pin.analysis.assembly_modes import describe_modes as describe_modes
from stewart_pin.building.hexapod_bodies import hexapod_bodies as hexapod_bodies
from stewart_pin.building.hexapod_bodies import hexapod_inertias as hexapod_inertias
from stewart_pin.geometry.hexapod import cubic_hexapod as cubic_hexapod
from stewart_pin.geometry.hexapod import hexapod_6_3 as hexapod_6_3
from stewart_pin.geometry.hexapod import semi_regular_hexapod as semi_regular_hexapod
from stewart_pin.geometry.hexapod_dynamics import HexapodBodies as HexapodBodies
from stewart_pin.geometry.hexapod_dynamics import HexapodForces as HexapodForces
from stewart_pin.geometry.hexapod_dynamics import RigidBody as RigidBody
from stewart_pin.geometry.hexapod_dynamics import hexapod_inverse_dynamics as hexapod_inverse_dynamics
from stewart_pin.geometry.hexapod_pose import HexapodPose as HexapodPose
from stewart_pin.geometry.hexapod_pose import TrackedPose as TrackedPose
from stewart_pin.geometry.hexapod_pose import track_pose as track_pose
from stewart_pin.geometry.leg_motion import leg_accelerations as leg_accelerations
from stewart_pin.geometry.leg_motion import leg_rates as leg_rates
