"""Live view of a run in a terminal: log, agents, targets, links; plain lines elsewhere.

Both are sinks of events and effects. The live view also reads the state of the engine.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, TypeVar

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gcs.cli.link_table import link_rows, link_table
from gcs.cli.status_tables import agents_table, sensors_line, targets_table
from gcs.config import Config
from gcs.core.authority.override_notices import overridden_text
from gcs.core.engine import Engine
from gcs.io.links.vehicle_links import VehicleLinks
from gcs.io.log_output import LogConsole
from gcs.model import (
    NS_PER_S,
    AgentRecord,
    Effect,
    Event,
    Label,
    Notice,
    Proposal,
    SwarmStatus,
    TargetRecord,
)
from gcs.report.agent_order import attention
from gcs.report.operator_lines import (
    MAX_ROUTES,
    effect_notice,
    proposal_title,
    route_lines,
)
from gcs.report.plan_reminders import ProposalLog

T = TypeVar("T")

_STYLE: Final = {"info": "", "warning": "yellow", "alarm": "bold red"}
_LOG_LINES: Final = 200
_EVENT_ROWS: Final = 9
"""Rows of events at least; they get all that the tables leave."""
_LOW_EVENT_ROWS: Final = 4
_LOW_ROWS: Final = 36
"""A terminal with fewer rows gets a header of one row and fewer events."""
_TABLE_FRAME: Final = 3
"""Rows of a table besides those of its content: title, column names, a rule."""
_LINKS_FRAME: Final = 5
_MIN_TARGET_ROWS: Final = 3
_WIDE: Final = 94
"""Width of a terminal from which on all columns are shown."""
_AGENT_COLUMNS: Final = (
    ("id", "status", "authority", "mode", "alt m", "m/s", "battery", "heard", "target", "to go m", "mission"),
    ("id", "status", "mode", "alt m", "battery", "heard", "target", "mission"),
)
"""Columns for wide and for narrow terminals."""


class PlainLines:
    """Prints one line, or one JSON object, for each effect that concerns the operator.

    Times count from `start_t_ns`, by default the first event.
    """

    def __init__(self, console: Console, start_t_ns: int | None = None) -> None:
        self._console = console
        self._start_t_ns = start_t_ns
        self._proposals = ProposalLog()

    def event(self, event: Event) -> None:
        """Note the start of the run."""
        if self._start_t_ns is None:
            self._start_t_ns = event.t_ns

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Print the line of an effect, if it has one."""
        if isinstance(effect, Proposal) and not self._proposals.add_if_due(effect):
            return
        notice = effect_notice(effect)
        if notice is None:
            return
        if isinstance(self._console, LogConsole) and self._console.as_json:
            self._console.notice(notice)
            return
        seconds = (t_ns - (self._start_t_ns or t_ns)) / NS_PER_S
        line = Text(f"{seconds:7.2f} s  {notice.line}", style=_STYLE[notice.level])
        self._console.print(line, soft_wrap=True)


