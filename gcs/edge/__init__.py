"""All the I/O: sockets, zenoh, recordings."""
