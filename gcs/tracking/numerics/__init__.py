"""Compiled helpers: sorting, exponentials and logarithms of arrays."""
