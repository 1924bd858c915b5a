"""Chains from other chains: other inertias, other loops, displaced geometry; from cranks and rods."""

from stewart_pin.building.body_graph import loops_by_balls as loops_by_balls
from stewart_pin.building.legs import delta_chain as delta_chain
from stewart_pin.building.legs import rotary_hexapod_chain as rotary_hexapod_chain
from stewart_pin.building.variants import displace_geometry as displace_geometry
from stewart_pin.building.variants import replace_inertias as replace_inertias
from stewart_pin.state.geometry_parameters import GeometryParameter as GeometryParameter
from stewart_pin.state.geometry_parameters import geometry_parameters as geometry_parameters
