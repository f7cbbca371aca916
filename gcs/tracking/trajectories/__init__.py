"""Trajectories from association histories: recovery and smoothing."""
