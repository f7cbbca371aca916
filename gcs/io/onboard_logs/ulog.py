"""PX4's ULog (``.ulg``), read by pyulog (extra `ulog`).

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format; topics:
https://docs.px4.io/main/en/msg_docs/. Times count from the boot of the autopilot where the log has no UTC
time of GPS.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import RecordingError
from gcs.io.onboard_logs.onboard_telemetry import POSITION_S, OnboardTelemetry
from gcs.model import FloatArray, IntArray

_TOPICS: Final = (
    "vehicle_global_position",
    "vehicle_local_position",
    "vehicle_status",
    "battery_status",
    "home_position",
    "mission_result",
    "vehicle_gps_position",
)
_ARMED: Final = 2
"""vehicle_status.ARMING_STATE_ARMED."""
_MODES: Final = {
    0: (1, 0), 1: (2, 0), 2: (3, 0), 3: (4, 4), 4: (4, 3), 5: (4, 5), 10: (5, 0), 14: (6, 0), 15: (7, 0),
    17: (4, 2), 18: (4, 6), 20: (4, 9),
}  # fmt: skip
"""Main and sub mode (`px4_custom_mode.h`) by vehicle_status.nav_state."""
_SEVERITIES: Final = range(8)
_FIRST_SEVERITY: Final = ord("0")
"""Levels of texts are the digits of syslog's severities."""
_NS_PER_US: Final = 1000


def read_ulog(path: Path) -> OnboardTelemetry:
    """Read a ULog, up to where it is damaged.

    Raises
    ------
    RecordingError
        If pyulog is not installed, or cannot read it.
    """
    try:
        from pyulog import ULog
    except ImportError:
        what = "is a ULog of PX4: `pip install 'swarm-gcs[ulog]'` installs its reader"
        raise RecordingError(str(path), what) from None
    try:
        log: Any = ULog(str(path), list(_TOPICS))
        return _telemetry(log)
    except RecordingError:
        raise
    except Exception as error:  # whatever pyulog raises on a damaged file
        raise RecordingError(str(path), f"is a damaged ULog: {error}") from None


def _telemetry(log: Any) -> OnboardTelemetry:
    topics = {one.name: one.data for one in log.data_list if one.multi_id == 0}
    system_id = int(log.initial_parameters.get("MAV_SYS_ID", 1))
    telemetry = OnboardTelemetry(system_id if 1 <= system_id <= 255 else 1, dialect.MAV_AUTOPILOT_PX4)
    telemetry.shift_ns = _utc_shift_us(topics.get("vehicle_gps_position")) * _NS_PER_US
    _add_positions(telemetry, topics)
    status = topics.get("vehicle_status", {"timestamp": []})
    for k, t_ns in enumerate(_times_ns(status)):
        main, sub = _MODES.get(int(status["nav_state"][k]), (0, 0))
        armed = int(status["arming_state"][k]) == _ARMED
        telemetry.add_state(t_ns, (main << 16) | (sub << 24), armed=armed)
    battery = topics.get("battery_status", {"timestamp": []})
    for k, t_ns in enumerate(_times_ns(battery)):
        percent = 100.0 * float(battery["remaining"][k])
        volt, ampere = (float(battery[name][k]) for name in ("voltage_v", "current_a"))
        telemetry.add_battery(t_ns, volt, ampere, percent)
    _add_changes(telemetry, topics)
    for text in log.logged_messages:
        severity = min(max(int(text.log_level) - _FIRST_SEVERITY, 0), _SEVERITIES[-1])
        telemetry.add_text(int(text.timestamp) * _NS_PER_US, text.message.strip(), severity)
    return telemetry


def _times_ns(data: dict[str, Any]) -> list[int]:
    """Return the times of a topic since the boot of the autopilot."""
    return [int(t_us) * _NS_PER_US for t_us in data["timestamp"]]


def _utc_shift_us(gps: dict[str, Any] | None) -> int:
    """Return the time from the autopilot's clock to UTC; 0 if it is not known."""
    if gps is None:
        return 0
    is_known = np.asarray(gps["time_utc_usec"]) > 0
    if not is_known.any():
        return 0
    k = int(np.argmax(is_known))
    return int(gps["time_utc_usec"][k]) - int(gps["timestamp"][k])


def _add_positions(telemetry: OnboardTelemetry, topics: dict[str, Any]) -> None:
    """Add positions with the velocities of the local estimate nearest before."""
    places = topics.get("vehicle_global_position")
    if places is None:
        return
    local = topics.get("vehicle_local_position")
    homes = topics.get("home_position")
    for k in _spaced(places["timestamp"]).tolist():
        t_us = int(places["timestamp"][k])
        lat_deg, lon_deg, alt_m = (float(places[name][k]) for name in ("lat", "lon", "alt"))
        if not math.isfinite(lat_deg + lon_deg + alt_m):
            continue
        velocity = (0.0, 0.0, 0.0) if local is None else _row(local, ("vx", "vy", "vz"), t_us)
        home_m = alt_m if homes is None else _row(homes, ("alt",), t_us)[0]
        telemetry.add_position(t_us * _NS_PER_US, (lat_deg, lon_deg), alt_m, alt_m - home_m, velocity)


def _spaced(times_us: FloatArray) -> IntArray:
    """Return the indices of the first record of each period."""
    periods = np.asarray(times_us, dtype=np.int64) // round(POSITION_S * 1e6)
    return np.flatnonzero(np.diff(periods, prepend=-1))


def _row(data: dict[str, Any], names: tuple[str, ...], t_us: int) -> tuple[float, ...]:
    """Return the values of a topic at a time: those of the last record until then, or of the first."""
    k = max(int(np.searchsorted(data["timestamp"], t_us, side="right")) - 1, 0)
    return tuple(float(data[name][k]) for name in names)


def _add_changes(telemetry: OnboardTelemetry, topics: dict[str, Any]) -> None:
    """Add home positions and mission items."""
    homes = topics.get("home_position", {"timestamp": []})
    for k, t_ns in enumerate(_times_ns(homes)):
        lat_deg, lon_deg, alt_m = (float(homes[name][k]) for name in ("lat", "lon", "alt"))
        if math.isfinite(lat_deg + lon_deg + alt_m):
            telemetry.add_home(t_ns, (lat_deg, lon_deg), alt_m)
    results = topics.get("mission_result", {"timestamp": []})
    for k, t_ns in enumerate(_times_ns(results)):
        telemetry.add_item(t_ns, int(results["seq_current"][k]))
