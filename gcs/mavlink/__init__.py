"""MAVLink without I/O: codec, routing, mission transfer, vehicle state."""
