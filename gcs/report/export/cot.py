"""Cursor on Target events (CoT) for TAK. Source: MITRE, *Cursor on Target Message Router User's Guide*.

| what | type | uid | stale after |
|---|---|---|---|
| vehicle | `a-f-A-M-F-Q`: friendly, air, fixed wing, unmanned | `vehicle-3` | 15 s since it was heard |
| target | `a-u-G`, or as given | `target-T0.1` | 15 s since its scan |
| route | `b-m-r` with waypoints | `route-3` | 30 s |
| alarm | `b-a-o-tbl`; `b-a-o-can` when its condition ends | `alarm-...` | 60 s |

Each uid begins with ``swarm-gcs.<mission>.``. `ce` of a target is one standard deviation of its position,
the larger one. `hae` is a height above the ellipsoid: above mean sea level, plus the height of the geoid.
Texts are those of the service; XML escapes what is markup in them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple
from xml.etree import ElementTree

import numpy as np

from gcs.model import NS_PER_S, AgentRecord, Notice, Picture, Route, SwarmStatus, target_name, vehicle_name
from gcs.report.export.mission_frame import MissionFrame, Place
from gcs.safe_text import printable

_VEHICLE: Final = "a-f-A-M-F-Q"
_ROUTE: Final = "b-m-r"
_ALARM: Final = "b-a-o-tbl"
_ALARM_ENDS: Final = "b-a-o-can"
_MEASURED_S: Final = 15.0
"""Vehicles and targets: time after which a display greys them out."""
_ROUTE_S: Final = 30.0
_ALARM_S: Final = 60.0
_UNKNOWN: Final = 9_999_999.0
"""CoT's value for an unknown error."""
_MAX_POINTS: Final = 200
"""Of a route: an event must fit into a datagram."""
_MAX_ALARMS: Final = 500
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


