"""The TCCM processor: from points to planes, objects and the surface message."""
