"""A vehicle in flight, ArduPlane or PX4, with the telemetry of its flight, played message by message."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.model import FlightPhase, NoticeCode
from helpers.played_vehicle import ARDUPLANE, PX4, Stage

ENABLED = dialect.MAV_SYS_STATUS_SENSOR_GPS | dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
AIRSPEED = dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
AWAY_M = 900.0
"""A vehicle of these tests is far from its home unless a test brings it there."""
GLITCH = {ARDUPLANE: 0x8000, PX4: dialect.ESTIMATOR_GPS_GLITCH}


def estimate(autopilot: int, flags: int):
    if autopilot == PX4:
        return dialect.MAVLink_estimator_status_message(0, flags, *[0.05] * 6, 1.0, 1.0)
    return dialect.MAVLink_ekf_status_report_message(flags, 0.05, 0.05, 0.05, 0.05, 0.0)


class Aeroplane(Stage):
    """A vehicle with the telemetry of its flight."""

    def __init__(
        self, autopilot: int, mode: str = "AUTO", *, armed=True, height_m=100.0, failed=0, disabled=0
    ) -> None:
        self.throttle, self.fix, self.away_m, self.failed = 50, 3, AWAY_M, failed
        self.percent, self.landed_state, self.disabled = 80, None, disabled
        speed_m_s = 15.0 if height_m > 1.0 else 0.0
        super().__init__(autopilot, mode, armed=armed, height_m=height_m, speed_m_s=speed_m_s)

    def show(self) -> None:
        self.height_m += 0.5 * self.climb_m_s
        self.away_m += 0.5 * self.speed_m_s
        super().show()
        present = ENABLED | AIRSPEED
        enabled = (present | self.failed) & ~self.disabled
        self.hear(
            dialect.MAVLink_sys_status_message(
                present, enabled, present & ~self.failed, 0, 12000, 0, self.percent, *[0] * 6
            )
        )
        self.hear(dialect.MAVLink_gps_raw_int_message(0, self.fix, 0, 0, 0, 99, 99, 0, 0, 9))
        self.hear(dialect.MAVLink_vfr_hud_message(15.0, 15.0, 0, self.throttle, 0.0, 0.0))
        if self.landed_state is not None:
            self.hear(dialect.MAVLink_extended_sys_state_message(0, self.landed_state))

    def say(self, text: str, severity: int = 2) -> None:
        self.hear(dialect.MAVLink_statustext_message(severity, text.encode()))

    def crash(self) -> None:
        """Hit the ground and stay there, armed."""
        self.climb_m_s, self.speed_m_s, self.height_m = 0.0, 0.0, 0.0

    @property
    def phase(self) -> FlightPhase:
        return self.engine.state.agents[1].flight.phase

    @property
    def status_of_agent(self) -> str:
        return self.engine.state.agents[1].perception.status.status

    def problems(self, code: NoticeCode) -> list[str]:
        """Return the causes of a problem that were told."""
        return [str(notice.parameters["cause"]) for notice in self.noticed(code)]

    def causes_of_coming_down(self) -> list[str]:
        return [str(notice.parameters["causes"]) for notice in self.noticed(NoticeCode.CAME_DOWN)]
