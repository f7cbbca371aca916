"""Obstacle map: grid, polygon rasterisation, line of sight, clearance-shifted nodes."""
