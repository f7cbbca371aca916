"""Onboard logs of autopilots, read as the telemetry that their vehicle would have sent.

`open_telemetry` opens ArduPilot's DataFlash logs (``.bin``) and PX4's ULog (``.ulg``) as a ``.tlog``, and any
other file as it is. So every command that reads telemetry logs reads them.
"""

from gcs.io.onboard_logs.opening import log_kind, open_telemetry

__all__ = ["log_kind", "open_telemetry"]
