"""Parts of approach_node: goals, names of spots, measurements, Nav2."""
