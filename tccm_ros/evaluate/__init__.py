"""Results against truth: surfaces and trajectories."""
