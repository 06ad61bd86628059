"""Calibrate the rig from recordings, and check it at run time."""
