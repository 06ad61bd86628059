"""Identity: a surface keeps its id over solutions, also where it was moved."""
