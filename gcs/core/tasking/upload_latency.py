"""How long missions take to their vehicles: what a plan has to wait for until it is flown.

On a good link a mission is there within a second or two. Over a bad radio it takes half a minute, and its
target walks on meanwhile: a route that ends where agent and target would meet if it were flown at once comes
too late, every time. So the time is learnt from the transfers of each vehicle.
"""

from __future__ import annotations

DELIVERY_S = 1.0
"""From the plan until a mission is flown, on a good link: 0.5 to 1.8 s."""
_GAIN = 0.5


class UploadLatency:
    """Usual time of a transfer to each vehicle, in seconds."""

    def __init__(self) -> None:
        self._usual_s: dict[int, float] = {}

    def arrived(self, vehicle: int, took_s: float) -> None:
        """A mission arrived."""
        usual_s = self._usual_s.get(vehicle, DELIVERY_S)
        self._usual_s[vehicle] = usual_s + _GAIN * (took_s - usual_s)

    def given_up(self, vehicle: int, after_s: float) -> None:
        """A transfer ended before it was done: it would have taken longer."""
        if after_s > self._usual_s.get(vehicle, DELIVERY_S):
            self.arrived(vehicle, after_s)

    def late_s(self, vehicle: int) -> float:
        """How much longer than on a good link a mission takes that is sent now."""
        return max(0.0, self._usual_s.get(vehicle, DELIVERY_S) - DELIVERY_S)

    def left_s(self, vehicle: int, for_s: float) -> float:
        """What is left of a transfer that has been under way `for_s`, at the least as on a good link."""
        return max(DELIVERY_S, self._usual_s.get(vehicle, DELIVERY_S) - for_s)
