"""Separation of vehicles in the air: a look-ahead over all pairs, with alarms."""
