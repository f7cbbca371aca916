"""MAVSDK as mission uploader: `uploader` (the service's side) and `process` (MAVSDK's own process)."""
