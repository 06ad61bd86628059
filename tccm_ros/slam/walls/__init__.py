"""Walls: from lines of level scans to landmarks of the graph."""
