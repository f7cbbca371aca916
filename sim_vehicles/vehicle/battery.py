"""Battery of a simulated vehicle: it lasts an hour; a fault leaves little of it."""

from __future__ import annotations

from gcs.model import NS_PER_S
from sim_vehicles.vehicle.faults import FaultKind, Faults

_ENDURANCE_S = 3600.0
_FAULT_PERCENT = 15.2
_FAULT_PERCENT_S = 0.2
_EMPTY_PERCENT = 1.0


class Battery:
    """Remaining charge and voltage.

    A fault leaves 15 % at once, and takes 0.2 % a second: low at once, critical 40 s later.
    """

    def __init__(self, faults: Faults, boot_t_ns: int) -> None:
        self._faults = faults
        self._boot_t_ns = boot_t_ns

    def percent(self, t_ns: int) -> float:
        """Return the remaining charge in percent."""
        percent = 100.0 * max(0.0, 1.0 - (t_ns - self._boot_t_ns) / NS_PER_S / _ENDURANCE_S)
        if FaultKind.BATTERY in self._faults:
            fallen = _FAULT_PERCENT_S * self._faults.age_s(FaultKind.BATTERY, t_ns)
            percent = min(percent, max(_FAULT_PERCENT - fallen, _EMPTY_PERCENT))
        return percent

    def voltage_mv(self, t_ns: int) -> int:
        """Return the voltage in millivolts; under a fault it sags."""
        percent = round(self.percent(t_ns))
        if FaultKind.BATTERY in self._faults:
            return 10_000 + 26 * percent
        return 10_500 + 21 * percent
