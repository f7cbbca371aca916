"""Obstacles, no-fly zones and the fence, and what is held against them."""
