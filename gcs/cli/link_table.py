"""The counters of all links, as rows for a table or for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich import box
from rich.table import Table

from gcs.io.links.manager import Links
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.link_stats import LinkCounters
from gcs.mavlink.frames.signing import SigningCounters
from gcs.mavlink.router.router import PortCounters

_COLUMNS = (
    "link", "role", "frames", "lost", "CRC", "unknown_systems", "conflicts", "unsent", "signing", "guests",
)  # fmt: skip
_ALWAYS = ("link", "role", "frames", "lost")


def link_rows(fleet: Fleet, links: Links | None, t_ns: int) -> list[dict[str, Any]]:
    """One row for each link: those of vehicles as central command heard them, then those of guests.

    Parameters
    ----------
    links
        None in a replay, where there are no guests.
    """
    unsent = {} if links is None else links.unsent()
    silent = [] if links is None else [link.name for link in links.links if link.role == "vehicles"]
    heard = {name: LinkCounters() for name in silent} | fleet.links
    rows: list[dict[str, Any]] = [
        {
            "link": name,
            "role": "vehicles",
            **asdict(counters),
            "unsent": unsent.get(name, 0),
            **_signing(links, name),
        }
        for name, counters in heard.items()
    ]
    if links is None:
        return rows
    guests, counters = links.ground_stations(t_ns), links.counters()
    for link in links.links:
        if link.role == "vehicles":
            continue
        counted = counters.get(link.name, PortCounters())
        row = {"link": link.name, "role": link.role, "guests": guests[link.name], **asdict(counted)}
        row |= {"refused": dict(counted.refused), "unsent": unsent[link.name]}
        rows.append({**row, **_signing(links, link.name)})
    return rows


def _signing(links: Links | None, name: str) -> dict[str, Any]:
    """What the link's gate did; nothing where it had nothing to do."""
    gate = None if links is None else links.signing.gate
    if gate is None or not (gate.is_keyed(name) or name in gate.counters):
        return {}
    counters = gate.counters.get(name, SigningCounters())
    return {"verified": counters.verified, "signed": counters.signed, "rejected": dict(counters.rejected)}


def link_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Draw the rows; a column in which no link has anything is left out: terminals are narrow."""
    table = Table(title="Links", title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    cells = [_cells(row) for row in rows]
    shown = [name for name in _COLUMNS if name in _ALWAYS or any(row[name] not in ("", 0) for row in cells)]
    for name in shown:
        left = name in ("link", "role", "signing", "guests")
        table.add_column(name, justify="left" if left else "right", no_wrap=name in _ALWAYS, overflow="fold")
    for row in cells:
        table.add_row(*(str(row[name]) for name in shown))
    return table


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """What a row shows in each column."""
    cells = {**dict.fromkeys(_COLUMNS, ""), **row, "signing": _gate(row), "guests": ""}
    if row["role"] == "vehicles":
        return cells | {"lost": _loss(row), "CRC": row["crc_errors"]}
    kept = sum(row["refused"].values())
    counted = f"{row['sent']} sent, {row['passed']} passed on, {kept} kept back"
    return cells | {"guests": f"{len(row['guests'])}; {counted}"}


def _gate(row: Mapping[str, Any]) -> str:
    """Sum up signing; empty where nothing is signed and nothing was kept out."""
    if "rejected" not in row:
        return ""
    return f"{row['verified']} verified, {sum(row['rejected'].values())} rejected"


def _loss(row: Mapping[str, Any]) -> str:
    there = row["frames"] - row["unknown_systems"] - row["conflicts"] + row["lost"]
    return f"{100.0 * row['lost'] / there:.1f} %" if there > 0 else "0.0 %"
