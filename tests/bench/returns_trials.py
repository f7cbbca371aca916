"""What happens in the trials of ``bench_returns.py``."""

from __future__ import annotations

import random
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.faults import FaultKind

if TYPE_CHECKING:
    from bench_returns import Flight

FRAME = LocalFrame(33.2, -87.6, 70.0)
UPLOAD_S = 0.8
"""Time from the order to the end of the uploads, without loss."""
LOSS = 0.3
HELD = re.compile(r"agent (\d+): holds: it would come near")
AIRCRAFT_S, AIRCRAFT_M_S = 20, 40.0


@dataclass
class Trial:
    """One trial."""

    kind: str
    vehicle: int
    rng: random.Random
    began_ns: int = 0
    said: list[str] = field(default_factory=list)

    def wait_for_upload(self, flight: Flight) -> None:
        """Wait until some moment of the uploads."""
        after_s = self.rng.uniform(0.0, UPLOAD_S + 4.0 * flight.loss)
        self.said.append(f"after {after_s:.2f} s")
        time.sleep(after_s)


@dataclass(frozen=True)
class Kind:
    """A kind of trial."""

    words: str
    watch_s: float
    """Time until all are resumed, from the end of what happens."""
    happen: Callable[[Flight, Trial], None]
    layers: int = 5


def go_home(flight: Flight, trial: Trial) -> None:
    trial.said.append(f"return: {flight.order('return')}")


def take(mode: str) -> Callable[[Flight, Trial], None]:
    """Return a trial in which a second station commands a mode during the uploads."""

    def happen(flight: Flight, trial: Trial) -> None:
        go_home(flight, trial)
        trial.wait_for_upload(flight)
        flight.station.command_mode(trial.vehicle, mode)
        if mode in ("fbwa", "manual"):
            time.sleep(10.0)
            flight.station.command_mode(trial.vehicle, "loiter")  # the pilot gives it back

    return happen


def fail(kind: FaultKind, for_s: float | None) -> Callable[[Flight, Trial], None]:
    """Return a trial in which one vehicle has a fault 10 s after the order, for some time."""

    def happen(flight: Flight, trial: Trial) -> None:
        go_home(flight, trial)
        time.sleep(10.0)
        flight.station.inject(trial.vehicle, kind, begins=True)
        if for_s is not None:
            time.sleep(for_s)
            flight.station.inject(trial.vehicle, kind, begins=False)

    return happen


def order_all(action: str) -> Callable[[Flight, Trial], None]:
    def happen(flight: Flight, trial: Trial) -> None:
        go_home(flight, trial)
        time.sleep(12.0)
        trial.said.append(f"{action}: {flight.order(action)}")

    return happen


def lose_datagrams(flight: Flight, trial: Trial) -> None:
    flight.relay.lost[trial.vehicle] = LOSS
    time.sleep(2.0)
    go_home(flight, trial)
    time.sleep(10.0)


def silence(flight: Flight, trial: Trial) -> None:
    go_home(flight, trial)
    trial.wait_for_upload(flight)
    flight.relay.lost[trial.vehicle] = 1.0
    time.sleep(20.0)
    flight.relay.lost[trial.vehicle] = flight.loss


def kill(flight: Flight, trial: Trial) -> None:
    go_home(flight, trial)
    trial.wait_for_upload(flight)
    flight.service.kill()
    flight.service.wait()
    time.sleep(2.0)
    flight.serve()
    flight.wait_for_service()


def stack(flight: Flight, trial: Trial) -> None:
    """Let two circle near each other at one height, and order all to hold."""
    for vehicle in (1, 2):
        flight.station.command_mode(vehicle, "rtl")
    time.sleep(35.0)
    trial.said.append(f"hold: {flight.order('hold')}")


def meet(flight: Flight, trial: Trial) -> None:
    """Let the leader of those that fly in one layer come back by RTL of a second station."""
    leader = max(flight.vehicles(), key=lambda one: one.east_m).id
    begins = flight.mark()
    flight.station.command_mode(leader, "rtl")
    time.sleep(40.0)
    flight.station.command_mode(leader, "auto")
    trial.said.append(f"leader {leader}, held {flight.named(HELD, begins)}")


