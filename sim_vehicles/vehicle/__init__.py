"""One simulated vehicle: airframe, guidance, telemetry and its side of the link."""
