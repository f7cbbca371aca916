"""Zenoh: `session`, `messages` (keys, JSON), `scans`, `orders` (with inbox and client), `discovery`."""
