"""Pictures and scenes. Matplotlib, yourdfpy and trimesh are imported when one is drawn."""

from stewart_pin.viz.capability_pictures import plot_polytopes as plot_polytopes
from stewart_pin.viz.capability_pictures import plot_singularity_map as plot_singularity_map
from stewart_pin.viz.capability_pictures import plot_workspace as plot_workspace
from stewart_pin.viz.capability_pictures import plot_workspace_slices as plot_workspace_slices
from stewart_pin.viz.figures import plot_comparison as plot_comparison
from stewart_pin.viz.figures import plot_constraint_matrix as plot_constraint_matrix
from stewart_pin.viz.scene import build_scene as build_scene
from stewart_pin.viz.scene import plot_chain as plot_chain
from stewart_pin.viz.scene import plot_scene as plot_scene
from stewart_pin.viz.sweep_picture import plot_sweep as plot_sweep
from stewart_pin.viz.vibration_pictures import plot_frequency_response as plot_frequency_response
from stewart_pin.viz.vibration_pictures import plot_mode_shapes as plot_mode_shapes
