"""What the console reads of the engine, on the loop of the run, and the run of a replay in this process.

Everything else of the console imports neither engine nor trackers: it starts at once.
"""
