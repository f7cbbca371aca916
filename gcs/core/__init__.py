"""The decision core: one event in, effects out, without I/O.

`engine` is the state machine. `perception` says what is there, `replanning` what to fly, `tasking` brings
missions to vehicles, `authority` says who controls a vehicle, `operator` takes commands, `airspace` keeps
maps and zones, `preflight` judges a vehicle before its flight, `restart` goes on after an interruption.
"""
