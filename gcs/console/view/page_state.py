"""State of a page: everything that it shows, in named sections of JSON; how much of log and trails.

An update has the sections that have changed, and the new entries of lists (log, answers, scans). A snapshot
has all sections and the last entries; a page that missed updates gets one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, Final

import msgspec

from gcs.console.view import sections
from gcs.console.view.capture import Capture, same_routes
from gcs.console.view.late_tracks import LateTracks
from gcs.console.view.news import News
from gcs.console.view.page_records import (
    FieldOfView,
    Head,
    LogEntry,
    MissionInfo,
    ObstacleMap,
    ReplayState,
    TrailPoint,
)
from gcs.console.view.run_marks import SEVERE, History
from gcs.model import (
    NS_PER_S,
    Effect,
    Level,
    NoFlyZone,
    Notice,
    Order,
    OrderAnswer,
    Proposal,
    Route,
    Scan,
    UploadReport,
    VehicleState,
)
from gcs.report.agent_order import attention
from gcs.report.operator_lines import effect_notice, proposal_title
from gcs.report.plan_reminders import ProposalLog

_MAX_LOG: Final = 500
_MAX_ANSWERS: Final = 200
_MAX_TRAIL: Final = 400
_GAP_NS: Final = 5 * NS_PER_S
"""A trail ends where a vehicle was not heard for so long, and begins anew."""


def _rounded_array(value: Any) -> Any:
    """Return the array of a record of `gcs.model` as it is shown."""
    return value.round(1).tolist()


_encode = msgspec.json.Encoder(enc_hook=_rounded_array).encode


class World:
    """Sections, log and answers.

    Parameters
    ----------
    mission : MissionInfo
        What does not change in the run.
    history : History
        Marks of the run. Those of a live run are added here; those of a recording are read from its file.
    """

    def __init__(self, mission: MissionInfo, history: History) -> None:
        self.mission = mission
        self.is_lost = False
        """True if the service does not answer."""
        self.start_t_ns = 0
        """Start of the run; 0 before its first event."""
        self._history = history
        self._adds_history = not history.is_recorded
        self._is_begun = False
        """True after the first news."""
        self._snapshot: bytes | None = None
        """The last one that was asked for; None: something may be new since."""
        self._begin()

    def _begin(self) -> None:
        """Begin without data."""
        self.capture: Capture | None = None
        self.verified: dict[int, tuple[int, int]] = {}
        """Number of each vehicle's last verified mission, and when that was."""
        self.answers: deque[OrderAnswer] = deque(maxlen=_MAX_ANSWERS)
        self._sections: dict[str, msgspec.Raw] = {"mission": _raw(self.mission)}
        self._trails: dict[int, deque[TrailPoint | None]] = {}
        """Places of each vehicle; None where it was not heard between two of them."""
        self._heard_t_ns: dict[int, int] = {}
        """Time of the newest place."""
        self._late = LateTracks()
        self._log: deque[LogEntry] = deque(maxlen=_MAX_LOG)
        self._logged = 0
        self._proposals = ProposalLog()
        self._owes_snapshot = False
        """True if pages show another run, or another time of a replay, until this one is captured."""
        self._map: ObstacleMap | None = None
        self._zones: tuple[NoFlyZone, ...] | None = None
        self._routes: tuple[Route, ...] | None = None
        self._proposal: Proposal | None = None
        self._fields_of_view: dict[str, FieldOfView] = {}

    def put(self, name: str, value: Any) -> bytes:
        """Replace a section; return the update."""
        self._sections[name] = _raw(value)
        self._snapshot = None
        return _message("update", {name: self._sections[name]})

    def snapshot(self) -> bytes:
        """Return all sections, and the last entries of the log and of the answers; made once an update."""
        if self._snapshot is None:
            self._snapshot = self._make_snapshot()
        return self._snapshot

    def _make_snapshot(self) -> bytes:
        lists = {
            "log": list(self._log),
            "answers": list(self.answers),
            "trails": {str(vehicle): list(points) for vehicle, points in self._trails.items()},
            "late": self._late.paths(),
        }
        return _message("snapshot", self._sections | lists)

    def lose(self, heard_ms: int) -> bytes:
        """Note that the service does not answer, and when it last did; return the update."""
        self.is_lost = True
        return self.put("lost", heard_ms)

    def update(self, found: News, replay: ReplayState | None = None) -> bytes | None:
        """Add what is new; return the update, or None if nothing has changed.

        Another run, or a replay that has begun again at another time, gives a snapshot, as soon as there is
        something to show.
        """
        news = dict[str, Any]()
        self._snapshot = None
        self.is_lost = False
        if found.begins_anew:
            self._begin_anew(found)
        if found.start_t_ns is not None:
            self.start_t_ns = found.start_t_ns
        self._put("lost", None, news)
        self._put("replay", replay, news)
        self._add_effects(found.effects, news)
        for states in found.passed:
            self._add_to_trails(states)
        if found.scans:
            self._add_scans(found.scans, news)
        for picture in found.pictures:
            self._put(f"{picture.kind}_tracks", sections.tracks(picture), news)
            if self._adds_history:
                self._history.add_picture(self._seconds(picture.t_ns), picture)
        if late := self._late.add(found.lagged):
            news["late"] = late
        for t_ns, work, took_ms in found.work:
            self._history.add_work(self._seconds(t_ns), work, took_ms)
        if found.capture is not None:
            self.capture = found.capture
            self._add_capture(found.capture, news)
        if self._owes_snapshot:
            if self.capture is None:
                return None
            self._owes_snapshot = False
            return self.snapshot()
        return _message("update", news) if news else None

    def _begin_anew(self, found: News) -> None:
        """Begin without data, at the first news or after others."""
        is_first = not self._is_begun
        before = self.mission
        self._is_begun = True
        self.mission = found.mission or before
        self._begin()
        if is_first:
            return
        self._owes_snapshot = True
        if self.mission.begun != before.begun:
            self._history.begin()
        elif self._adds_history:
            self._history.restart()
        else:
            self.start_t_ns = found.start_t_ns or 0
            self._add_earlier(found)

    def _add_earlier(self, found: News) -> None:
        """Log the events of a recording before the time at which its replay has begun again."""
        begun_s = 0.0 if found.begun_t_ns is None else self._seconds(found.begun_t_ns)
        for mark in self._history.marks():
            if mark.t_s < begun_s:
                level: Level = "alarm" if mark.kind in SEVERE else "info"
                self._add_entry(LogEntry(0, mark.t_s, level, mark.text, mark.kind, mark.code, mark.key))

    def _add_effects(self, effects: Iterable[tuple[int, Effect | Order]], news: dict[str, Any]) -> None:
        for t_ns, effect in effects:
            if self._adds_history:
                self._history.add(self._seconds(t_ns), effect)
            if isinstance(effect, Order):
                continue
            if isinstance(effect, OrderAnswer):
                self.answers.append(effect)
                news.setdefault("answers", []).append(effect)
            if isinstance(effect, UploadReport) and effect.ok:
                self.verified[effect.vehicle] = effect.mission_id, t_ns
            if isinstance(effect, Proposal) and not self._proposals.add_if_due(effect):
                continue
            notice = effect_notice(effect)
            if notice is not None:
                entry = self._add_entry(_entry(self._seconds(t_ns), effect, notice))
                news.setdefault("log", []).append(entry)

    def _add_entry(self, entry: LogEntry) -> LogEntry:
        """Number an entry and add it to the log."""
        self._logged += 1
        numbered = msgspec.structs.replace(entry, n=self._logged)
        self._log.append(numbered)
        return numbered

    def _add_to_trails(self, states: Iterable[VehicleState]) -> None:
        for state in states:
            before_t_ns = self._heard_t_ns.get(state.system_id)
            if state.t_ns == before_t_ns:
                continue  # nothing was heard since
            self._heard_t_ns[state.system_id] = state.t_ns
            trail = self._trails.setdefault(state.system_id, deque(maxlen=_MAX_TRAIL))
            if before_t_ns is not None and state.t_ns - before_t_ns > _GAP_NS:
                trail.append(None)
            trail.append((round(state.east_m), round(state.north_m), round(state.alt_msl_m)))

    def _add_scans(self, scans: list[Scan], news: dict[str, Any]) -> None:
        news["scans"] = [sections.detections(one) for one in scans]
        views = sections.fields_of_view(scans)
        if not views.items() <= self._fields_of_view.items():
            self._fields_of_view |= views
            self._put("fields_of_view", self._fields_of_view, news)

    def _add_capture(self, capture: Capture, news: dict[str, Any]) -> None:
        status = capture.status
        if self._adds_history:
            vehicles = sorted(agent.vehicle for agent in status.agents)
            self._history.add_telemetry(self._seconds(capture.t_ns), vehicles, capture.telemetry)
        elapsed_s = self._seconds(capture.t_ns)
        head = Head(capture.t_ns // 1_000_000, elapsed_s, status.has_ended, status.sensors, capture.service)
        self._put("head", head, news)
        self._put("vehicles", sorted(status.agents, key=attention), news)
        self._put("targets", status.targets, news)
        if "proposal" not in self._sections or self._proposal is not capture.proposal:
            self._proposal = capture.proposal
            self._put("proposal", capture.proposal, news)
        if self._map is not capture.map:
            self._map = capture.map
            self._put("map", capture.map, news)
        if self._zones != capture.zones:
            self._zones = capture.zones
            self._put("zones", capture.zones, news)
        if self._routes is None or not same_routes(self._routes, capture.routes):
            self._routes = capture.routes
            self._put("routes", capture.routes, news)

    def _put(self, name: str, value: Any, news: dict[str, Any]) -> None:
        """Replace a section, and add it to the news if it has changed."""
        raw = _raw(value)
        if bytes(self._sections.get(name, b"")) != bytes(raw):
            self._sections[name] = news[name] = raw

    def _seconds(self, t_ns: int) -> float:
        return round((t_ns - self.start_t_ns) / NS_PER_S, 2)


def _entry(t_s: float, effect: Effect, notice: Notice) -> LogEntry:
    """Return the entry of an effect; the routes of a proposed plan have a panel of their own."""
    text = proposal_title(effect) if isinstance(effect, Proposal) else notice.line
    vehicle = getattr(effect, "vehicle", None)
    kind = type(effect).__name__
    return LogEntry(0, t_s, notice.level, text, kind, notice.code, notice.key, notice.ended, vehicle)


def _raw(value: Any) -> msgspec.Raw:
    return msgspec.Raw(_encode(value))


def _message(kind: str, parts: dict[str, Any]) -> bytes:
    return _encode({"type": kind, **parts})
