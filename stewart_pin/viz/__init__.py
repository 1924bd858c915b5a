"""Pictures. Matplotlib is imported when one is drawn."""

from stewart_pin.viz.constraint_picture import plot_constraint_matrix as plot_constraint_matrix
from stewart_pin.viz.force_curves import plot_comparison as plot_comparison
