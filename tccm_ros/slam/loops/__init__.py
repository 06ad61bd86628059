"""Loop closures: candidates, matches and which of them are consistent."""
