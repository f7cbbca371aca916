"""Command would stand still for many seconds when hundreds of vehicles wait for their first missions."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from gcs.core.pipelines.planning import MAX_RENEWED, renew_outdated
from gcs.core.stages import Stages


def test_few_waiting_routes_are_planned_again_at_one_tick() -> None:
    waiting = list(range(100))
    renewed = []

    def renew(vehicle: int, *_: Any) -> None:
        waiting.remove(vehicle)
        renewed.append(vehicle)

    queued = SimpleNamespace(route=None, return_route=None, planned_t_ns=0)
    stages = SimpleNamespace(
        tasking=SimpleNamespace(outdated=lambda _, count: waiting[:count], renew_queued=renew),
        state=SimpleNamespace(
            tasking=SimpleNamespace(queue=dict.fromkeys(range(100), queued)), measured_t_ns=0
        ),
        planning_inputs=SimpleNamespace(build=lambda *_: None),
        replanner=SimpleNamespace(renew_flown=lambda *_: None),
    )
    renew_outdated(cast(Stages, stages), 0)
    assert renewed == list(range(MAX_RENEWED))
    for tick in range(100):
        renew_outdated(cast(Stages, stages), tick)
    assert renewed == list(range(100))
