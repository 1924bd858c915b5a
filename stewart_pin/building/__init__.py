"""Closed chains ready for use: from a file, from a geometry, from another chain."""
