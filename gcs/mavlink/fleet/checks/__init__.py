"""Checks of one vehicle: its positions, its battery, and how long it has been silent."""
