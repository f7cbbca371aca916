"""Whole trajectories from association histories: recovery and smoothing."""
