"""The published methods as published: chosen by a setting, and run in comparisons."""
