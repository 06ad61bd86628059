"""Merging: patches of all views become surfaces, less what newer views contradict."""
