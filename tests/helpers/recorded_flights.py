"""Recorded flights of ArduPlane, and a simulated plane that receives the same commands at the same times.

A flight is what the ground sent to one vehicle, byte for byte, with the vehicle's true path. `extract` reads
it from a recording and its true states; `load` and `save` keep it in a small file of its own.
``python recorded_flights.py RECORDINGS FILE`` makes that file.
"""

from __future__ import annotations

import csv
import gzip
import json
import math
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import RALLY, Item
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(-35.372275, 149.148714, 584.0)
AIRSPEED_M_S = 23.5
"""True airspeed of the recorded planes: AIRSPEED_CRUISE 22, at 680 m above sea level."""
WINDS_M_S = {"H": (6.0, 0.0)}
PARAMETERS = {
    "NAVL1_PERIOD": 15, "WP_LOITER_RAD": 80, "WP_RADIUS": 50, "FS_GCS_ENABL": 1, "AIRSPEED_MIN": 10,
    "AIRSPEED_CRUISE": 22, "ROLL_LIMIT_DEG": 65, "ARMING_DELAY_S": 0,
}  # fmt: skip
_COMMANDS = frozenset({
    "HEARTBEAT", "COMMAND_LONG", "COMMAND_INT", "SET_MODE", "MISSION_COUNT", "MISSION_ITEM_INT",
    "MISSION_ITEM", "MISSION_SET_CURRENT", "MISSION_CLEAR_ALL",
})  # fmt: skip
_IGNORED = frozenset({mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE})
_WINDOW_S = 10.0


@dataclass(slots=True)
class Flight:
    """One vehicle's flight; times in seconds from the first frame of its recording."""

    name: str
    system_id: int
    rally: tuple[float, float, float]
    """Latitude, longitude and height above home."""
    home: tuple[float, float]
    heading_rad: float
    """Of the plane at the beginning."""
    wind_m_s: tuple[float, float]
    begins_s: float
    ends_s: float
    truth: np.ndarray
    """(n, 4) time, east, north, altitude above home."""
    velocity_m_s: tuple[float, float]
    roll_rad: float
    mode: int
    """ArduPlane's number, at the beginning."""
    commands: list[tuple[float, bytes]] = field(default_factory=list)

    @property
    def key(self) -> str:
        return f"{self.name}{self.system_id}"


def extract(folder: Path, period_s: float = 0.1) -> list[Flight]:
    """Read the flights of one recording: up to the first mode change without an order."""
    link = mavutil.mavlink_connection(str(folder / "link.tlog"))
    commands: dict[int, list[tuple[float, bytes]]] = {}
    mission = tomllib.loads((folder / "mission.toml").read_text())
    course_rad = math.radians(mission["agents"][0]["course_deg"])
    rally = mission["rally"][0]
    ordered: dict[int, list[tuple[float, int]]] = {}
    began: float | None = None
    while (message := link.recv_match()) is not None:
        began = message._timestamp if began is None else began
        t_s, kind = message._timestamp - began, message.get_type()
        if message.get_srcSystem() < 200:
            continue
        if kind not in _COMMANDS or getattr(message, "mission_type", 0) != 0:
            continue
        if getattr(message, "command", 0) in _IGNORED:
            continue
        target = getattr(message, "target_system", 0)
        if kind == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_DO_SET_MODE:
            ordered.setdefault(target, []).append((t_s, int(message.param2)))
        for system_id in {1, 2, 3, 4} if target == 0 else {target}:
            commands.setdefault(system_id, []).append((t_s, bytes(message.get_msgbuf())))
    assert began is not None
    rows: dict[int, list[list[str]]] = {}
    with (folder / "truth.csv").open() as file:
        for row in csv.reader(file):
            if row[1] == "veh":
                rows.setdefault(int(row[2]), []).append(row)
    flights = []
    for system_id, seen in sorted(rows.items()):
        sent, modes = commands[system_id], ordered[system_id]
        flight = _flight(folder.name, system_id, seen, began, sent, modes, period_s)
        flight.rally = rally["lat_deg"], rally["lon_deg"], rally["alt_rel_m"]
        if flight.velocity_m_s == (0.0, 0.0):
            flight.heading_rad = course_rad
        flights.append(flight)
    return flights


def _flight(name, system_id, rows, began, commands, ordered, period_s) -> Flight:
    states = np.array([[float(r[0]) - began, *(float(v) for v in r[3:8]), float(r[11])] for r in rows])
    modes = [r[8] for r in rows]
    first_s = next(t for t, data in commands if data[7] != 0 or len(data) > 30)
    start = int(np.searchsorted(states[:, 0], first_s))
    ends_s, mode = min(states[-1, 0], commands[-1][0] + 1.0), modes[start]
    for t_s, now in zip(states[start:, 0], modes[start:], strict=True):
        if now != mode:
            if not any(m == int(Mode[now]) and -1.0 < t_s - t < 3.0 for t, m in ordered) and now != "RTL":
                ends_s = min(ends_s, t_s)
                break
            mode = now
    v_east, v_north, roll_deg = states[start, 4:]
    on_ground = math.hypot(v_east, v_north) < 1.0
    keep, last = [], -math.inf
    for row in states[start:]:
        if row[0] <= ends_s and row[0] - last >= period_s - 0.01:
            keep.append(row[:4])
            last = row[0]
    wind_m_s = WINDS_M_S.get(name, (0.0, 0.0))
    return Flight(
        name, system_id, (0.0, 0.0, 0.0), (1500.0, 1000.0), math.atan2(v_east, v_north), wind_m_s,
        float(states[start, 0]), float(ends_s), np.array(keep),
        (0.0, 0.0) if on_ground else (float(v_east), float(v_north)), math.radians(roll_deg),
        int(Mode[modes[start]]), [(t, d) for t, d in commands if states[start, 0] - 1.0 <= t <= ends_s],
    )  # fmt: skip


