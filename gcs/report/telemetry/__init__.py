"""Vehicles of a stream of MAVLink frames."""
