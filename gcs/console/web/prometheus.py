"""Metrics in the text format of Prometheus (https://prometheus.io/docs/instrumenting/exposition_formats)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Final

from gcs.console.view.capture import Capture
from gcs.console.view.page_records import ServiceState
from gcs.model import AgentRecord, vehicle_name

_AGENT_GAUGES: Final[tuple[tuple[str, str, Callable[[AgentRecord], float | None]], ...]] = (
    ("heard_age_seconds", "Time since the last frame of the vehicle.", lambda a: a.heard_age_s),
    ("loss_ratio", "Fraction of its frames that did not arrive.", lambda a: a.loss),
    ("battery_percent", "Remaining battery.", lambda a: a.battery_percent),
    ("altitude_metres", "Height above its home.", lambda a: a.alt_rel_m),
    ("above_ground_metres", "Height above the ground, over terrain.", lambda a: a.agl_m),
    ("ground_speed_metres_per_second", "Ground speed.", lambda a: a.ground_speed_m_s),
    ("armed", "1 if armed.", lambda a: float(a.armed)),
    ("ours", "1 if the service may task it.", lambda a: float(a.authority == "ours")),
    ("lost", "1 if the agent is lost.", lambda a: float(a.status == "lost")),
    ("down", "1 if the vehicle came down.", lambda a: float(a.status == "down")),
    ("track_existence", "Existence probability of its track.", lambda a: a.existence),
)


def metrics_text(capture: Capture | None, pages: int) -> str:
    """Return all metrics of a capture."""
    return "".join(f"{line}\n" for line in _lines(capture, pages))


def _lines(capture: Capture | None, pages: int) -> Iterator[str]:
    yield from _gauge("service_up", "1 if the service answers.", [("", float(capture is not None))])
    yield from _gauge("pages", "Open pages of the console.", [("", float(pages))])
    if capture is None:
        return
    status = capture.status
    if capture.service is not None:
        yield from _service(capture.service)
    yield from _gauge("targets", "Confirmed targets.", [("", float(len(status.targets)))])
    yield from _gauge("plan_waits", "1 if a plan waits.", [("", float(status.plan_id is not None))])
    ages = [(f'{{sensor="{_escaped(one.name)}"}}', one.scan_age_s) for one in status.sensors]
    yield from _gauge("scan_age_seconds", "Time since the last processed scan.", ages)
    for name, text, value in _AGENT_GAUGES:
        rows = [(f'{{vehicle="{vehicle_name(one.vehicle)}"}}', value(one)) for one in status.agents]
        yield from _gauge(f"vehicle_{name}", text, rows)


def _service(state: ServiceState) -> Iterator[str]:
    yield from _gauge("lag_seconds", "Time that the newest tick waited.", [("", state.lag_s)])
    yield from _gauge("events_dropped", "Events that found the queue full.", [("", float(state.dropped))])
    yield from _gauge("recording", "1 if the run is recorded.", [("", float(state.is_recording))])
    stations = float(len(state.stations))
    yield from _gauge("ground_stations", "Other ground stations heard.", [("", stations)])
    if state.space is not None:
        used = float(state.space.used_bytes)
        free = float(state.space.free_bytes)
        yield from _gauge("recording_bytes", "Size of the recording.", [("", used)])
        yield from _gauge("disk_free_bytes", "Space left on its disk.", [("", free)])


def _gauge(name: str, text: str, rows: Iterable[tuple[str, float | None]]) -> Iterator[str]:
    yield f"# HELP swarm_gcs_{name} {text}"
    yield f"# TYPE swarm_gcs_{name} gauge"
    for labels, value in rows:
        if value is not None:
            yield f"swarm_gcs_{name}{labels} {value + 0.0:g}"  # no -0


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
