"""Singular configurations of any chain: how near, of which kind, and what is lost or gained there."""

from stewart_pin.mechanics.singularity.classification import Singularity as Singularity
from stewart_pin.mechanics.singularity.classification import classify_singularity as classify_singularity
from stewart_pin.mechanics.singularity.split import Screw as Screw
from stewart_pin.mechanics.singularity.split import SingularityKind as SingularityKind
