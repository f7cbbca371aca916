"""Orders, scans and records on zenoh, and the discovery of running services."""
