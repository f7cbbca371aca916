"""Elevation of the ground: files of elevation models, and heights at places of the local frame."""
