"""Poses that a platform reaches."""

from stewart_pin.analysis.workspace import WorkspaceSamples as WorkspaceSamples
from stewart_pin.analysis.workspace import sample_workspace as sample_workspace
