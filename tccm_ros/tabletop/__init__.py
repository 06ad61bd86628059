"""What stands on surfaces, and where there is room to put something down."""
