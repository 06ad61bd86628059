"""Edges: where surfaces end, and the simplest shape that the views support."""
