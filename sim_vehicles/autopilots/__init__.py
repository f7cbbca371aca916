"""The autopilots: simulated ArduPlane and PX4, and real firmware in the loop."""
