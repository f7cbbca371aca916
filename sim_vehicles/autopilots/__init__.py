"""The autopilots: simulated ArduPlane and PX4, their failsafes and parameters, and real firmware."""
