"""Input that is no message: unreadable bytes, notices of links, steps of the clock."""

from __future__ import annotations

from gcs.core.stages import Stages
from gcs.model import BadInput, ClockStep, Effect, LinkNews


def count_bad_input(stages: Stages, event: BadInput) -> list[Effect]:
    """Count input that could not be decoded, by its source."""
    if event.sensor:
        stages.sensor_watchdog.refused(event.sensor, event.t_ns, event.problem)
    return stages.input_errors.add(event)


def pass_on_notice(_stages: Stages, event: LinkNews) -> list[Effect]:
    """Pass a notice of a link, or of a part of the service, to the operator."""
    return [event.notice]


def note_clock_step(stages: Stages, event: ClockStep) -> list[Effect]:
    """Note a step of the wall clock: the clocks of sensors may have moved with it."""
    return stages.scan_timing.step(event)
