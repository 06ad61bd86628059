"""Calibrate the rig from what it sees, and check it while running."""
