"""Flight phase and health of each vehicle, from its own telemetry."""
