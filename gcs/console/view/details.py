"""Everything of one vehicle's record: what its panel shows, and what programs get."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.console.view.rounding import rounded
from gcs.core.engine import Engine
from gcs.core.perception.position_integrity import ALARM_CUSUM
from gcs.core.state import Agent
from gcs.core.tasking.records import OnboardMission
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.vehicle import Health
from gcs.mavlink.mission.items import Item
from gcs.model import NS_PER_S, Label, target_name, vehicle_name
from gcs.model.control import Authority, Claim

_COMMANDS: Final = dialect.enums["MAV_CMD"]
_DEGREES: Final = 1e-7


@dataclass(frozen=True, slots=True)
class VehicleDetail:
    """Record of one vehicle at one time."""

    t_ns: int
    health: Health
    autopilot: str
    """Name of the firmware; empty if it is not known."""
    claims: Mapping[Authority, Claim]
    onboard: OnboardMission | None
    """Onboard mission by the last read-back; None if it is unknown."""
    current_item: int
    """Current mission item; -1 if unknown."""
    is_selected: bool
    """False while the vehicle still counts items of the mission before."""
    is_inconsistent: bool
    is_audited: bool
    """True while the onboard mission is audited."""
    upload: str
    """Stage of its upload; empty for none."""
    upload_s: float | None
    """Time since the upload began."""
    failures: int
    """Failed uploads in a row."""
    pause_s: float
    """Time until the next attempt; 0 if none waits."""
    pinned: Label | None
    return_height: str
    """In words; empty if its parameters were not heard."""
    return_problem: str
    takeoff_problem: str
    cusum: float
    """Of the position-integrity monitor."""
    is_doubted: bool
    """True if an integrity warning about its reports is open."""


def collect_details(engine: Engine, t_ns: int) -> dict[int, VehicleDetail]:
    """Return the record of each vehicle; all parts are frozen or copies."""
    agents, stages = engine.state.agents, engine.state.tasking.stages
    return {
        health.system_id: _detail(
            engine, health, agents[health.system_id], stages.get(health.system_id, ""), t_ns
        )
        for health in engine.stages.fleet.health()
    }


def _detail(engine: Engine, health: Health, agent: Agent, stage: str, t_ns: int) -> VehicleDetail:
    vehicle, tasking, integrity = health.system_id, agent.tasking, agent.perception.integrity
    profile, height = engine.stages.fleet.profile(vehicle), engine.stages.return_heights.height(vehicle)
    return VehicleDetail(
        t_ns=t_ns,
        health=health,
        autopilot="" if profile is None else profile.name,
        claims=_shown_claims(engine, vehicle, agent),
        onboard=tasking.onboard,
        current_item=agent.link.mission_seq,
        is_selected=tasking.is_selected,
        is_inconsistent=tasking.is_inconsistent,
        is_audited=agent.authority.audit is not None,
        upload=stage,
        upload_s=engine.state.tasking.elapsed_s(vehicle, t_ns),
        failures=tasking.retry.failures,
        pause_s=max(0.0, (tasking.retry.paused_until_t_ns - t_ns) / NS_PER_S),
        pinned=agent.orders.pinned,
        return_height="" if height is None else f"{height.height_m:g} m ({height.source})",
        return_problem=agent.routes.return_problem,
        takeoff_problem=agent.takeoff.blocked,
        cusum=integrity.cusum,
        is_doubted=integrity.is_alarmed,
    )


def detail_row(detail: VehicleDetail, frame: LocalFrame, verified_age_s: float | None) -> dict[str, Any]:
    """Return the record as JSON objects.

    Parameters
    ----------
    verified_age_s : float or None
        Time since its onboard mission was verified; None if that was before a restart, or never.
    """
    health = detail.health
    return {
        "id": health.system_id,
        "name": vehicle_name(health.system_id),
        "t_s": detail.t_ns / NS_PER_S,
        "claims": list(_claims(detail)),
        "link": {
            "state": health.liveness,
            "address": None if health.address is None else " on ".join(reversed(health.address)),
            "signed": health.signed,
            "frames": health.frames,
            "lost": health.lost,
            "conflicts": health.conflicts,
            "autopilot": detail.autopilot,
            "reboots": health.boots,
        },
        "mission": _mission(detail, frame, verified_age_s),
        "upload": {
            "stage": detail.upload,
            "since_s": rounded(detail.upload_s),
            "failures": detail.failures,
            "pause_s": rounded(detail.pause_s),
        },
        "pinned": None if detail.pinned is None else target_name(detail.pinned),
        "return": {"height": detail.return_height, "problem": detail.return_problem},
        "takeoff_problem": detail.takeoff_problem,
        "position": {
            "doubted": detail.is_doubted,
            "cusum": rounded(detail.cusum),
            "alarm_cusum": ALARM_CUSUM,
            "refused": health.refused,
        },
    }


def _shown_claims(engine: Engine, vehicle: int, agent: Agent) -> Mapping[Authority, Claim]:
    """Return the claims, but for a mode that an order chose: that is no override."""
    claims = agent.control.claims
    is_ordered = engine.stages.orders.has_ordered(vehicle, agent.control.detail(Authority.OVERRIDDEN))
    return {a: claim for a, claim in claims.items() if not (a is Authority.OVERRIDDEN and is_ordered)}


def _claims(detail: VehicleDetail) -> Iterator[dict[str, Any]]:
    """Yield the claims to the vehicle, the one that prevails first."""
    for authority in sorted(detail.claims, reverse=True):
        claim = detail.claims[authority]
        yield {
            "authority": authority.word,
            "reason": authority.reason.format(claim.detail),
            "since_s": _since_s(detail.t_ns, claim),
        }


def _since_s(t_ns: int, claim: Claim) -> float | None:
    return None if claim.since_t_ns is None else rounded((t_ns - claim.since_t_ns) / NS_PER_S)


def _mission(detail: VehicleDetail, frame: LocalFrame, verified_age_s: float | None) -> dict[str, Any] | None:
    onboard = detail.onboard
    if onboard is None:
        return None
    return {
        "target": target_name(onboard.route.target),
        "items": [_item(seq, item, frame) for seq, item in enumerate(onboard.items)],
        "first": onboard.first_point,
        "current": detail.current_item if detail.is_selected else None,
        "verified_s": rounded(verified_age_s),
        "inconsistent": detail.is_inconsistent,
        "audited": detail.is_audited,
    }


def _item(seq: int, item: Item, frame: LocalFrame) -> dict[str, Any]:
    """Return an item; one without a place has none."""
    name = _COMMANDS[item.command].name if item.command in _COMMANDS else str(item.command)
    at = None
    if item.x or item.y:
        at = [rounded(value) for value in frame.to_local(item.x * _DEGREES, item.y * _DEGREES)]
    return {
        "seq": seq,
        "command": name.removeprefix("MAV_CMD_").removeprefix("NAV_"),
        "at": at,
        "alt_m": rounded(item.z_m),
    }
