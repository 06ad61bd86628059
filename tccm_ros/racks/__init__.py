"""Racks: compartments between boards above each other, and insertions through their fronts."""
