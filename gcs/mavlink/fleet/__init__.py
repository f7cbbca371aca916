"""State of each vehicle from its telemetry: `fleet` (all vehicles), `vehicle` (one), then the checks."""
