"""Models of motion, survival, sensors, clutter and births."""
