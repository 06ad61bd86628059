"""Driving the base to a surface: where to stand, the edge as measured now, speeds, phases."""
