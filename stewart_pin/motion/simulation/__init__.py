"""Simulation of closed chains without drift: the loops stay closed to round-off for runs of any length."""
