"""All poses of a six-legged platform that share six leg lengths."""

from stewart_pin.analysis.assembly_modes.description import AssemblyModes as AssemblyModes
from stewart_pin.analysis.assembly_modes.description import ModeDescription as ModeDescription
from stewart_pin.analysis.assembly_modes.description import describe_modes as describe_modes
from stewart_pin.analysis.assembly_modes.solver import AssemblySolver as AssemblySolver
from stewart_pin.analysis.assembly_modes.solver import assembly_modes as assembly_modes
