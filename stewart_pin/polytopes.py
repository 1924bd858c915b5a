"""Velocities and wrenches that motors with limits can give, as polytopes."""

from stewart_pin.mechanics.capability.closure import WrenchClosure as WrenchClosure
from stewart_pin.mechanics.capability.closure import WrenchFeasibility as WrenchFeasibility
from stewart_pin.mechanics.capability.closure import WrenchPath as WrenchPath
from stewart_pin.mechanics.capability.closure import wrench_box as wrench_box
from stewart_pin.mechanics.capability.closure import wrench_closure as wrench_closure
from stewart_pin.mechanics.capability.closure import wrench_feasible as wrench_feasible
from stewart_pin.mechanics.capability.closure import wrench_path as wrench_path
from stewart_pin.mechanics.capability.limits import velocity_polytope as velocity_polytope
from stewart_pin.mechanics.capability.limits import wrench_polytope as wrench_polytope
from stewart_pin.mechanics.capability.polytope import Ball as Ball
from stewart_pin.mechanics.capability.polytope import Polytope as Polytope
from stewart_pin.mechanics.capability.polytope import inscribed_ball as inscribed_ball
from stewart_pin.mechanics.capability.polytope import polytope_contains as polytope_contains
from stewart_pin.mechanics.capability.polytope import polytope_limit as polytope_limit
from stewart_pin.mechanics.capability.polytope import polytope_projection as polytope_projection
from stewart_pin.mechanics.capability.polytope import polytope_reach as polytope_reach
from stewart_pin.mechanics.capability.polytope import polytope_section as polytope_section
from stewart_pin.mechanics.capability.polytope import polytope_support as polytope_support