class LiveView:
    """Live view of a run, drawn by rich; it names the address of the console, `page_url`.

    Times count from `start_t_ns`, by default the first event.
    """

    def __init__(
        self,
        config: Config,
        engine: Engine,
        speed: float,
        links: VehicleLinks | None = None,
        page_url: str = "",
        start_t_ns: int | None = None,
    ) -> None:
        self._config = config
        self._engine = engine
        self._links = links
        self._speed = speed
        self._page_url = page_url
        self._log: deque[Text] = deque(maxlen=_LOG_LINES)
        self._start_t_ns = start_t_ns
        self._t_ns = 0

    def event(self, event: Event) -> None:
        """Note the time."""
        self._t_ns = event.t_ns
        if self._start_t_ns is None:
            self._start_t_ns = event.t_ns

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Add the line of an effect to the events, if it has one."""
        is_quiet = isinstance(effect, Notice) and effect.level == "info"
        if is_quiet or isinstance(effect, Proposal):  # A proposed plan has its own panel.
            return
        notice = effect_notice(effect)
        if notice is not None:
            seconds = (t_ns - (self._start_t_ns or t_ns)) / NS_PER_S
            self._log.append(Text(f"{seconds:6.1f} s  {notice.line}", style=_STYLE[notice.level]))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        proposal = self._proposal_lines()
        height = options.height or options.size.height
        is_low = height < _LOW_ROWS
        event_rows = _LOW_EVENT_ROWS if is_low else _EVENT_ROWS
        around = (1 if is_low else 3) + event_rows + 2 + (len(proposal) + 1 if proposal else 0)
        header = Layout(self._header() if is_low else Panel(self._header()), size=1 if is_low else 3)
        tables = Group(*self._tables(options.max_width, height - around))
        table_rows = min(len(console.render_lines(tables, options.update(height=None))), height - around)
        event_rows += height - around - table_rows
        events = self._events(console, options.max_width - 4, event_rows)
        below = [Layout(events, size=event_rows + 2)]
        if proposal:
            below.insert(0, Layout(self._proposal_panel(proposal), size=len(proposal) + 1))
        layout = Layout()
        layout.split_column(header, Layout(tables, size=table_rows), *below)
        yield layout

    def _tables(self, width: int, rows: int) -> Iterator[RenderableType]:
        """Yield the tables that fit into `rows`, and a line about those that do not."""
        status = self._engine.stages.status_report.build(self._t_ns)
        agents = len(status.agents)
        targets = len(status.targets)
        link_counters = link_rows(self._engine.stages.fleet, self._links, self._t_ns)
        free_rows = rows - 2 * _TABLE_FRAME
        overridden = overridden_text(self._engine.overridden())
        if status.sensors:
            free_rows -= 1
            yield sensors_line(status.sensors)
        if overridden:
            free_rows -= 1
            yield Text(overridden, style="bold yellow", no_wrap=True, overflow="ellipsis")
        has_links = agents + targets + _LINKS_FRAME + len(link_counters) <= free_rows
        free_rows -= 0 if has_links else 1
        target_rows = min(targets, max(_MIN_TARGET_ROWS, free_rows - agents))
        yield self._agents(status.agents, width, max(1, free_rows - target_rows))
        yield self._targets(status, max(1, target_rows))
        if has_links:
            yield link_table(link_counters)
        else:
            yield Text("links: not shown, too few rows", style="dim")

    def _header(self) -> Text:
        seconds = (self._t_ns - (self._start_t_ns or self._t_ns)) / NS_PER_S
        return Text.assemble(
            (f"{self._config.name}  ", "bold"),
            f"{seconds:.0f} s of run time",
            _at_speed(self._speed),
            (f"console {self._page_url}  " if self._page_url else "", "bold cyan"),
            (self._config.description, "dim"),
            no_wrap=True,
            overflow="ellipsis",
        )

    def _agents(self, agents: Sequence[AgentRecord], width: int, max_rows: int) -> RenderableType:
        """Return a table of the agents, with the columns that fit into a width."""
        shown, more = _cut(agents, max_rows, attention)
        columns = _AGENT_COLUMNS[0 if width >= _WIDE else 1]
        signing = self._signing if self._config.links.keys else None
        return _with_more(agents_table(shown, columns, signing), more)

    def _signing(self, vehicle: int) -> str:
        """Return "verified" or "unchecked" for a vehicle that signs; empty otherwise."""
        fleet = self._engine.stages.fleet
        if not fleet.is_signed(vehicle):
            return ""
        keyed = self._links is not None and self._links.is_keyed(fleet.link(vehicle), vehicle)
        return "verified" if keyed else "unchecked"

    def _targets(self, status: SwarmStatus, max_rows: int) -> RenderableType:
        """Return a table of the targets; those that need agents first if rows are left out."""

        def rank(target: TargetRecord) -> tuple[bool, bool, Label]:
            return bool(target.reached_by) or target.is_ignored, bool(target.agents), target.label

        shown, more = _cut(status.targets, max_rows, rank)
        return _with_more(targets_table(shown), more)

    def _events(self, console: Console, width: int, rows: int) -> Panel:
        """Return the newest events; a wrapped line displaces older ones."""
        lines: list[Text] = []
        for event in reversed(self._log):
            if len(lines) >= rows:
                break
            lines = [*event.wrap(console, width), *lines]
        return Panel(Group(*lines[-rows:]), title=Text("Events"), title_align="left")

    def _proposal_lines(self) -> list[str]:
        """Return the lines about the proposed plan, a title and one for each route; empty without one."""
        pending = self._engine.state.operator.approval.pending
        if pending is None:
            return []
        title = f"{proposal_title(pending, self._t_ns)} (gcs order confirm {pending.plan_id})"
        return [title, *route_lines(pending, MAX_ROUTES)]

    def _proposal_panel(self, proposal: Sequence[str]) -> Panel:
        """Return a panel for the proposed plan; a long one displaces no alarm."""
        title, *routes = proposal
        lines = (Text(line, no_wrap=True, overflow="ellipsis") for line in routes)
        return Panel(Group(*lines), title=Text(title, style="bold yellow"), title_align="left")


def _cut(rows: Sequence[T], max_rows: int, urgency: Callable[[T], Any]) -> tuple[Sequence[T], int]:
    """Return at most `max_rows` rows, the most urgent first, and the number of the others."""
    if len(rows) <= max_rows:
        return rows, 0
    kept = sorted(rows, key=urgency)[: max(1, max_rows - 1)]
    return kept, len(rows) - len(kept)


def _with_more(table: Table, more: int) -> RenderableType:
    """Add the number of missing rows below a table."""
    if not more:
        return table
    return Group(table, Text(f"and {more} more; the most urgent are shown", style="yellow"))


def _at_speed(speed: float) -> str:
    if speed == 1.0:
        return "  "
    return " at full speed  " if math.isinf(speed) else f" at speed {speed:g}  "
