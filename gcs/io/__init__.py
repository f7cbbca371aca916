"""All I/O: links, zenoh, recordings, keys, vehicle sessions. Nothing here decides."""
