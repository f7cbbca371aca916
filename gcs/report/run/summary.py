"""The summary at the end of a run: a panel in a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gcs.report.run.evaluation import AgentOutcome, Retask, Summary

_COLOURS = {"arrived": "green", "lost": "red", "active": "yellow"}
_ROWS = 12
"""More agents than this are listed by status."""
_RETASKS = 15
"""At most this many re-tasks are listed; the recording has all."""


def print_summary(
    summary: Summary, console: Console, picture: Path | None = None, firmware: Path | None = None
) -> None:
    """Show the result of a run.

    Parameters
    ----------
    picture : Path or None
        File of the run's figure.
    firmware : Path or None
        Folder with the logs of real firmware.
    """
    if console.is_terminal:
        console.print(render(summary, picture, firmware))
    else:
        text = summary_text(summary, picture, firmware)
        console.print(text, highlight=False, markup=False, soft_wrap=True)


def summary_text(summary: Summary, picture: Path | None = None, firmware: Path | None = None) -> str:
    """Return the summary as plain lines."""
    lines = [_title(summary), f"  {summary.reason}"]
    lines += [f"  agent {a.system_id}: {_agent_text(a)}" for a in summary.agents]
    lines += [f"  {name}: {value}" for name, value in _facts(summary, picture, firmware)]
    lines += [
        f"  re-task at {when}: {vehicles}: {why}" for when, vehicles, why in _retasks(summary.retask_list)
    ]
    lines += [f"  {more}" for more in _more_retasks(summary.retask_list)]
    return "\n".join(lines)


def render(summary: Summary, picture: Path | None = None, firmware: Path | None = None) -> RenderableType:
    """Return the summary as a panel for a terminal."""
    colour = "green" if summary.outcome == "complete" else "red"
    facts = Table.grid(padding=(0, 2))
    facts.add_column(style="dim", no_wrap=True)
    facts.add_column(overflow="fold")
    for name, value in _facts(summary, picture, firmware):
        facts.add_row(name, value)
    parts: list[RenderableType] = [
        Text(summary.reason, style=colour),
        Text(),
        _agents(summary.agents),
        Text(),
        facts,
    ]
    if summary.retask_list:
        parts += [Text(), _retask_table(summary.retask_list)]
    title = f"[bold]{_title(summary)}[/]"
    body = Group(*parts)
    return Panel(body, title=title, title_align="left", border_style=colour, padding=(1, 2), expand=False)


def _title(summary: Summary) -> str:
    return f"{summary.scenario}, seed {summary.seed}: {summary.outcome} after {summary.duration_s:.1f} s"


def _agent_text(agent: AgentOutcome) -> str:
    return agent.status if agent.target is None else f"{agent.status} at target {agent.target}"


def _facts(summary: Summary, picture: Path | None, firmware: Path | None) -> list[tuple[str, str]]:
    facts = [
        ("targets reached", f"{summary.targets_reached} of {summary.targets_total}"),
        ("losses detected", _losses(summary)),
        ("re-tasks", _retasks_by_trigger(summary)),
        ("uploads", f"{summary.uploads}, {summary.upload_failures} failed"),
        ("OSPA agents", _metres(summary.ospa_agents_mean_m)),
        ("OSPA targets", _metres(summary.ospa_targets_mean_m)),
        ("scan", f"{summary.scan_ms_p99:.1f} ms (99th percentile)"),
        ("plan", f"{summary.plan_ms_p99:.1f} ms (99th percentile)"),
    ]
    if picture is not None:
        facts.append(("picture", str(picture)))
    if firmware is not None:
        facts.append(("firmware logs", str(firmware)))
    return facts + recording_facts(summary.recording)


def recording_facts(folder: str) -> list[tuple[str, str]]:
    """Return the folder of a recording, and the commands that show it; nothing without one."""
    if not folder:
        return []
    path = shlex.quote(folder)
    return [
        ("recording", folder),
        ("look at it", f"gcs replay {path}"),
        ("evaluate it", f"gcs report {path}"),
    ]


def _retasks_by_trigger(summary: Summary) -> str:
    counts = Counter(trigger for retask in summary.retask_list for trigger in retask.triggers)
    by_trigger = ", ".join(f"{count} {trigger}" for trigger, count in counts.most_common())
    return f"{summary.retasks} ({by_trigger})" if by_trigger else str(summary.retasks)


def _losses(summary: Summary) -> str:
    text = f"{len(summary.loss_delays_s)} of {summary.losses}"
    if summary.loss_delays_s:
        delays = sorted(summary.loss_delays_s)
        text += f", after {delays[0]:.1f} s" + (f" to {delays[-1]:.1f} s" if len(delays) > 1 else "")
    if summary.false_losses:
        text += f"; {summary.false_losses} false"
    return text


def _metres(mean_m: float) -> str:
    return "not measured" if math.isnan(mean_m) else f"{mean_m:.2f} m (mean)"


def _agents(agents: Sequence[AgentOutcome]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="dim")
    if len(agents) > _ROWS:
        table.add_column("status")
        table.add_column("agents")
        for status, colour in _COLOURS.items():
            these = [str(a.system_id) for a in agents if a.status == status]
            if these:
                table.add_row(Text(f"{len(these)} {status}", style=colour), " ".join(these))
        return table
    table.add_column("agent", justify="right")
    table.add_column("status")
    table.add_column("target", justify="right")
    for agent in agents:
        target = "" if agent.target is None else str(agent.target)
        table.add_row(str(agent.system_id), Text(agent.status, style=_COLOURS[agent.status]), target)
    return table


def _retask_table(retasks: Sequence[Retask]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="dim")
    table.add_column("re-tasked at", justify="right", no_wrap=True)
    table.add_column("agents")
    table.add_column("reason")
    for when, vehicles, reason in _retasks(retasks):
        table.add_row(when, vehicles, Text(reason))
    for more in _more_retasks(retasks):
        table.add_row("", "", more)
    return table


def _retasks(retasks: Sequence[Retask]) -> list[tuple[str, str, str]]:
    return [(f"{r.t_s:.1f} s", ", ".join(str(v) for v in r.vehicles), r.reason) for r in retasks[:_RETASKS]]


def _more_retasks(retasks: Sequence[Retask]) -> list[str]:
    return [f"and {len(retasks) - _RETASKS} more re-tasks"] if len(retasks) > _RETASKS else []