def fly(flight: Flight, period_s: float = 0.2, **spec) -> np.ndarray:
    """Fly it again; return (n, 5): time, east, north, altitude and reported cross-track error."""
    east_m, north_m, alt_m = flight.truth[0, 1:4]
    on_ground = flight.velocity_m_s == (0.0, 0.0)
    wind = flight.wind_m_s
    values = {
        "system_id": flight.system_id, "east_m": east_m, "north_m": north_m, "course_rad": flight.heading_rad,
        "alt_rel_m": 0.0 if on_ground else alt_m, "forward_speed_m_s": AIRSPEED_M_S,
        "airborne": not on_ground, "gps_noise_std_m": 0.0, "airframe": "banked",
        "parameters": dict(PARAMETERS),
        "wind_east_m_s": wind[0], "wind_north_m_s": wind[1],
    } | spec  # fmt: skip
    start_ns = int(flight.begins_s * NS_PER_S)
    vehicle = SimVehicle(VehicleSpec(**values), FRAME, start_ns)
    airframe, autopilot = vehicle.airframe, vehicle.autopilot
    if not on_ground:
        through_east, through_north = (v - w for v, w in zip(flight.velocity_m_s, wind, strict=True))
        airframe.heading_rad = math.atan2(through_east, through_north)
        airframe.roll_rad = flight.roll_rad
        autopilot.home = type(autopilot.home)(*flight.home, 0.0)
    lat_deg, lon_deg, height_m = flight.rally
    rally = Item(
        mavlink.MAV_CMD_NAV_RALLY_POINT, x=round(lat_deg * 1e7), y=round(lon_deg * 1e7), z=height_m
    )  # fmt: skip
    autopilot.fence.stores[RALLY].put(0, rally)
    autopilot.set_mode(Mode(flight.mode))
    path, commands, t_s = [], iter(flight.commands), flight.begins_s
    sent_s, data = next(commands, (math.inf, b""))
    while t_s <= flight.ends_s:
        while sent_s <= t_s:
            vehicle.receive_datagram(data, max(int(sent_s * NS_PER_S), start_ns))
            sent_s, data = next(commands, (math.inf, b""))
        vehicle.advance(int(t_s * NS_PER_S))
        vehicle.datagrams_to_send(int(t_s * NS_PER_S))
        off_m = autopilot.goal.cross_track_m(airframe) if hasattr(autopilot.goal, "cross_track_m") else 0.0
        path.append(
            (t_s, airframe.east_m, airframe.north_m, airframe.alt_rel_m - autopilot.home.alt_m, off_m)
        )
        t_s += period_s
    return np.array(path)


def off_path_m(flight: Flight, path: np.ndarray) -> np.ndarray:
    """Distance of each flown place from the true path within 10 s of its time, while the true plane moved."""
    truth = flight.truth
    moves = np.hypot(*np.gradient(truth[:, 1:3], truth[:, 0], axis=0).T) > 3.0
    distances = []
    for t_s, east_m, north_m in path[:, :3]:
        if not moves[np.searchsorted(truth[:, 0], t_s).clip(0, len(truth) - 1)]:
            continue
        near = truth[np.abs(truth[:, 0] - t_s) <= _WINDOW_S]
        a, b = near[:-1, 1:3], near[1:, 1:3]
        along = b - a
        place = np.array([east_m, north_m])
        share = ((place - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9)
        nearest = a + along * share.clip(0.0, 1.0)[:, None]
        distances.append(np.hypot(*(place - nearest).T).min())
    return np.array(distances)


def apart_m(flight: Flight, path: np.ndarray) -> np.ndarray:
    """Distance between the flown and the true plane at the same times."""
    truth = flight.truth
    there = np.c_[
        np.interp(path[:, 0], truth[:, 0], truth[:, 1]), np.interp(path[:, 0], truth[:, 0], truth[:, 2])
    ]
    return np.hypot(*(path[:, 1:3] - there).T)


def save(flights: list[Flight], file: Path) -> None:
    """Write flights to one compressed file of JSON."""
    raw = []
    for flight in flights:
        one = {name: getattr(flight, name) for name in Flight.__slots__}
        one["truth"] = [[round(float(v), 1) for v in row] for row in flight.truth]
        one["commands"] = [(round(t, 3), data.hex()) for t, data in flight.commands]
        raw.append(one)
    with gzip.GzipFile(file, "wb", 9, mtime=0) as out:
        out.write(json.dumps(raw, separators=(",", ":")).encode())


def load(file: Path) -> list[Flight]:
    """Read what `save` wrote."""
    with gzip.open(file) as source:
        raw = json.load(source)
    for one in raw:
        one["truth"] = np.array(one["truth"])
        one["commands"] = [(t, bytes.fromhex(data)) for t, data in one["commands"]]
        for name in ("rally", "home", "wind_m_s", "velocity_m_s"):
            one[name] = tuple(one[name])
    return [Flight(**one) for one in raw]


if __name__ == "__main__":
    source, target = Path(sys.argv[1]), Path(sys.argv[2])
    every = [f for folder in sorted(source.iterdir()) if folder.is_dir() for f in extract(folder, 1.0)]
    save(every, target)
    print(f"{len(every)} flights, {target.stat().st_size} bytes")
