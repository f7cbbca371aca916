"""A fleet of one vehicle that reports what a test says."""

from types import SimpleNamespace

from gcs.mavlink.autopilots.modes import AUTO
from helpers.staging import mission

CONFIG = mission()


class Fleet:
    """One vehicle, as it reports itself."""

    def __init__(self, seq, mode=AUTO):
        self.one = SimpleNamespace(t_ns=0, east_m=0.0, north_m=0.0, ground_speed_m_s=15.0, mission_seq=seq)
        self.one.mode = mode

    def state(self, _vehicle):
        return self.one
