"""The zenoh session, and the messages of sensors, operators and other programs on it."""
