"""Compilation of kernels before the first record, by processing synthetic recordings."""
