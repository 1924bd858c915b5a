"""CasADi expressions of the dynamics of a chain; importing these modules needs the extra ``kernels``."""
