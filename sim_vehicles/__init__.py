"""Simulated fixed-wing vehicles and the world they fly in, over real MAVLink and real zenoh.

In reading order:

- `vehicle`: one vehicle: `paper_airframe`, `banked_airframe`, `guidance`; `message_handlers`, `telemetry` for
  MAVLink; `packet_loss`; its `vehicle_process` in real time.
- `autopilots`: ArduPlane and PX4 (`autopilot_traits`, `arduplane`, `px4`), `failsafe`, `fence`, `parameters`,
  `commands` and mission protocols, and real firmware in the loop (`firmware`, `firmware_process`).
- `world`: `scenario` (the `[simulation]` table), targets, sensors, ground truth, and their process.
- `campaign`: whole missions on virtual time. `virtual_run` flies one, `campaign` many.
- `cli`, `supervisor`, `process_start`: the ``sim-vehicles`` command and its processes in real time.

Vehicles and sensors have no clock and no sockets: time and bytes are arguments. So they behave alike in real
time and on virtual time.
"""
