"""Derivatives of the dynamics, the linear system about an equilibrium, stiffness and natural frequencies."""
