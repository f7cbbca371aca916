"""Whole missions on virtual time: one, many, and their evaluation."""
