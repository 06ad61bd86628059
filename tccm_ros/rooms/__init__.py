"""Rooms of a map: areas enclosed by walls, named by door signs."""
