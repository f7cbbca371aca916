"""Checks of a mission and of each vehicle before a flight."""
