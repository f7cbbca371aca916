"""Models of motion, sensors, clutter and births."""
