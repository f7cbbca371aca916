"""All vehicles would count as lost, and the mission as ended, after command stood still for a time."""

from __future__ import annotations

import asyncio
import time
from typing import Any, cast

import pytest

from gcs.config import load
from gcs.io.clock import RunClock
from gcs.io.links.vehicle_links import VehicleLinks
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S, Event, Resumed
from gcs.service import service as service_module
from gcs.service.service import Service


class Quiet:
    """Links and a bus without anything."""

    links = ()

    def __getattr__(self, name: str) -> Any:
        answers = {"may_command": True, "commander": ""}
        return lambda *_, **__: answers.get(name)


async def events_with_stall(stall_s: float) -> list[Event]:
    """Return the events of a service that stands still in its tenth one."""
    quiet = Quiet()
    service = Service(load("deterministic"), 1, cast(VehicleLinks, quiet), cast(ZenohSession, quiet))
    step = service.engine.step
    events: list[Any] = []

    def stalls(event: Any, *rest: Any) -> Any:
        events.append(event)
        if len(events) == 10:
            time.sleep(stall_s)
        return step(event, *rest)

    service.engine.step = stalls  # type: ignore[method-assign, assignment]
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(stall_s + 1.5, stop.set)
    await service.run(RunClock(), stop)
    return events


@pytest.mark.parametrize(("stall_s", "outage_s"), [(0.0, service_module.OUTAGE_S), (3.0, 2.0)])
def test_a_service_that_stood_still_continues_as_after_a_restart(
    monkeypatch: pytest.MonkeyPatch, stall_s: float, outage_s: float
) -> None:
    monkeypatch.setattr(service_module, "OUTAGE_S", outage_s)
    events = asyncio.run(events_with_stall(stall_s))
    found = [event for event in events if isinstance(event, Resumed)]
    assert bool(found) is (stall_s > outage_s)
    assert all(one.t_ns - one.saved_t_ns > outage_s * NS_PER_S for one in found)
