"""Driving the base to a surface: goal pose, edge measurement, velocity commands, state machine."""
