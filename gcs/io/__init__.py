"""All I/O of the ground station; nothing here decides.

`links` (UDP, TCP, serial), `signing` (keys), `zenoh` (sensors, orders), `recording`, `vehicles` (preflight,
fence and parameter sessions), `detections` (files for `gcs track`), `cluster` (messages between bridge,
command and standby). `clock` is the run's clock, `background_writer` writes off the event loop, `event_loop`
calls it from other threads, `terminal` prints.
"""
