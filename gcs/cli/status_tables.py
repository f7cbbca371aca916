"""Tables of the swarm's status: agents, targets and sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from gcs.model import AgentRecord, SensorRecord, SwarmStatus, TargetRecord, target_name, vehicle_name
from gcs.report.agent_order import attention

_STATUS_STYLE: Final = {"active": "cyan", "arrived": "green", "lost": "red", "down": "red"}
_FIX_NAMES: Final = {0: "none", 1: "none", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK", 7: "static"}
AGENT_COLUMNS: Final = (
    "id", "status", "phase", "authority", "mode", "armed", "alt m", "AGL m", "m/s", "battery", "fix", "heard",
    "loss", "target", "to go m", "ETA s", "mission",
)  # fmt: skip
_LEFT_COLUMNS: Final = ("status", "phase", "authority", "mode", "armed", "mission")


def status_tables(status: SwarmStatus, mission: str) -> Iterator[RenderableType]:
    """Yield a head line, and the tables of agents, targets and sensors."""
    yield _head(status, mission)
    yield agents_table(sorted(status.agents, key=attention))
    if status.targets:
        yield targets_table(status.targets)
    if status.sensors:
        yield _sensors(status.sensors)


def _head(status: SwarmStatus, mission: str) -> Text:
    counts = [
        f"{sum(agent.status == name for agent in status.agents)} {name}"
        for name in ("active", "arrived", "lost")
    ]
    down = sum(agent.status == "down" for agent in status.agents)
    counts += [f"{down} down"] if down else []
    facts = f"agents {', '.join(counts)}; {len(status.targets)} targets; terrain {status.terrain}"
    head = Text.assemble((mission, "bold"), f": {facts}")
    if status.has_ended:
        head.append("; the mission has ended", style="green")
    if status.plan_id is not None:
        head.append(f"; plan {status.plan_id} waits: gcs order plan", style="bold yellow")
    return head


def agents_table(
    agents: Sequence[AgentRecord],
    columns: Sequence[str] = AGENT_COLUMNS,
    signing: Callable[[int], str] | None = None,
) -> Table:
    """Return a table with a row for each agent; `signing` gives the cells of another column."""
    table = titled_table("Agents")
    for name in columns:
        table.add_column(
            name, justify="left" if name in _LEFT_COLUMNS else "right", no_wrap=name != "mission"
        )
    if signing:
        table.add_column("signed", no_wrap=True)
    for agent in agents:
        cells = _agent_cells(agent)
        row = [cells[name] for name in columns]
        if signing:
            row.append(signing(agent.vehicle))
        table.add_row(*row)
    return table


def _agent_cells(agent: AgentRecord) -> dict[str, str | Text]:
    battery_style = "bold red" if agent.is_battery_low else ""
    heard_style = "bold red" if agent.is_late else ""
    return {
        "id": vehicle_name(agent.vehicle),
        "status": Text("position doubted", style="bold red")
        if agent.is_position_doubted
        else Text(agent.status, style=_STATUS_STYLE[agent.status]),
        "phase": Text(agent.phase, style="bold red" if agent.problems else ""),
        "authority": Text(agent.authority, style="" if agent.authority == "ours" else "bold yellow"),
        "mode": agent.mode,
        "armed": "armed" if agent.armed else "",
        "alt m": _number(agent.alt_rel_m, ".0f"),
        "AGL m": _number(agent.agl_m, ".0f") or "-",
        "m/s": _number(agent.ground_speed_m_s, ".1f"),
        "battery": Text(_number(agent.battery_percent, "d", " %"), style=battery_style),
        "fix": "" if agent.fix_type is None else _FIX_NAMES.get(agent.fix_type, str(agent.fix_type)),
        "heard": Text(_number(agent.heard_age_s, ".1f", " s") or "never", style=heard_style),
        "loss": f"{100.0 * agent.loss:.1f} %",
        "target": _target(agent),
        "to go m": _number(agent.to_go_m, ".0f"),
        "ETA s": _number(agent.eta_s, ".0f"),
        "mission": _mission(agent),
    }


def _target(agent: AgentRecord) -> str:
    """Return the target of an agent; with a question mark if it is proposed only."""
    target = agent.target or agent.proposed_target
    text = "" if target is None else target_name(target) + ("?" if agent.target is None else "")
    if agent.pinned is None:
        return text
    return f"{text} (pin)" if agent.pinned == target else f"{text} (pin {target_name(agent.pinned)})".strip()


def _mission(agent: AgentRecord) -> str | Text:
    """Return why an agent is not ours, else the stage of its upload or the state of its mission."""
    if agent.reason:
        return Text(agent.reason, style="yellow")
    if agent.upload:
        return f"upload: {agent.upload}"
    if agent.has_failed:
        return Text("upload failed", style="bold red")
    return "verified" if agent.is_verified else ""


def targets_table(targets: Sequence[TargetRecord]) -> Table:
    """Return a table with a row for each target; a column tells what was ordered, if anything was."""
    table = titled_table("Targets")
    orders = [_orders(target) for target in targets]
    for name in ("target", "existence", "east m", "north m", "m/s"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("agents")
    table.add_column("reached by")
    if any(orders):
        table.add_column("by order")
    for target, order in zip(targets, orders, strict=True):
        east_m, north_m = target.position_m
        table.add_row(
            target_name(target.label),
            f"{target.existence:.2f}",
            f"{east_m:.0f}",
            f"{north_m:.0f}",
            f"{target.speed_m_s:.1f}",
            ", ".join(map(vehicle_name, target.agents)),
            Text(", ".join(map(vehicle_name, target.reached_by)), style="green"),
            *([order] if any(orders) else []),
            style="dim strike" if target.is_ignored else "",
        )
    return table


def _orders(target: TargetRecord) -> str:
    parts = ["ignored"] if target.is_ignored else []
    if target.priority is not None:
        parts.append(f"priority {target.priority}")
    if target.pinned:
        parts.append(f"pinned {', '.join(map(vehicle_name, target.pinned))}")
    return ", ".join(parts)


def sensors_line(sensors: Sequence[SensorRecord]) -> Text:
    """Return the age of each sensor's last scan in one line."""
    ages = [
        f"{one.name} {'never' if one.scan_age_s is None else f'{one.scan_age_s:.1f} s ago'}"
        for one in sensors
    ]
    return Text(f"scans: {', '.join(ages)}", no_wrap=True, overflow="ellipsis")


def _sensors(sensors: tuple[SensorRecord, ...]) -> Table:
    table = titled_table("Sensors")
    table.add_column("sensor")
    table.add_column("last scan", justify="right")
    table.add_column("refused since", justify="right")
    for sensor in sensors:
        age = "never" if sensor.scan_age_s is None else f"{sensor.scan_age_s:.1f} s ago"
        table.add_row(sensor.name, age, str(sensor.refused or ""))
    return table


def titled_table(title: str) -> Table:
    """Return an empty table in the style of all tables of a run."""
    return Table(
        title=title, title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0)
    )


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:{form}}{unit}"
