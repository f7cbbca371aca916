"""Obstacles, no-fly zones and the fence, and checks against them."""
