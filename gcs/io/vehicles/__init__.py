"""Short sessions with vehicles: `vehicle_access`, `session`, and the tasks of `gcs fence` and `gcs param`."""
