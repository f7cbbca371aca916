"""All I/O of the ground station; nothing here decides.

`links` (UDP, TCP, serial), `signing` (keys), `zenoh` (sensors, orders), `recording`, `vehicles` (preflight,
fence and parameter sessions), `detections` (files for `gcs track`). `clock` is the run's clock,
`background_writer` writes off the event loop, `console` prints.
"""
