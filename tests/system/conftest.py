"""Vehicles that several tests check."""

from helpers.field_vehicles import field

__all__ = ["field"]
