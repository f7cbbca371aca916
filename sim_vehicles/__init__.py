"""Simulated fixed-wing vehicles and the world they fly in, over real MAVLink and real zenoh."""
