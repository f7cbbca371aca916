"""Commands that fly: `gcs demo`, `gcs run`, `gcs order`."""
