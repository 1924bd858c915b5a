"""How a closed chain obeys: kinematics and dynamics of one state."""
