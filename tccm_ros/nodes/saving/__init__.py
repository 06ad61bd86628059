"""Saving and loading maps."""
