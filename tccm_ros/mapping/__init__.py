"""The TCCM as one processor: from points to planes, objects and the surface message."""
