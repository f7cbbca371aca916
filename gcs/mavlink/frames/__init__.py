"""Bytes to MAVLink 2 frames and back: framing, checksums, signing."""
