"""Obstacle maps and line of sight."""
