"""Separation of resumed vehicles: a vehicle waits while its mission would lead it into another one.

An order to resume starts missions from wherever vehicles were held, at whatever height. What each would fly
is simulated against what the others fly, with those resumed before it.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from gcs.config import Config
from gcs.core.separation.forward_flight import simulate_flights
from gcs.core.separation.intents import Intents
from gcs.core.separation.look_ahead import Encounter, encounters
from gcs.core.separation.monitor import MIN_DISTANCE_M, PREDICTED_SHARE, layer_step_m
from gcs.mavlink.autopilots.modes import AUTO
from gcs.model import vehicle_name

_AHEAD_S: Final = 20.0


class ResumeCheck:
    """Predicts what an order to resume leads to."""

    def __init__(self, config: Config, intents: Intents) -> None:
        self._intents = intents
        self._min_m = max(config.planning.separation_m, MIN_DISTANCE_M)
        self._min_height_m = PREDICTED_SHARE * layer_step_m(config)

    def problem(self, vehicle: int, resumed: Collection[int], t_ns: int) -> str:
        """Return which vehicle a resumed one would come near to; empty if none, or if it would do so anyway.

        Parameters
        ----------
        vehicle : int
            Vehicle in the air, with a mission to continue.
        resumed : collection of int
            Vehicles that are resumed together with it, and before it.
        """
        found = self._nearest(vehicle, {*resumed, vehicle}, t_ns)
        if found is None or self._nearest(vehicle, resumed, t_ns) is not None:
            return ""
        other = next(one for one in found.vehicles if one != vehicle)
        return (
            f"would come within {found.distance_m:.0f} m and {found.height_m:.0f} m in height of agent "
            f"{vehicle_name(other)} in {found.after_s:.0f} s: resume it when they are apart"
        )

    def _nearest(self, vehicle: int, resumed: Collection[int], t_ns: int) -> Encounter | None:
        """Return the first encounter of a vehicle while others fly their missions."""
        states = self._intents.in_air(t_ns)
        flights = [
            self._intents.flight(one, t_ns, AUTO if one.system_id in resumed else None) for one in states
        ]
        met = encounters(simulate_flights(flights, _AHEAD_S), self._min_m, self._min_height_m)
        return min((one for one in met if vehicle in one.vehicles), key=lambda one: one.after_s, default=None)
