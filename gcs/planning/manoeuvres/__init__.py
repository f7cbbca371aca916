"""Manoeuvres at both ends of a flight: climb after take-off, terminal loiter, return route and landing."""
