"""Recordings: written in the order of consumption, read back, and logs of other programs."""