class Now(NamedTuple):
    """One moment on two clocks: they differ when a simulation is faster than real time."""

    t_ns: int
    """Of the run."""
    unix_ns: int

    def utc(self, age_s: float = 0.0) -> str:
        """Return the time so many seconds ago, as CoT has it."""
        moment = _EPOCH + timedelta(microseconds=self.unix_ns // 1000, seconds=-age_s)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")

    def age_s(self, t_ns: int) -> float:
        """Return how long ago a time of the run is; 0 for a later one."""
        return max(0.0, (self.t_ns - t_ns) / NS_PER_S)


@dataclass(frozen=True, slots=True)
class CotStyle:
    """What users choose about the events."""

    target_type: str = "a-u-G"
    geoid_m: float = 0.0
    """Height of the geoid above the ellipsoid at the mission's place."""


class CotEvents:
    """Turns the state of a swarm into events, each as XML.

    Parameters
    ----------
    mission : str
        Name of the mission.
    frame : MissionFrame
        Its frame.
    """

    def __init__(self, mission: str, frame: MissionFrame, style: CotStyle | None = None) -> None:
        self._mission = printable(mission)
        self._frame = frame
        self._style = style or CotStyle()
        self._places: dict[int, Place] = {}
        """Last place of each vehicle."""
        self._alarms: dict[str, tuple[str, Place]] = {}
        """Conditions whose alarm was sent: callsign and place."""

    def vehicles(self, status: SwarmStatus, now: Now) -> Iterator[bytes]:
        """Yield an event for each vehicle whose position is known."""
        for agent in status.agents:
            if agent.position_m is None or agent.alt_msl_m is None or agent.heard_age_s is None:
                continue
            place = Place(*self._frame.local.to_geodetic(*agent.position_m), agent.alt_msl_m)
            self._places[agent.vehicle] = place
            event, detail = self._event(
                f"vehicle-{vehicle_name(agent.vehicle)}", _VEHICLE, "m-g", place, now, agent.heard_age_s
            )
            _add(detail, "contact", callsign=self._callsign(agent.vehicle))
            if agent.course_rad is not None and agent.ground_speed_m_s is not None:
                course_deg = math.degrees(agent.course_rad) % 360.0
                _add(detail, "track", course=f"{course_deg:.1f}", speed=f"{agent.ground_speed_m_s:.1f}")
            if agent.battery_percent is not None:
                _add(detail, "status", battery=str(agent.battery_percent))
            _add(detail, "remarks").text = _remarks(agent)
            yield _xml(event)

    def targets(self, picture: Picture, now: Now) -> Iterator[bytes]:
        """Yield an event for each target of the estimate."""
        age_s = now.age_s(picture.scan_t_ns)
        for track in picture.tracks:
            if not track.estimated:
                continue
            east_m, north_m, v_east_m_s, v_north_m_s = track.mean.tolist()
            name = target_name(track.label)
            std_m = math.sqrt(max(0.0, float(np.linalg.eigvalsh(track.cov[:2, :2])[-1])))
            place = self._frame.place(east_m, north_m)
            event, detail = self._event(
                f"target-{name}", self._style.target_type, "m-f", place, now, age_s, ce_m=std_m
            )
            _add(detail, "contact", callsign=f"{self._mission} {name}")
            course_deg = math.degrees(math.atan2(v_east_m_s, v_north_m_s)) % 360.0
            speed_m_s = math.hypot(v_east_m_s, v_north_m_s)
            _add(detail, "track", course=f"{course_deg:.1f}", speed=f"{speed_m_s:.1f}")
            _add(detail, "remarks").text = f"existence {track.existence:.2f}, 1 sigma {std_m:.0f} m"
            yield _xml(event)

    def routes(self, routes: Iterable[Route], now: Now) -> Iterator[bytes]:
        """Yield an event for each route that is flown."""
        for route in routes:
            places = self._frame.route(route, now.t_ns).places
            name = vehicle_name(route.vehicle)
            uid = f"route-{name}"
            event, detail = self._event(uid, _ROUTE, "m-p", places[0], now, stale_s=_ROUTE_S)
            for number, place in enumerate(_thinned(places), 1):
                _add(
                    detail,
                    "link",
                    uid=f"{self._uid(uid)}.{number}",
                    type="b-m-p-w",
                    relation="c",
                    callsign=f"{name}.{number}",
                    point=f"{place.lat_deg:.7f},{place.lon_deg:.7f},{self._hae_m(place):.1f}",
                )
            _add(detail, "link_attr", planningmethod="Infil", method="Flying", routetype="Primary")
            _add(
                detail, "contact", callsign=f"{self._callsign(route.vehicle)} to {target_name(route.target)}"
            )
            yield _xml(event)

    def alarm(self, notice: Notice, now: Now) -> Iterator[bytes]:
        """Yield the event of an alarm, and the ends of alarms that a notice ends."""
        for key in notice.ended:
            if (sent := self._alarms.pop(key, None)) is not None:
                yield self._alarm(key, _ALARM_ENDS, *sent, notice.text, now)
        if notice.level != "alarm":
            return
        vehicle = notice.vehicle
        origin = self._frame.place(0.0, 0.0)
        place = origin if vehicle is None else self._places.get(vehicle, origin)
        callsign = self._mission if vehicle is None else self._callsign(vehicle)
        if len(self._alarms) >= _MAX_ALARMS:
            del self._alarms[next(iter(self._alarms))]
        self._alarms[notice.key] = (callsign, place)
        yield self._alarm(notice.key, _ALARM, callsign, place, notice.line, now)

    def _alarm(self, key: str, kind: str, callsign: str, place: Place, text: str, now: Now) -> bytes:
        event, detail = self._event(f"alarm-{key}", kind, "m-g", place, now, stale_s=_ALARM_S)
        ends = kind == _ALARM_ENDS
        emergency = _add(detail, "emergency", type="Cancel Alert" if ends else "911 Alert")
        emergency.text = callsign
        if ends:
            emergency.set("cancel", "true")
        _add(detail, "contact", callsign=f"{callsign} alarm")
        _add(detail, "remarks").text = text
        return _xml(event)

    def _event(
        self,
        uid: str,
        kind: str,
        how: str,
        place: Place,
        now: Now,
        age_s: float = 0.0,
        *,
        stale_s: float = _MEASURED_S,
        ce_m: float = _UNKNOWN,
    ) -> tuple[ElementTree.Element, ElementTree.Element]:
        """Return an event and its detail. It was measured `age_s` ago."""
        event = ElementTree.Element(
            "event",
            version="2.0",
            uid=self._uid(uid),
            type=kind,
            how=how,
            time=now.utc(),
            start=now.utc(age_s),
            stale=now.utc(age_s - stale_s),
        )
        _add(
            event,
            "point",
            lat=f"{place.lat_deg:.7f}",
            lon=f"{place.lon_deg:.7f}",
            hae=f"{self._hae_m(place):.1f}",
            ce=f"{ce_m:.1f}",
            le=f"{_UNKNOWN:.1f}",
        )
        return event, _add(event, "detail")

    def _uid(self, name: str) -> str:
        return f"swarm-gcs.{self._mission}.{name}"

    def _callsign(self, vehicle: int) -> str:
        return f"{self._mission} {vehicle_name(vehicle)}"

    def _hae_m(self, place: Place) -> float:
        return place.alt_msl_m + self._style.geoid_m


def _remarks(agent: AgentRecord) -> str:
    aim = "" if agent.target is None else f"to {target_name(agent.target)}"
    parts = (agent.status, agent.phase, agent.mode, aim, agent.reason, *agent.problems)
    return ", ".join(part for part in parts if part)


def _thinned(places: tuple[Place, ...]) -> list[Place]:
    """Return at most `_MAX_POINTS` points of a route, the first and the last one among them."""
    count = min(len(places), _MAX_POINTS)
    return [places[index] for index in np.linspace(0, len(places) - 1, count).round().astype(int).tolist()]


def _add(parent: ElementTree.Element, name: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, name, attributes)


def _xml(event: ElementTree.Element) -> bytes:
    """Return XML in ASCII, other characters as references."""
    for element in event.iter():
        element.text = None if element.text is None else printable(element.text)
    content: bytes = ElementTree.tostring(event, encoding="us-ascii", xml_declaration=False)
    return content
