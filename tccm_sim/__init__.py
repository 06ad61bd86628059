"""A simulator of robots with lasers, with its own geometry."""
