"""Flights of all vehicles in the air at one time, each predicted once, when it is asked for.

Checks of several orders at one time compare each vehicle with all others: they share the predictions. A
change of what a vehicle flies needs `renew`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from gcs.core.separation.forward_flight import Flight
from gcs.core.separation.intents import Intents
from gcs.model import VehicleState


class PredictedFlights:
    """What all vehicles fly, or would fly in other modes, at one time."""

    def __init__(self, intents: Intents, t_ns: int) -> None:
        self.t_ns = t_ns
        self._intents = intents
        self._flights: dict[tuple[int, str], Flight] = {}

    @cached_property
    def states(self) -> dict[int, VehicleState]:
        """The vehicles in the air, and those that are about to take off."""
        return {state.system_id: state for state in self._intents.flying(self.t_ns)}

    def of(self, vehicle: int, mode: str | None = None) -> Flight:
        """Return what a vehicle flies, or would fly in another mode."""
        state = self.states[vehicle]
        key = (vehicle, mode or state.mode)
        flight = self._flights.get(key)
        if flight is None:
            flight = self._flights[key] = self._intents.flight(state, self.t_ns, mode)
        return flight

    def others(
        self, vehicle: int, modes: Mapping[int, str], led: Mapping[int, Flight] | None = None
    ) -> list[Flight]:
        """Return what all others than a vehicle fly.

        Parameters
        ----------
        modes : mapping of int to str
            Modes in which they would fly, by vehicle; the others fly on in theirs.
        led : mapping, optional
            Flights that count instead, by vehicle.
        """
        led = led or {}
        return [led.get(v) or self.of(v, modes.get(v)) for v in self.states if v != vehicle]

    def renew(self) -> None:
        """Predict anew what is asked for from now on."""
        self.__dict__.pop("states", None)
        self._flights.clear()
