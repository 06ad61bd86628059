"""Rooms of a map: what walls enclose, named by door signs."""
