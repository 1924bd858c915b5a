"""Studies over many states: the comparison of methods, and sweeps over parameters and designs."""
