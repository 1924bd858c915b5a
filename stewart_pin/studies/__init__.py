"""Studies over many states: the comparison of methods."""
