"""What kernels answer: ``dynamics``, ``derivatives`` and ``kinematics``, all called by way of ``calling``."""
