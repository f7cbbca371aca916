"""Commands in flight: `gcs demo`, `gcs run`, `gcs order`, `gcs simulate`, `gcs montecarlo`."""
