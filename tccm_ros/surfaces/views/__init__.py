"""Views: what one tilt cycle measured of surfaces, and where each outline ends."""
