"""Labels of surfaces: table, counter, shelf, step, ..."""
