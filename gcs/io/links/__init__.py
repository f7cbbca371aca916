"""MAVLink endpoints: UDP, TCP and serial ports."""
