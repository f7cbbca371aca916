"""What the engine does for each kind of event: functions of the stages and the event, in a fixed order.

`gcs.core.engine` has the tables. A function changes the state through the stages, and returns effects.

- `on_datagram`: vehicles and other ground stations
- `on_scan`: trackers, statuses, the plan
- `on_order`: operators
- `on_tick`: timers
- `on_restart`: the service continues from a state
- `changes`: what follows when a status or the control of an agent changes
- `planning`: plans, and the missions that they send
"""
