"""Objects on surfaces: tracks over views, footprints and free places."""
