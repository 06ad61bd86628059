"""Loop closures: candidate search, matching and outlier rejection."""
