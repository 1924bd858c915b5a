"""Singularities of a state, along a path, over a grid."""

from stewart_pin.analysis.singularities import SingularityOnPath as SingularityOnPath
from stewart_pin.analysis.singularities import find_singularity as find_singularity
from stewart_pin.analysis.singularity_map import SingularityMap as SingularityMap
from stewart_pin.analysis.singularity_map import singularity_map as singularity_map
from stewart_pin.mechanics.singularity import Screw as Screw
from stewart_pin.mechanics.singularity import Singularity as Singularity
from stewart_pin.mechanics.singularity import SingularityKind as SingularityKind
from stewart_pin.mechanics.singularity import classify_singularity as classify_singularity
