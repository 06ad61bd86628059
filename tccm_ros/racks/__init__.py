"""Racks: the compartments between boards above each other, and what goes into them by the front."""
