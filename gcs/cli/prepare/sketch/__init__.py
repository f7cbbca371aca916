"""First values of a mission file, read from plans, maps, logs and links (`gcs init`)."""
