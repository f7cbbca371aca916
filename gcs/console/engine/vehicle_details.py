"""Details of one vehicle: what its panel shows, and what programs get."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.console.source import UnknownVehicleError
from gcs.console.view.page_records import (
    ClaimDetail,
    LinkDetail,
    MissionDetail,
    MissionItem,
    PositionDetail,
    ReturnDetail,
    UploadDetail,
    VehicleDetail,
)
from gcs.core.engine import Engine
from gcs.core.perception.position_integrity import ALARM_CUSUM
from gcs.core.state import Agent
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.vehicle import Health
from gcs.mavlink.mission.items import Item
from gcs.model import NS_PER_S
from gcs.model.authority import Authority, Claim
from gcs.model.rounding import rounded, rounded_place

_COMMANDS: Final = dialect.enums["MAV_CMD"]
_DEGREES: Final = 1e-7


def vehicle_detail(engine: Engine, vehicle: int, t_ns: int, verified: tuple[int, int]) -> VehicleDetail:
    """Return the details of a vehicle.

    Parameters
    ----------
    verified : tuple of int
        Number of its last verified mission, and the time of that; zeros if it is not known.

    Raises
    ------
    UnknownVehicleError
        When the mission has no such vehicle.
    """
    agent = engine.state.agents.get(vehicle)
    if agent is None:
        raise UnknownVehicleError
    health = engine.stages.fleet.health_of(vehicle)
    height = engine.stages.return_heights.height(vehicle)
    retry = agent.tasking.retry
    integrity = agent.perception.integrity
    return VehicleDetail(
        t_s=t_ns / NS_PER_S,
        agent=engine.stages.status_report.agent(health, t_ns),
        claims=tuple(_claims(_shown_claims(engine, vehicle, agent), t_ns)),
        link=_link(engine, health),
        mission=_mission(agent, engine.config.local_frame, t_ns, verified),
        upload=UploadDetail(
            since_s=rounded(engine.state.tasking.elapsed_s(vehicle, t_ns)),
            failures=retry.failures,
            pause_s=round(max(0.0, (retry.paused_until_t_ns - t_ns) / NS_PER_S), 1),
        ),
        return_=ReturnDetail(
            height="" if height is None else f"{height.height_m:g} m ({height.source})",
            problem=agent.routes.return_problem,
        ),
        takeoff_problem=agent.takeoff.blocked,
        position=PositionDetail(round(integrity.cusum, 1), ALARM_CUSUM, health.refused),
    )


def _shown_claims(engine: Engine, vehicle: int, agent: Agent) -> Mapping[Authority, Claim]:
    """Return the claims, but for a mode that an order chose: that is no override."""
    claims = agent.control.claims
    is_ordered = engine.stages.orders.has_ordered(vehicle, agent.control.detail(Authority.OVERRIDDEN))
    return {a: claim for a, claim in claims.items() if not (a is Authority.OVERRIDDEN and is_ordered)}


def _claims(claims: Mapping[Authority, Claim], t_ns: int) -> Iterator[ClaimDetail]:
    for authority in sorted(claims, reverse=True):
        claim = claims[authority]
        since_s = None if claim.since_t_ns is None else rounded((t_ns - claim.since_t_ns) / NS_PER_S)
        yield ClaimDetail(authority.word, authority.reason.format(claim.detail), since_s)


def _link(engine: Engine, health: Health) -> LinkDetail:
    profile = engine.stages.fleet.profile(health.system_id)
    return LinkDetail(
        state=health.liveness,
        address=None if health.address is None else " on ".join(reversed(health.address)),
        signed=health.signed,
        frames=health.frames,
        lost=health.lost,
        conflicts=health.conflicts,
        autopilot="" if profile is None else profile.name,
        reboots=health.boots,
    )


def _mission(agent: Agent, frame: LocalFrame, t_ns: int, verified: tuple[int, int]) -> MissionDetail | None:
    tasking = agent.tasking
    onboard = tasking.onboard
    if onboard is None:
        return None
    mission_id, verified_t_ns = verified
    is_known = mission_id != 0 and mission_id == onboard.mission_id
    return MissionDetail(
        target=onboard.route.target,
        items=tuple(_item(seq, item, frame) for seq, item in enumerate(onboard.items)),
        first=onboard.first_point,
        current=agent.link.mission_seq if tasking.is_selected else None,
        verified_s=rounded((t_ns - verified_t_ns) / NS_PER_S) if is_known else None,
        inconsistent=tasking.is_inconsistent,
        audited=agent.authority.audit is not None,
    )


def _item(seq: int, item: Item, frame: LocalFrame) -> MissionItem:
    name = _COMMANDS[item.command].name if item.command in _COMMANDS else str(item.command)
    at = None
    if item.x or item.y:
        at = rounded_place(*frame.to_local(item.x * _DEGREES, item.y * _DEGREES))
    name = name.removeprefix("MAV_CMD_").removeprefix("NAV_")
    is_msl = item.frame in (dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_INT)
    return MissionItem(seq, name, at, rounded(item.z_m), "msl" if is_msl else "home")
