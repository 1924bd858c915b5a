"""Programs as functions of arrays of states, and of one state."""
