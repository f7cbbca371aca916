"""Output of `gcs info` for recordings and logs."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

from rich.console import Console
from rich.filesize import decimal
from rich.table import Table

from gcs.model import NS_PER_S

_MAX_ROWS: Final = 20
_MAX_GAPS: Final = 3


def print_contents(contents: dict[str, Any], console: Console) -> None:
    """Print a summary, the senders, their messages, missions and damage."""
    _print(console, _heading(contents))
    if contents["kind"] == "recording":
        _recording(contents, console)
    start_t_ns = contents["first_t_ns"]
    if contents["vehicles"]:
        console.print(_senders("Vehicles", contents["vehicles"], start_t_ns))
    if contents["ground_stations"]:
        console.print(_senders("Ground stations", contents["ground_stations"], start_t_ns))
    console.print(_messages([*contents["vehicles"], *contents["ground_stations"]]))
    if contents["missions"]:
        _missions(contents, console, start_t_ns)
    _damage(contents, console)


def _heading(contents: dict[str, Any]) -> str:
    text = f"{contents['file']}: {contents['kind']}, {decimal(contents['bytes'])}"
    if contents.get("parts", 1) > 1:
        text += f" in {contents['parts']} parts"
    start = datetime.fromtimestamp(contents["first_t_ns"] // NS_PER_S, tz=UTC)
    return f"{text}, {contents['seconds']:.1f} s from {start:%Y-%m-%d %H:%M:%S} UTC"


def _recording(contents: dict[str, Any], console: Console) -> None:
    seed = "seed unknown" if contents["seed"] is None else f"seed {contents['seed']}"
    versions = ", ".join(f"{name} {version}" for name, version in contents["versions"].items())
    _print(
        console,
        f"mission {contents['scenario'] or 'unnamed'}, {seed}; made with {versions or 'unknown versions'}",
    )
    for name, counts in contents["sensors"].items():
        mean = counts["detections"] / counts["scans"]
        _print(console, f"sensor {name}: {counts['scans']} scans, {mean:.1f} detections in each")
    statuses = list(contents["statuses"].values())
    end = "ended" if contents["mission_ended"] else "did not end"
    _print(console, f"the mission {end}: {statuses.count('arrived')} arrived, {statuses.count('lost')} lost")
    table = _table("Records", ("topic", "count", "Hz"))
    for topic, of in contents["records"].items():
        table.add_row(topic, str(of["count"]), _number(of["rate_hz"]))
    console.print(table)


def _senders(title: str, senders: Sequence[dict[str, Any]], start_t_ns: int | None) -> Table:
    names = ("system", "type", "autopilot", "firmware", "v", "frames", "Hz", "lost", "gaps > 5 s")
    table = _table(title, names)
    for sender in senders:
        gaps = [
            f"{gap['seconds']:.0f} s at {(gap['t_ns'] - (start_t_ns or 0)) / NS_PER_S:.0f} s"
            for gap in sender["gaps"][:_MAX_GAPS]
        ]
        more = sender["gap_count"] - len(gaps)
        lost = sender["lost"]
        share = "" if lost is None else f"{lost} ({100 * lost / max(1, lost + sender['frames']):.1f} %)"
        table.add_row(
            f"{sender['system']}/{sender['component']}",
            sender["type"],
            sender["autopilot"],
            sender["firmware"],
            sender["mavlink"] + (" signed" if sender["signed"] else ""),
            str(sender["frames"]),
            _number(sender["rate_hz"]),
            share,
            ", ".join(gaps) + (f" and {more} more" if more else ""),
        )
    return table


def _messages(senders: Sequence[dict[str, Any]]) -> Table:
    """Return a table with one row for each kind of message, summed over senders."""
    found: dict[str, list[dict[str, Any]]] = {}
    for sender in senders:
        for name, of in sender["messages"].items():
            found.setdefault(name, []).append(of)
    table = _table("Messages", ("message", "count", "senders", "Hz of each"))
    for name, kinds in sorted(found.items()):
        rates = [of["rate_hz"] for of in kinds if of["rate_hz"] is not None]
        low, high = (_number(min(rates)), _number(max(rates))) if rates else ("", "")
        table.add_row(
            name,
            str(sum(of["count"] for of in kinds)),
            str(len(kinds)),
            low if low == high else f"{low} – {high}",
        )
    return table


def _missions(contents: dict[str, Any], console: Console, start_t_ns: int | None) -> None:
    missions = contents["missions"]
    table = _table("Mission transfers", ("at s", "from", "to", "items", "seen", "result"))
    for of in missions[:_MAX_ROWS]:
        at = "" if start_t_ns is None else f"{(of['t_ns'] - start_t_ns) / NS_PER_S:.1f}"
        kind = "" if of["kind"] == "mission" else f" ({of['kind']})"
        seen = str(of["items_seen"])
        table.add_row(at, str(of["from"]), str(of["to"]), f"{of['items']}{kind}", seen, of["result"].lower())
    console.print(table)
    more = len(missions) - _MAX_ROWS + contents["more_missions"]
    if more > 0:
        _print(console, f"and {more} more transfers")


def _damage(contents: dict[str, Any], console: Console) -> None:
    for of in contents["bad_checksums"][:_MAX_ROWS]:
        _print(
            console,
            f"{of['count']} frames of message {of['message_id']} from {of['system']}/{of['component']} "
            "with a bad checksum: damaged, or of another dialect",
            "yellow",
        )
    if contents["unknown_ids"]:
        ids = ", ".join(
            f"{key} ({count})" for key, count in list(contents["unknown_ids"].items())[:_MAX_ROWS]
        )
        _print(console, f"frames of unknown message ids: {ids}", "yellow")
    if contents.get("clock_jumps"):
        jumps = contents["clock_jumps"]
        often = "once" if jumps == 1 else f"{jumps} times"
        _print(console, f"its clock was set {often} while it was written", "yellow")
    for remark in contents.get("remarks", ()):
        _print(console, remark, "yellow")
    damage = contents["damage"]
    if not damage:
        _print(console, "no damage", "green")
    elif contents["kind"] == "recording":
        _print(console, f"the recording ends early: {damage[0]['problem']}", "yellow")
    else:
        places = ", ".join(f"{of['bytes']} at byte {of['offset']}" for of in damage[:_MAX_ROWS])
        more = contents["damaged_stretches"] - min(len(damage), _MAX_ROWS)
        _print(
            console,
            f"{contents['damaged_bytes']} bytes are damaged: {places}"
            + (f" and {more} more" if more else ""),
            "yellow",
        )


def _table(title: str, columns: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for name in columns:
        right = name in ("count", "Hz", "frames", "senders", "Hz of each", "at s", "items", "seen", "lost")
        table.add_column(name, justify="right" if right else "left", no_wrap=name != "gaps > 5 s")
    return table


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _print(console: Console, text: str, style: str = "") -> None:
    console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)
