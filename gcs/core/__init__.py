"""The decision core: one event in, effects out, without I/O.

`engine` is the state machine, `stages` connects its parts. `perception` tracks and associates, `replanning`
plans routes, `tasking` uploads missions, `takeoff` separates take-offs, `authority` knows who controls a
vehicle, `operator` carries out orders, `airspace` has maps and zones, `preflight` checks vehicles before a
flight, `restart` continues after an outage, `lease` decides which command node may
send.
"""
