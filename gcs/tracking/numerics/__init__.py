"""Compiled helpers: sorting, exponentials and logarithms of many numbers."""
