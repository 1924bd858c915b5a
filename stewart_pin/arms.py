"""Serial arms without loops: reach, branches, velocities."""

from stewart_pin.geometry.serial import ArmBranches as ArmBranches
from stewart_pin.geometry.serial import ArmReach as ArmReach
from stewart_pin.geometry.serial import LinkVelocities as LinkVelocities
from stewart_pin.geometry.serial import planar_arm_branches as planar_arm_branches
from stewart_pin.geometry.serial import planar_arm_pose as planar_arm_pose
from stewart_pin.geometry.serial import spatial_arm_jacobian as spatial_arm_jacobian
from stewart_pin.geometry.serial import spatial_arm_velocities as spatial_arm_velocities
