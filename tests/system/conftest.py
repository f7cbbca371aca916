"""Vehicles that several tests check."""

from field_vehicles import field

__all__ = ["field"]
