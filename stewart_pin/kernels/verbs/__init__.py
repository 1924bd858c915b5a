"""What kernels answer: dynamics, derivatives, geometry and kinematics, all called by way of ``calling``."""
