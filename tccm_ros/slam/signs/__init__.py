"""Door signs as landmarks of the graph."""
