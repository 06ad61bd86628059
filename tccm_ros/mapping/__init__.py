"""The Time-series Composite Cuboid Map: from ranges to cuboids, planes and objects."""
