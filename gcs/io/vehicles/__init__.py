"""Short sessions with vehicles: `access`, `session`, and the tasks of `gcs fence` and `gcs param`."""
