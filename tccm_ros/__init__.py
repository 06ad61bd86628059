"""Surface maps for mobile manipulators, from a tilting laser and a level laser."""

__version__ = "0.2.0"
