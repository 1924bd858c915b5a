"""The verbs of `stewart_pin.mechanics` as straight-line programs for arrays of states."""
