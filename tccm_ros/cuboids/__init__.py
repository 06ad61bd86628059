"""The Time-series Composite Cuboid Map: part maps, the integration map, and questions to it."""
