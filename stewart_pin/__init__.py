"""Closed-chain (parallel-robot) dynamics on Pinocchio.

``import stewart_pin as stp`` gives the verbs; a robot with loops is a `ClosedChain`, read by `load`.
"""

from stewart_pin import errors as errors
from stewart_pin import viz as viz
from stewart_pin.analysis.assembly_modes import AssemblyModes as AssemblyModes
from stewart_pin.analysis.assembly_modes import AssemblySolver as AssemblySolver
from stewart_pin.analysis.assembly_modes import ModeDescription as ModeDescription
from stewart_pin.analysis.assembly_modes import assembly_modes as assembly_modes
from stewart_pin.analysis.assembly_modes import describe_modes as describe_modes
from stewart_pin.analysis.closed_paths import closed_path as closed_path
from stewart_pin.analysis.singularities import SingularityOnPath as SingularityOnPath
from stewart_pin.analysis.singularities import find_singularity as find_singularity
from stewart_pin.analysis.singularity_map import SingularityMap as SingularityMap
from stewart_pin.analysis.singularity_map import singularity_map as singularity_map
from stewart_pin.analysis.workspace import WorkspaceSamples as WorkspaceSamples
from stewart_pin.analysis.workspace import sample_workspace as sample_workspace
from stewart_pin.building.displacing import displace_geometry as displace_geometry
from stewart_pin.building.exporting import export as export
from stewart_pin.building.exporting import write_urdf as write_urdf
from stewart_pin.building.floating_base import on_floating_base as on_floating_base
from stewart_pin.building.from_hexapod import hexapod_chain as hexapod_chain
from stewart_pin.building.hexapod_bodies import hexapod_bodies as hexapod_bodies
from stewart_pin.building.hexapod_inertias import hexapod_inertias as hexapod_inertias
from stewart_pin.building.hexapod_table import read_hexapod as read_hexapod
from stewart_pin.building.limits import with_limits as with_limits
from stewart_pin.building.loading import load as load
from stewart_pin.building.locking import lock_joints as lock_joints
from stewart_pin.building.loops_by_balls import loops_by_balls as loops_by_balls
from stewart_pin.building.planar_legs import planar_rpr as planar_rpr
from stewart_pin.building.resources import robots as robots
from stewart_pin.building.roles import with_motors as with_motors
from stewart_pin.building.roles import with_platform as with_platform
from stewart_pin.building.rotary_legs import rotary_legs as rotary_legs
from stewart_pin.building.variants import attach_payload as attach_payload
from stewart_pin.building.variants import massless_legs as massless_legs
from stewart_pin.building.variants import replace_inertias as replace_inertias
from stewart_pin.geometry.delta import DeltaPositions as DeltaPositions
from stewart_pin.geometry.delta import delta_legs as delta_legs
from stewart_pin.geometry.delta import delta_positions as delta_positions
from stewart_pin.geometry.hexapod import Hexapod as Hexapod
from stewart_pin.geometry.hexapod import leg_jacobian as leg_jacobian
from stewart_pin.geometry.hexapod import leg_lengths as leg_lengths
from stewart_pin.geometry.hexapod import point_mass_forces as point_mass_forces
from stewart_pin.geometry.hexapod_bodies import HexapodBodies as HexapodBodies
from stewart_pin.geometry.hexapod_bodies import RigidBody as RigidBody
from stewart_pin.geometry.hexapod_designs import cubic_hexapod as cubic_hexapod
from stewart_pin.geometry.hexapod_designs import hexapod_6_3 as hexapod_6_3
from stewart_pin.geometry.hexapod_designs import semi_regular_hexapod as semi_regular_hexapod
from stewart_pin.geometry.hexapod_dynamics import HexapodForces as HexapodForces
from stewart_pin.geometry.hexapod_dynamics import hexapod_inverse_dynamics as hexapod_inverse_dynamics
from stewart_pin.geometry.hexapod_pose import HexapodPose as HexapodPose
from stewart_pin.geometry.hexapod_pose import hexapod_pose as hexapod_pose
from stewart_pin.geometry.leg_motion import leg_accelerations as leg_accelerations
from stewart_pin.geometry.leg_motion import leg_rates as leg_rates
from stewart_pin.geometry.planar import PlanarRPR as PlanarRPR
from stewart_pin.geometry.planar import planar_leg_jacobian as planar_leg_jacobian
from stewart_pin.geometry.planar import planar_leg_lengths as planar_leg_lengths
from stewart_pin.geometry.planar_modes import PlanarModes as PlanarModes
from stewart_pin.geometry.planar_modes import PlanarModesBatch as PlanarModesBatch
from stewart_pin.geometry.planar_modes import planar_assembly_modes as planar_assembly_modes
from stewart_pin.geometry.planar_modes import planar_assembly_modes_batch as planar_assembly_modes_batch
from stewart_pin.geometry.planar_polynomial import planar_pose_polynomial as planar_pose_polynomial
from stewart_pin.geometry.planar_transitions import PlanarTransitions as PlanarTransitions
from stewart_pin.geometry.planar_transitions import planar_transition_lengths as planar_transition_lengths
from stewart_pin.geometry.pose_tracking import TrackedPose as TrackedPose
from stewart_pin.geometry.pose_tracking import track_pose as track_pose
from stewart_pin.geometry.rotary import CrankAngles as CrankAngles
from stewart_pin.geometry.rotary import RotaryLegs as RotaryLegs
from stewart_pin.geometry.rotary import crank_angles as crank_angles
from stewart_pin.geometry.rotary import crank_jacobian as crank_jacobian
from stewart_pin.geometry.serial import ArmBranches as ArmBranches
from stewart_pin.geometry.serial import ArmReach as ArmReach
from stewart_pin.geometry.serial import planar_arm_branches as planar_arm_branches
from stewart_pin.geometry.serial import planar_arm_configurations as planar_arm_configurations
from stewart_pin.geometry.serial import planar_arm_pose as planar_arm_pose
from stewart_pin.geometry.serial_velocities import LinkVelocities as LinkVelocities
from stewart_pin.geometry.serial_velocities import spatial_arm_jacobian as spatial_arm_jacobian
from stewart_pin.geometry.serial_velocities import spatial_arm_velocities as spatial_arm_velocities
from stewart_pin.kernels.compile import compile_kernels as compile_kernels
from stewart_pin.kernels.compile_function import compile_function as compile_function
from stewart_pin.kernels.kernels import Kernels as Kernels
from stewart_pin.kernels.programs.repeating import Repeat as Repeat
from stewart_pin.kernels.programs.status import StateBound as StateBound
from stewart_pin.kernels.programs.status import StateStatus as StateStatus
from stewart_pin.kernels.report import KernelReport as KernelReport
from stewart_pin.kernels.report import PlanBlock as PlanBlock
from stewart_pin.kernels.running.array_kernel import ArrayKernel as ArrayKernel
from stewart_pin.kernels.running.single_state import SingleState as SingleState
from stewart_pin.mechanics.articulated_body.base_motion import BaseMotion as BaseMotion
from stewart_pin.mechanics.articulated_body.loops import (
    closed_chain_articulated_body as closed_chain_articulated_body,
)
from stewart_pin.mechanics.articulated_body.trees import (
    articulated_body_acceleration as articulated_body_acceleration,
)
from stewart_pin.mechanics.capability.hexapod_limits import load_limit as load_limit
from stewart_pin.mechanics.capability.hexapod_limits import velocity_limits as velocity_limits
from stewart_pin.mechanics.capability.hexapod_limits import (
    velocity_limits_of_jacobian as velocity_limits_of_jacobian,
)
from stewart_pin.mechanics.capability.polytope import Ball as Ball
from stewart_pin.mechanics.capability.polytope import Polytope as Polytope
from stewart_pin.mechanics.capability.polytope import inscribed_ball as inscribed_ball
from stewart_pin.mechanics.capability.polytope import polytope_contains as polytope_contains
from stewart_pin.mechanics.capability.polytope import polytope_limit as polytope_limit
from stewart_pin.mechanics.capability.polytope import polytope_projection as polytope_projection
from stewart_pin.mechanics.capability.polytope import polytope_reach as polytope_reach
from stewart_pin.mechanics.capability.polytope import polytope_section as polytope_section
from stewart_pin.mechanics.capability.polytope import polytope_support as polytope_support
from stewart_pin.mechanics.capability.velocity import velocity_polytope as velocity_polytope
from stewart_pin.mechanics.capability.wrench import wrench_polytope as wrench_polytope
from stewart_pin.mechanics.closed_forms import Admission as Admission
from stewart_pin.mechanics.closed_forms import closed_forms as closed_forms
from stewart_pin.mechanics.constraint_matrix.system import ConstraintMatrixSystem as ConstraintMatrixSystem
from stewart_pin.mechanics.constraint_matrix.system import (
    constraint_matrix_system as constraint_matrix_system,
)
from stewart_pin.mechanics.coordinates import Coordinates as Coordinates
from stewart_pin.mechanics.effort import Effort as Effort
from stewart_pin.mechanics.effort import Motion as Motion
from stewart_pin.mechanics.forward_dynamics import forward_dynamics as forward_dynamics
from stewart_pin.mechanics.forward_solutions import ForwardSolutions as ForwardSolutions
from stewart_pin.mechanics.forward_solutions import all_forward_kinematics as all_forward_kinematics
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics as inverse_dynamics
from stewart_pin.mechanics.joint_motor_map import JointMotorMap as JointMotorMap
from stewart_pin.mechanics.joint_motor_map import joint_motor_map as joint_motor_map
from stewart_pin.mechanics.kinematics import forward_kinematics as forward_kinematics
from stewart_pin.mechanics.kinematics import inverse_kinematics as inverse_kinematics
from stewart_pin.mechanics.kinematics import motor_jacobian as motor_jacobian
from stewart_pin.mechanics.kinematics import motor_positions as motor_positions
from stewart_pin.mechanics.kinematics import platform_motion as platform_motion
from stewart_pin.mechanics.kinematics import platform_pose as platform_pose
from stewart_pin.mechanics.linearisation.derivatives import EffortDerivatives as EffortDerivatives
from stewart_pin.mechanics.linearisation.derivatives import MotionDerivatives as MotionDerivatives
from stewart_pin.mechanics.linearisation.derivatives import (
    forward_dynamics_derivatives as forward_dynamics_derivatives,
)
from stewart_pin.mechanics.linearisation.derivatives import (
    inverse_dynamics_derivatives as inverse_dynamics_derivatives,
)
from stewart_pin.mechanics.linearisation.equilibrium import LinearSystem as LinearSystem
from stewart_pin.mechanics.linearisation.equilibrium import linearise as linearise
from stewart_pin.mechanics.linearisation.vibration import Vibration as Vibration
from stewart_pin.mechanics.linearisation.vibration import natural_frequencies as natural_frequencies
from stewart_pin.mechanics.linearisation.vibration import platform_stiffness as platform_stiffness
from stewart_pin.mechanics.mobility import Mobility as Mobility
from stewart_pin.mechanics.mobility import mobility as mobility
from stewart_pin.mechanics.motion_map import MotionMap as MotionMap
from stewart_pin.mechanics.motion_map import motion_map as motion_map
from stewart_pin.mechanics.operational_dynamics import OperationalDynamics as OperationalDynamics
from stewart_pin.mechanics.operational_dynamics import operational_dynamics as operational_dynamics
from stewart_pin.mechanics.reactions import Reaction as Reaction
from stewart_pin.mechanics.reactions import joint_reactions as joint_reactions
from stewart_pin.mechanics.singularity import Screw as Screw
from stewart_pin.mechanics.singularity import Singularity as Singularity
from stewart_pin.mechanics.singularity import SingularityKind as SingularityKind
from stewart_pin.mechanics.singularity import classify_singularity as classify_singularity
from stewart_pin.model.limits import Limits as Limits
from stewart_pin.motion.accelerograms import Accelerogram as Accelerogram
from stewart_pin.motion.accelerograms import accelerogram as accelerogram
from stewart_pin.motion.accelerograms import correct_baseline as correct_baseline
from stewart_pin.motion.accelerograms import read_at2 as read_at2
from stewart_pin.motion.accelerograms import read_columns as read_columns
from stewart_pin.motion.control import ComputedTorque as ComputedTorque
from stewart_pin.motion.control import Feedforward as Feedforward
from stewart_pin.motion.control import GravityCompensation as GravityCompensation
from stewart_pin.motion.control import LegPID as LegPID
from stewart_pin.motion.control import SampledController as SampledController
from stewart_pin.motion.earthquakes import earthquake_motion as earthquake_motion
from stewart_pin.motion.earthquakes import response_spectrum as response_spectrum
from stewart_pin.motion.earthquakes import synthetic_accelerogram as synthetic_accelerogram
from stewart_pin.motion.limits import limits_exceeded as limits_exceeded
from stewart_pin.motion.motor_demand import MotorDemand as MotorDemand
from stewart_pin.motion.motor_demand import motor_demand as motor_demand
from stewart_pin.motion.profiles import chirp_motion as chirp_motion
from stewart_pin.motion.profiles import minimum_jerk_motion as minimum_jerk_motion
from stewart_pin.motion.profiles import spline_motion as spline_motion
from stewart_pin.motion.shake_table import FitReport as FitReport
from stewart_pin.motion.shake_table import fit_to_limits as fit_to_limits
from stewart_pin.motion.simulation.events import Event as Event
from stewart_pin.motion.simulation.motors import Motors as Motors
from stewart_pin.motion.simulation.record import Simulation as Simulation
from stewart_pin.motion.simulation.record import SimulationInterrupted as SimulationInterrupted
from stewart_pin.motion.simulation.record import SimulationState as SimulationState
from stewart_pin.motion.simulation.simulate import resume as resume
from stewart_pin.motion.simulation.simulate import simulate as simulate
from stewart_pin.motion.trajectories import PlatformSamples as PlatformSamples
from stewart_pin.motion.trajectories import sample_times as sample_times
from stewart_pin.motion.trajectories import sinusoidal_motion as sinusoidal_motion
from stewart_pin.state.chain import ClosedChain as ClosedChain
from stewart_pin.state.freedom import FreedomCount as FreedomCount
from stewart_pin.state.generic import generic_freedom as generic_freedom
from stewart_pin.state.geometry_parameters import GeometryParameter as GeometryParameter
from stewart_pin.state.geometry_parameters import geometry_parameters as geometry_parameters
from stewart_pin.state.limits import Excess as Excess
from stewart_pin.state.loop_verbs import loop_bias as loop_bias
from stewart_pin.state.loop_verbs import loop_gap as loop_gap
from stewart_pin.state.loop_verbs import loop_jacobian as loop_jacobian
from stewart_pin.state.loop_verbs import loop_jacobian_rate as loop_jacobian_rate
from stewart_pin.state.newton import Closure as Closure
from stewart_pin.state.newton import close_loops as close_loops
from stewart_pin.state.pinocchio_constraints import constraint_models as constraint_models
from stewart_pin.state.state import State as State
from stewart_pin.studies.comparison import Comparison as Comparison
from stewart_pin.studies.comparison import compare_methods as compare_methods
from stewart_pin.studies.demand_sweep import sweep_demand as sweep_demand
from stewart_pin.studies.record import FailedPoint as FailedPoint
from stewart_pin.studies.record import Sweep as Sweep
from stewart_pin.studies.sweep import sweep as sweep

__version__ = "0.1.0"
