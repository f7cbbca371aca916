"""The simulated world: targets, sensors, ground truth, scenarios."""
