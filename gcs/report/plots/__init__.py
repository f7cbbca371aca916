"""Figures of runs, plans and tracks."""
