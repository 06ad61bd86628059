"""Result files and saved maps: written, read back, and exported."""
