"""Datagrams of vehicles and of other ground stations."""

from __future__ import annotations

from gcs.core.stages import Stages
from gcs.mavlink.fleet.fleet import TRAFFIC
from gcs.mavlink.frames.codec import FrameTable, scan
from gcs.model import Datagram, Effect


def receive_from_stations(stages: Stages, event: Datagram, frames: FrameTable | None) -> list[Effect]:
    """Watch what another ground station sends to our vehicles."""
    if not stages.external_uploads.hosts(event.link):
        return []
    table = scan(event.data) if frames is None else frames
    effects, overridden = stages.external_uploads.receive(event, table)
    stages.parameter_changes.receive_forwarded(event, table)
    for vehicle in overridden:
        stages.state.agents[vehicle].routes.drop()
        stages.tasking.forget_onboard(vehicle)
    return effects


def receive_from_vehicles(stages: Stages, event: Datagram, frames: FrameTable | None) -> list[Effect]:
    """Apply telemetry; pass the other messages to uploads, orders and audits."""
    if stages.external_uploads.hosts(event.link):
        return []
    t_ns = event.t_ns
    effects: list[Effect] = []
    for vehicle, message in stages.fleet.receive(event, frames):
        if message.get_msgId() in TRAFFIC:
            stages.air_traffic.receive(message, t_ns)
            continue
        stages.return_heights.receive(vehicle, message)
        stages.terrain.receive(vehicle, message)
        effects += stages.dispatch.settle(stages.tasking.receive(vehicle, message, t_ns))
        stages.failsafes.receive(vehicle, message, t_ns)
        effects += stages.orders.receive(vehicle, message, t_ns)
        effects += stages.avoidances.receive(vehicle, message, t_ns)
        effects += stages.disarmed_in_auto.receive(vehicle, message, t_ns)
        effects += stages.onboard_audit.receive(vehicle, message, t_ns)
        effects += stages.external_uploads.receive_reply(vehicle, message, t_ns)
        effects += stages.dispatch.settle(stages.second_commander.receive(vehicle, message, t_ns))
        effects += stages.parameter_changes.receive(vehicle, message, t_ns)
    return effects
