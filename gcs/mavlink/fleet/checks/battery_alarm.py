"""Battery alarm of an armed vehicle: at which charge it is low, and critical.

Remaining charge is that of SYS_STATUS (MAVLink common), in percent. A vehicle that does not report it raises
no alarm; `gcs preflight` says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs.model import NoticeCode, Notify

LOW_PERCENT: Final = 30
"""Warning below this charge."""
CRITICAL_PERCENT: Final = 15
"""Alarm below this charge."""
_RECOVERED_PERCENT: Final = 5
"""Charge above a limit that ends its notice: a load on the battery lowers its voltage for a while."""


def is_low(charge_percent: int | None) -> bool:
    """Return True if a charge is known and low."""
    return charge_percent is not None and charge_percent < LOW_PERCENT


@dataclass(slots=True)
class BatteryAlarm:
    """Notices of one vehicle's battery: one for each limit that the charge falls below."""

    limit_percent: int | None = None
    """Lowest limit that was notified; None if the charge is above all."""

    def check(self, charge_percent: int, notify: Notify, *, armed: bool) -> None:
        """Notify if the charge fell below a limit; a disarmed vehicle has no notice."""
        limit = self.limit_percent
        if not armed:
            self.limit_percent = None
        elif charge_percent < CRITICAL_PERCENT and limit != CRITICAL_PERCENT:
            self.limit_percent = CRITICAL_PERCENT
            notify(NoticeCode.BATTERY_CRITICAL, charge_percent=charge_percent)
        elif is_low(charge_percent) and limit is None:
            self.limit_percent = LOW_PERCENT
            notify(NoticeCode.BATTERY_LOW, charge_percent=charge_percent)
        elif limit is not None and charge_percent >= LOW_PERCENT + _RECOVERED_PERCENT:
            self.limit_percent = None
            notify(NoticeCode.BATTERY_RISEN, charge_percent=charge_percent)
