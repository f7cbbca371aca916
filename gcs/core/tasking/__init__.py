"""From routes to verified onboard missions: build, queue, upload, watch."""
