"""Recordings of runs, and telemetry logs of other programs.

Modules, in reading order:

``folder``         layout of a recording's folder, run parameters, versions
``recorder``       `Recorder`: writes a run, splits it into parts, keeps the disk budget
``part``           one part: an MCAP file and its tlog
``recorder_thread``  `RecorderThread`: the recorder off the event loop
``schemas``        JSON schemas of the records, for viewers
``reader``         `read`: the records of a run in the order of consumption
``chunks``         decompression of MCAP chunks within bounds
``tlog``           telemetry logs (tlog)
``timestamps``     one time line of a log's stamps
"""
