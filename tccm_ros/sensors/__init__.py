"""What each kind of sensor measures: from its record to points in space."""
