"""Clients of the nodes: the surface map as plain objects, for nodes, agents and the live page."""
