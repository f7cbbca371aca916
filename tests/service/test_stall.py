"""All vehicles would count as lost after command stood still, and pictures would wait for plans."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
import pytest

from gcs.config import load
from gcs.io.clock import RunClock
from gcs.io.links.vehicle_links import VehicleLinks
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S, Effect, Event, Notice, NoticeCode, Picture, Plan, Resumed, Tick
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
    service = service_of(Quiet())
    effects = service.engine.effects
    events: list[Any] = []

    def stalls(event: Any, *rest: Any) -> Any:
        events.append(event)
        if len(events) == 10:
            time.sleep(stall_s)
        return effects(event, *rest)

    service.engine.effects = stalls  # type: ignore[method-assign, assignment]
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(stall_s + 1.5, stop.set)
    await service.run(RunClock(), stop)
    return events


def service_of(quiet: Quiet) -> Service:
    """Return a service without links."""
    return Service(load("deterministic"), 1, cast(VehicleLinks, quiet), cast(ZenohSession, quiet))


def test_pictures_leave_before_the_rest_of_their_scan_is_processed(monkeypatch: pytest.MonkeyPatch) -> None:
    async def process() -> list[Effect]:
        service = service_of(Quiet())
        left: list[Effect] = []
        picture = Picture(0, 0, "agents", (), np.ones(1))
        plan = Plan(0, 0, (), (), (), "first plan", ())

        def effects(*_: Any) -> Iterator[Effect]:
            yield picture
            assert left == [picture]
            yield plan
            yield Notice(0, NoticeCode.TAKEOFF_CLEAR, 1)
            assert left == [picture]

        monkeypatch.setattr(service.engine, "effects", effects)
        monkeypatch.setattr(service, "_carry_out", lambda _t_ns, effect: left.append(effect))
        service._process(Tick(0))
        return left

    assert [type(one) for one in asyncio.run(process())] == [Picture, Plan, Notice]


@pytest.mark.parametrize(("stall_s", "outage_s"), [(0.0, service_module.OUTAGE_S), (2.0, 1.0)])
def test_a_service_that_stood_still_continues_as_after_a_restart(
    monkeypatch: pytest.MonkeyPatch, stall_s: float, outage_s: float
) -> None:
    monkeypatch.setattr(service_module, "OUTAGE_S", outage_s)
    events = asyncio.run(events_with_stall(stall_s))
    found = [event for event in events if isinstance(event, Resumed)]
    assert bool(found) is (stall_s > outage_s)
    assert all(one.t_ns - one.saved_t_ns > outage_s * NS_PER_S for one in found)
