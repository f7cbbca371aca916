"""MAVLink microservices with one vehicle: commands, parameters, signing keys, preflight data, ADS-B.

Each is sans-I/O: `receive` takes a message, `poll` returns the frames that are due. Repetition follows
`retry` and `retransmission_timeout`.
"""
