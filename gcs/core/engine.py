"""The engine: one event in, effects out.

`Engine.step` is synchronous and reads no clock, socket or random source. The same events give the same
effects, byte for byte. A recording is the list of events; a replay calls `step` on them.

`PIPELINES` is the agenda: what happens for each kind of event, in this order. `EPOCH` is the part for a scan
that is processed now, when its reorder window has passed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, TypeAlias

from gcs.config import Config
from gcs.core.pipelines import on_datagram, on_input, on_order, on_restart, on_scan, on_tick
from gcs.core.restart import bridge_gap
from gcs.core.stages import Stages
from gcs.core.state import State
from gcs.core.state_check import check_state
from gcs.mavlink.frames.codec import FrameTable
from gcs.model import (
    BadInput,
    ClockStep,
    Datagram,
    Effect,
    Event,
    LinkNews,
    Notice,
    Order,
    Resumed,
    Scan,
    Tick,
)
from gcs.planning.map.grid import Grid

EPOCH: Final = (
    on_scan.update_trackers,
    on_scan.associate_vehicles,
    on_scan.update_statuses,
    on_scan.check_climbs,
    on_scan.report_missed_targets,
    on_scan.refresh_proposal,
    on_scan.plan,
    on_scan.report_unattended_targets,
    on_scan.end_mission,
    on_scan.report_sensor_model,
)


def process_due_scans(stages: Stages, event: Scan | Tick) -> Iterator[Effect]:
    """Process the scans whose reorder window has passed, in the order of measurement."""
    for scan in on_scan.due_scans(stages, event.t_ns):
        epoch, refusals = on_scan.begin_epoch(stages, scan)
        yield from refusals
        if epoch is not None:
            for stage in EPOCH:
                yield from stage(stages, epoch)


Pipeline: TypeAlias = tuple[Callable[[Stages, Any], Iterable[Effect]], ...]
"""Functions of the stages and the event."""

PIPELINES: Final[dict[type[Event], Pipeline]] = {
    Scan: (on_scan.hold_scan, process_due_scans),
    Tick: (
        on_tick.poll_links,
        on_tick.serve_terrain,
        on_tick.check_flight,
        on_tick.check_health,
        on_tick.check_sensors,
        on_tick.keep_reports,
        process_due_scans,
        on_tick.track_by_reports,
        on_tick.upload_missions,
        on_tick.watch_other_stations,
        on_tick.carry_on_orders,
        on_tick.audit_missions,
        on_tick.watch_takeoffs,
        on_tick.watch_zones,
        on_tick.watch_separation,
        on_tick.watch_ground,
        on_tick.report_standstill,
        on_tick.report_overrides,
        on_tick.leave_auto_on_ground,
    ),
    Order: (on_order.report_status, on_order.carry_out, on_order.refresh_proposal),
    BadInput: (on_input.count_bad_input,),
    LinkNews: (on_input.pass_on_notice,),
    ClockStep: (on_input.note_clock_step,),
    Resumed: (on_restart.audit_missions, on_restart.resume_uploads),
}
DATAGRAM: Final = (on_datagram.receive_from_stations, on_datagram.receive_from_vehicles)
"""The same for datagrams, whose frames may be known already."""


class Engine:
    """Central command of one mission: its file, the seed of its map, and a state.

    Parameters
    ----------
    config : Config
        The mission.
    seed : int
        Seed of the map's random obstacles.
    state : State, optional
        State to continue from; that before the first event by default.

    Raises
    ------
    ValueError
        If the state is damaged, or of another mission.
    """

    def __init__(self, config: Config, seed: int, state: State | None = None) -> None:
        self.config = config
        self.seed = seed
        initial = State.initial(agent.vehicle for agent in config.agents)
        self.stages = Stages(config, seed, initial if state is None else state)

    @property
    def state(self) -> State:
        """The whole state. Assign another one to continue from it; `ValueError` if it is damaged."""
        return self.stages.state

    @state.setter
    def state(self, state: State) -> None:
        check_state(state)
        try:
            self.stages = Stages(self.config, self.seed, state)
        except (LookupError, TypeError, ArithmeticError, AssertionError, AttributeError) as error:
            raise ValueError(f"the state makes no sense ({error!r})") from None

    def step(self, event: Event, frames: FrameTable | None = None) -> list[Effect]:
        """Process one event; return its effects.

        `frames` are those of a datagram, if they are known already. The effects are the same without.
        """
        return list(self.effects(event, frames))

    def effects(self, event: Event, frames: FrameTable | None = None) -> Iterator[Effect]:
        """Process one event; yield each effect when it is known: a picture before the plan that follows.

        The event is processed when all effects are taken.
        """
        sent: list[Effect] = []
        for effect in self._without_repeats(self._process(event, frames), event):
            sent.append(effect)
            yield effect
        self.stages.second_commander.note_sent(sent, event.t_ns)

    def _process(self, event: Event, frames: FrameTable | None) -> Iterator[Effect]:
        """Yield the effects of all stages."""
        if isinstance(event, Datagram):
            for of_datagram in DATAGRAM:
                yield from of_datagram(self.stages, event, frames)
            return
        if isinstance(event, Resumed):
            yield from bridge_gap(self.state, event)
            self.state = self.state  # what was derived from it is made anew
        for stage in PIPELINES[type(event)]:
            yield from stage(self.stages, event)

    def _without_repeats(self, effects: Iterable[Effect], event: Event) -> Iterator[Effect]:
        """Leave out notices that come all the time; add their summaries."""
        for effect in effects:
            if not isinstance(effect, Notice) or self.state.repeats.admit(effect):
                yield effect
        if isinstance(event, Tick):
            yield from self.state.repeats.summaries(event.t_ns)

    def untaskable(self) -> dict[int, str]:
        """Return the vehicles that are not ours to task, with the reason in words."""
        controls = {vehicle: agent.control for vehicle, agent in self.state.agents.items()}
        return {v: control.reason for v, control in controls.items() if not control.is_ours}

    def overridden(self) -> dict[int, str]:
        """Return the overriding modes by vehicle, except modes that orders here asked for."""
        return on_order.overridden_modes(self.stages)

    @property
    def grid(self) -> Grid:
        """The current map, with closed no-fly zones."""
        return self.stages.no_fly_zones.grid
