"""MAVLink endpoints: `manager` (all links of a run), `udp`, `tcp`, `serial`, and their common `transport`."""
