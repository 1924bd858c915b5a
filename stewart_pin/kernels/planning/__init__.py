"""What is known of a chain before its graphs are written: its constants, its legs, the order of elimination."""
