"""Walls: from the lines of level scans to landmarks of the graph."""
