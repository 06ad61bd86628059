"""Kernels are compiled before the first record, by made-up recordings that call them."""
