"""Closing loops: the result, rates of the Jacobian, freedoms, every pose of given motors, paths."""

from stewart_pin.analysis.point_by_point import closed_path as closed_path
from stewart_pin.mechanics.forward_solutions import ForwardSolutions as ForwardSolutions
from stewart_pin.mechanics.forward_solutions import all_forward_kinematics as all_forward_kinematics
from stewart_pin.mechanics.mobility import Mobility as Mobility
from stewart_pin.state.freedom import FreedomCount as FreedomCount
from stewart_pin.state.generic import generic_freedom as generic_freedom
from stewart_pin.state.loop_verbs import constraint_models as constraint_models
from stewart_pin.state.loop_verbs import loop_jacobian_rate as loop_jacobian_rate
from stewart_pin.state.newton import Closure as Closure
