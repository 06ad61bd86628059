"""Comparison of surfaces and trajectories with ground truth."""
