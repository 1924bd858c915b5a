"""Dynamics of one state beyond efforts: maps, derivatives, vibrations, reactions, articulated bodies."""

from stewart_pin.mechanics.articulated_body.loops import (
    closed_chain_articulated_body as closed_chain_articulated_body,
)
from stewart_pin.mechanics.closed_forms import Admission as Admission
from stewart_pin.mechanics.closed_forms import closed_forms as closed_forms
from stewart_pin.mechanics.constraint_matrix.system import ConstraintMatrixSystem as ConstraintMatrixSystem
from stewart_pin.mechanics.coordinates import Coordinates as Coordinates
from stewart_pin.mechanics.coordinates import JointMotorMap as JointMotorMap
from stewart_pin.mechanics.coordinates import joint_motor_map as joint_motor_map
from stewart_pin.mechanics.derivatives import EffortDerivatives as EffortDerivatives
from stewart_pin.mechanics.derivatives import MotionDerivatives as MotionDerivatives
from stewart_pin.mechanics.derivatives import (
    forward_dynamics_derivatives as forward_dynamics_derivatives,
)
from stewart_pin.mechanics.derivatives import (
    inverse_dynamics_derivatives as inverse_dynamics_derivatives,
)
from stewart_pin.mechanics.effort import Effort as Effort
from stewart_pin.mechanics.effort import JointEfforts as JointEfforts
from stewart_pin.mechanics.effort import Motion as Motion
from stewart_pin.mechanics.effort import joint_efforts as joint_efforts
from stewart_pin.mechanics.equilibrium import LinearSystem as LinearSystem
from stewart_pin.mechanics.operational_dynamics import MotionMap as MotionMap
from stewart_pin.mechanics.operational_dynamics import OperationalDynamics as OperationalDynamics
from stewart_pin.mechanics.operational_dynamics import motion_map as motion_map
from stewart_pin.mechanics.reactions import Reaction as Reaction
from stewart_pin.mechanics.vibration import FrequencyResponse as FrequencyResponse
from stewart_pin.mechanics.vibration import Vibration as Vibration
from stewart_pin.mechanics.vibration import frequency_response as frequency_response
from stewart_pin.mechanics.vibration import platform_compliance as platform_compliance
from stewart_pin.mechanics.vibration import platform_stiffness as platform_stiffness
from stewart_pin.state.base_motion import BaseMotion as BaseMotion
