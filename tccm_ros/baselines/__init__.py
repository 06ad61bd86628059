"""The methods as published, selected by settings and run in comparisons."""