def meet_aircraft(then: str = "") -> Callable[[Flight, Trial], None]:
    """Return a trial in which a vehicle receives an aircraft that comes head on at its height.

    When it holds for it a second station commands a mode, or its link breaks ("silent").
    """

    def happen(flight: Flight, trial: Trial) -> None:
        vehicle, begins, is_held = trial.vehicle, flight.mark(), False
        start = flight.place(vehicle)
        for second in range(AIRCRAFT_S):
            east_m = start.east_m + (AIRCRAFT_S - second) * AIRCRAFT_M_S
            flight.relay.inject(vehicle, aircraft(east_m, start.north_m, start.alt_msl_m))
            time.sleep(1.0)
            if not is_held and flight.named(HELD, begins) == vehicle:
                is_held = True
                if then == "silent":
                    flight.relay.lost[vehicle] = 1.0
                elif then:
                    flight.station.command_mode(vehicle, then)
        flight.relay.lost[vehicle] = flight.loss
        if then == "fbwa":
            flight.station.command_mode(vehicle, "loiter")  # the pilot gives it back
        trial.said.append(f"held {is_held}")

    return happen


def aircraft(east_m: float, north_m: float, alt_msl_m: float) -> mavlink.MAVLink_message:
    """Return the report of an aircraft that flies west."""
    lat_deg, lon_deg = FRAME.to_geodetic(east_m, north_m)
    return mavlink.MAVLink_adsb_vehicle_message(
        0xABC123, round(lat_deg * 1e7), round(lon_deg * 1e7), mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        round(alt_msl_m * 1e3), 27_000, round(AIRCRAFT_M_S * 100.0), 0, b"TEST", 1, 0, 0x1F, 0,
    )  # fmt: skip


KINDS = {
    "home": Kind("nothing; they fly until they circle at home, or land", 150.0, go_home),
    "rtl": Kind("a second station commands RTL to one of them during the uploads", 30.0, take("rtl")),
    "loiter": Kind("the same with LOITER", 30.0, take("loiter")),
    "fbwa": Kind("the same with FBWA (PX4: stabilized), then LOITER", 15.0, take("fbwa")),
    "manual": Kind("the same with MANUAL, then LOITER", 15.0, take("manual")),
    "battery": Kind("the battery of one is low 10 s after the order", 5.0, fail(FaultKind.BATTERY, 30.0)),
    "engine": Kind(
        "the engine of one stops 10 s after the order, for 10 s", 25.0, fail(FaultKind.ENGINE, 10.0)
    ),
    "resume": Kind("all are resumed 12 s after the order", 25.0, order_all("resume")),
    "hold": Kind("all are ordered to hold 12 s after the order", 45.0, order_all("hold")),
    "loss": Kind("30 % of the datagrams of one are lost from 2 s before the order on", 20.0, lose_datagrams),
    "silent": Kind("the link of one breaks during the uploads, for 20 s", 30.0, silence),
    "kill": Kind("gcs run is killed (-9) during the uploads, and started again", 40.0, kill),
    "crash": Kind("one crashes 10 s after the order; it is gone then", 30.0, fail(FaultKind.CRASH, None)),
    "stack": Kind("two circle at one height by RTL; all are ordered to hold; no return", 60.0, stack),
    "adsb": Kind("an aircraft comes towards one, which holds; no return", 20.0, meet_aircraft()),
    "adsb-rtl": Kind("the same, and a second station commands RTL then", 25.0, meet_aircraft("rtl")),
    "adsb-fbwa": Kind("the same with FBWA", 2.0, meet_aircraft("fbwa")),
    "adsb-silent": Kind("the same, and its link breaks then", 25.0, meet_aircraft("silent")),
    "meet": Kind("in one layer a second station sets the leader to RTL, towards the others", 25.0, meet, 1),
}
